//! The stage of a program's `files:`, for the package, which decides when it goes away.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

use pyo3::prelude::*;

/// A stage, until it is removed.
type Shared = Mutex<Option<hprm::Stage>>;

/// The stages that this process has made.
static MADE: Mutex<Vec<Weak<Shared>>> = Mutex::new(Vec::new());

/// A folder with links to the files of a program.
#[pyclass(frozen)]
pub(crate) struct Stage(Arc<Shared>);

#[pymethods]
impl Stage {
    /// Where it is; none once it is removed.
    #[getter]
    fn path(&self) -> Option<PathBuf> {
        locked(&self.0).as_ref().map(|stage| stage.path().to_owned())
    }

    /// Removes it.
    fn remove(&self) {
        locked(&self.0).take();
    }
}

/// Removes all stages of this process, which is about to end by force.
pub(crate) fn remove_all() {
    for stage in locked(&MADE).iter().filter_map(Weak::upgrade) {
        locked(&stage).take();
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Stages the files of the program at `program`, each a name with the file that states it. None if they
/// all lie beside the program.
///
/// # Errors
///
/// `OSError` if there is no room for it.
#[pyfunction]
pub(crate) fn stage_files(
    program: PathBuf,
    files: Vec<(String, String)>,
) -> PyResult<Option<Stage>> {
    let files = files.iter().map(|(name, stated_in)| (name, stated_in.as_str()));
    let stage = hprm::Stage::of_files(&program, files)?;
    let stage = stage.map(|stage| Arc::new(Mutex::new(Some(stage))));
    locked(&MADE).extend(stage.as_ref().map(Arc::downgrade));
    Ok(stage.map(Stage))
}

/// Whether the folder at `stage` is one of the program at `program`.
#[pyfunction]
pub(crate) fn is_stage_of(stage: PathBuf, program: PathBuf) -> bool {
    hprm::is_stage_of(Path::new(&stage), Path::new(&program))
}
