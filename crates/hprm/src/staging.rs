//! The files that a program names in `files:`, side by side in a folder of their own.
//!
//! Lingua Franca copies them flat into the folder of the module that it generates, and programs find them
//! there by `__file__`. HPRM generates no module, so a [`Stage`] has a symbolic link to each file. The run removes
//! it at its end. What a process that was killed has left behind, the next one removes when it makes a stage: a
//! lock on the folder, which ends with the process, tells whether the folder is in use.

use std::fs::{self, File};
use std::io;
use std::os::unix::fs::{DirBuilderExt, MetadataExt, symlink};
use std::path::{Component, Path, PathBuf};
use std::time::{Duration, SystemTime};

use hprm_model::Compiled;
use rustix::fs::{FlockOperation, flock};

/// The environment variable by which processes of a program find the stage that one of them has made.
pub const STAGE: &str = "HPRM_STAGE";

/// What the names of all stages begin with.
const PREFIX: &str = "hprm-stage-";

/// The link to the program itself.
const PROGRAM: &str = ".program";

/// For how long a new stage may have no lock yet.
const UNLOCKED: Duration = Duration::from_secs(60);

/// How often another name is tried.
const ATTEMPTS: u32 = 100;

/// A folder with links to the files of a program, which is removed when this is dropped.
#[derive(Debug)]
pub struct Stage {
    path: PathBuf,
    _lock: File,
}

impl Stage {
    /// Stages the files of a program. None if it needs no stage: all of them lie beside it, where
    /// its own `__file__` leads. Files that are missing are left out.
    ///
    /// # Errors
    ///
    /// If the folder for temporary files takes no more.
    pub fn of(compiled: &Compiled) -> io::Result<Option<Self>> {
        let sources = &compiled.sources;
        let files = compiled.files.iter().map(|(name, file)| (name, sources.path(*file)));
        Self::of_files(Path::new(sources.path(hprm_model::FileId::MAIN)), files)
    }

    /// The same, for the program at `program` and files by their names, each with the file that
    /// names it.
    ///
    /// # Errors
    ///
    /// As [`Self::of`].
    pub fn of_files<'a>(
        program: &Path,
        files: impl Iterator<Item = (&'a String, &'a str)>,
    ) -> io::Result<Option<Self>> {
        let program = absolute(program)?;
        let home = program.parent().map(Path::to_path_buf).unwrap_or_default();
        let mut targets = Vec::new();
        for (name, stated_in) in files {
            let stated_in = absolute(Path::new(stated_in))?;
            targets.push(flat(&stated_in.parent().unwrap_or(&home).join(name)));
        }
        targets.retain(|target| target.exists());
        if targets.iter().all(|target| target.parent() == Some(&home)) {
            return Ok(None);
        }
        let folder = std::env::temp_dir();
        remove_abandoned(&folder);
        let stage = Self::empty(&folder)?;
        symlink(&program, stage.path.join(PROGRAM))?;
        for target in &targets {
            let Some(name) = target.file_name() else { continue };
            let link = stage.path.join(name);
            // Of two with one name, the later one counts, as if it were copied over the other.
            if link.is_symlink() {
                fs::remove_file(&link)?;
            }
            symlink(target, link)?;
        }
        Ok(Some(stage))
    }

    fn empty(folder: &Path) -> io::Result<Self> {
        let mut attempt = 0;
        loop {
            let path = folder.join(format!("{PREFIX}{}-{attempt}", std::process::id()));
            match fs::DirBuilder::new().mode(0o700).create(&path) {
                Ok(()) => {
                    let lock = File::open(&path)?;
                    flock(&lock, FlockOperation::LockExclusive)?;
                    return Ok(Self { path, _lock: lock });
                }
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => attempt += 1,
                Err(error) => return Err(error),
            }
            if attempt == ATTEMPTS {
                return Err(io::ErrorKind::AlreadyExists.into());
            }
        }
    }

    /// Where it is.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl Drop for Stage {
    fn drop(&mut self) {
        // What cannot be removed now, the next stage removes.
        let _ = fs::remove_dir_all(&self.path);
    }
}

