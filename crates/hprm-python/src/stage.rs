//! The stage of a program's `files:`, for the package, which decides when it goes away.

use std::path::{Path, PathBuf};

use pyo3::prelude::*;

/// A folder with links to the files of a program.
#[pyclass(frozen)]
pub(crate) struct Stage(std::sync::Mutex<Option<hprm::Stage>>);

#[pymethods]
impl Stage {
    /// Where it is; none once it is removed.
    #[getter]
    fn path(&self) -> Option<PathBuf> {
        self.locked().as_ref().map(|stage| stage.path().to_owned())
    }

    /// Removes it.
    fn remove(&self) {
        self.locked().take();
    }
}

impl Stage {
    fn locked(&self) -> std::sync::MutexGuard<'_, Option<hprm::Stage>> {
        self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }
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
    Ok(stage.map(|stage| Stage(std::sync::Mutex::new(Some(stage)))))
}

/// Whether the folder at `stage` is one of the program at `program`.
#[pyfunction]
pub(crate) fn is_stage_of(stage: PathBuf, program: PathBuf) -> bool {
    hprm::is_stage_of(Path::new(&stage), Path::new(&program))
}