/// Whether the folder at `stage` is one of the program at `program`.
#[must_use]
pub fn is_stage_of(stage: &Path, program: &Path) -> bool {
    let staged = fs::read_link(stage.join(PROGRAM));
    staged.is_ok_and(|staged| absolute(program).is_ok_and(|program| staged == program))
}

/// Removes the stages of this user that no process has locked.
fn remove_abandoned(folder: &Path) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    let user = rustix::process::geteuid().as_raw();
    for entry in entries.flatten() {
        let is_stage = entry.file_name().to_str().is_some_and(|name| name.starts_with(PREFIX));
        if !is_stage {
            continue;
        }
        let is_mine = |of: &fs::Metadata| {
            let age = of.modified().map(|at| SystemTime::now().duration_since(at));
            let is_old = age.is_ok_and(|age| age.is_ok_and(|age| age > UNLOCKED));
            of.is_dir() && of.uid() == user && is_old
        };
        if !entry.metadata().is_ok_and(|metadata| is_mine(&metadata)) {
            continue;
        }
        let Ok(lock) = File::open(entry.path()) else { continue };
        if flock(&lock, FlockOperation::NonBlockingLockExclusive).is_ok() {
            let _ = fs::remove_dir_all(entry.path());
        }
    }
}

fn absolute(path: &Path) -> io::Result<PathBuf> {
    std::path::absolute(path).map(|path| flat(&path))
}

/// An absolute path without `.` and `..`, by its text alone: links stay what they are.
fn flat(path: &Path) -> PathBuf {
    let mut flat = PathBuf::new();
    for component in path.components() {
        match component {
            Component::ParentDir => drop(flat.pop()),
            Component::CurDir => {}
            other => flat.push(other),
        }
    }
    flat
}

#[cfg(test)]
mod tests {
    use super::*;

    fn project() -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for path in ["src/include/images/a.png", "code/nnets/n.nnet", "src/beside.csv"] {
            let path = folder.path().join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(&path, path.file_name().unwrap().as_encoded_bytes()).unwrap();
        }
        folder
    }

    fn staged(folder: &Path, files: &[&str]) -> Option<Stage> {
        let program = folder.join("src/Main.lf");
        let names: Vec<String> = files.iter().map(|&name| name.to_owned()).collect();
        let stated_in = program.to_str().unwrap();
        Stage::of_files(&program, names.iter().map(|name| (name, stated_in))).unwrap()
    }

    #[test]
    fn files_and_folders_lie_flat_in_it() {
        let project = project();
        let files = ["include/images", "../code/nnets/", "beside.csv", "missing.txt"];
        let stage = staged(project.path(), &files).unwrap();
        for path in ["images/a.png", "nnets/n.nnet", "beside.csv"] {
            let text = fs::read_to_string(stage.path().join(path)).unwrap();
            assert!(path.ends_with(&text), "{path}");
        }
        assert!(is_stage_of(stage.path(), &project.path().join("src/../src/Main.lf")));
        assert!(!is_stage_of(stage.path(), &project.path().join("src/Other.lf")));
        let path = stage.path().to_owned();
        drop(stage);
        assert!(!path.exists());
        assert!(
            project.path().join("src/include/images/a.png").exists(),
            "a link is removed alone"
        );
    }

    #[test]
    fn what_lies_beside_the_program_needs_none() {
        let project = project();
        for files in [&["beside.csv"][..], &["./include", "missing/x"], &[]] {
            assert!(staged(project.path(), files).is_none(), "{files:?}");
        }
    }

    #[test]
    fn what_a_dead_process_has_left_is_removed_and_what_is_in_use_stays() {
        let folder = tempfile::tempdir().unwrap();
        let used = Stage::empty(folder.path()).unwrap();
        let (dead, young) =
            (folder.path().join("hprm-stage-1-0"), folder.path().join("hprm-stage-2-0"));
        fs::create_dir(&dead).unwrap();
        fs::create_dir(&young).unwrap();
        let long_ago = SystemTime::now() - 2 * UNLOCKED;
        for path in [used.path(), &dead] {
            File::open(path).unwrap().set_modified(long_ago).unwrap();
        }
        remove_abandoned(folder.path());
        assert!(used.path().exists() && young.exists());
        assert!(!dead.exists());
    }
}
