//! The shares that federates write of one trace: a folder beside the trace while the run lasts.

use std::fs::{self, File};
use std::io::BufReader;
use std::path::{Path, PathBuf};

use hprm_core::Program;

use super::merge::merge;
use super::{Draft, Reader, TraceShare};
use crate::{Failure, Label, Report};

/// The folder with the shares. It is gone when this is.
#[derive(Debug)]
pub struct Parts {
    /// What the trace will be called.
    path: PathBuf,
    folder: PathBuf,
    /// Whether the folder is beside the trace.
    is_beside: bool,
}

impl Parts {
    /// Makes room for the shares of a trace that will be called `path`.
    ///
    /// # Errors
    ///
    /// If the folder cannot be made.
    pub fn of(path: &Path) -> Result<Self, Failure> {
        let unwritten = |error| Failure::trace(path, &error);
        let is_beside = Draft::replaces(path).map_err(unwritten)?;
        let folder = if is_beside {
            remove_abandoned(path);
            beside(path, std::process::id())
        } else {
            // Beside a device or a link is no place for files.
            beside(&std::env::temp_dir().join("hprm-trace"), std::process::id())
        };
        fs::create_dir(&folder).map_err(unwritten)?;
        // Federates may run elsewhere in the file system.
        let folder = folder.canonicalize().unwrap_or(folder);
        Ok(Self { path: path.to_owned(), folder, is_beside })
    }

    /// What a federate writes.
    #[must_use]
    pub fn share(&self, federate: &str) -> TraceShare {
        self.share_at(self.folder.join(federate))
    }

    /// What a process writes that has several federates: the shares of all, each in a file with the name of
    /// its federate.
    #[must_use]
    pub fn shares(&self) -> TraceShare {
        self.share_at(self.folder.clone())
    }

    /// A failure names the trace, unless the shares are elsewhere: then the place matters.
    fn share_at(&self, place: PathBuf) -> TraceShare {
        TraceShare::new(place, self.is_beside.then(|| self.path.clone()))
    }

    /// Makes one trace of the shares. If the run has failed, with an exit `code` and a report, that is what
    /// the user should see first: then `tell` only gets a warning that there is no trace.
    ///
    /// # Errors
    ///
    /// If a share cannot be read, or the trace cannot be written.
    pub fn merge(
        self,
        program: &Program,
        interrupted: bool,
        code: i32,
        tell: &mut dyn FnMut(Label, Report),
    ) -> Result<(), Failure> {
        if !self.folder.exists() {
            // The federates could not write their shares, and have said why.
            return Ok(());
        }
        match self.merge_shares(program, interrupted) {
            Err(failure) if code != 0 => {
                tell(Label::Warning, failure.report());
                Ok(())
            }
            outcome => outcome,
        }
    }

    fn merge_shares(&self, program: &Program, interrupted: bool) -> Result<(), Failure> {
        let mut shares = Vec::new();
        let mut missing = None;
        for federate in program.federates.values() {
            match self.open(&federate.name) {
                Some(share) => shares.push(share?),
                None => missing = Some(federate.name.as_str()),
            }
        }
        merge(program, shares, missing, interrupted, &self.path)
    }

    /// What a federate has left: all of its share, or what it had written when it ended.
    fn open(&self, federate: &str) -> Option<Result<Reader<BufReader<File>>, Failure>> {
        let whole = self.folder.join(federate);
        let partial = whole.with_file_name(format!("{federate}.partial"));
        let path = [whole, partial].into_iter().find(|path| path.exists())?;
        let empty = path.metadata().is_ok_and(|file| file.len() == 0);
        (!empty).then(|| Reader::open(&path))
    }
}

impl Drop for Parts {
    fn drop(&mut self) {
        // If that fails, what is left tells where it is.
        let _ = fs::remove_dir_all(&self.folder);
    }
}

/// The folder of the process `pid` with the shares of the trace `path`.
fn beside(path: &Path, pid: u32) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(format!(".parts-{pid}"));
    PathBuf::from(name)
}

/// Removes folders of processes that were killed before they could do that.
fn remove_abandoned(path: &Path) {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let Ok(entries) = fs::read_dir(folder.unwrap_or(Path::new("."))) else { return };
    for name in entries.flatten().map(|entry| entry.file_name()) {
        let pid = name.to_str().and_then(|name| name.rsplit_once(".parts-")?.1.parse().ok());
        let dead = |pid: &u32| !Path::new("/proc").join(pid.to_string()).exists();
        if let Some(pid) = pid.filter(dead)
            && beside(path, pid).file_name() == Some(&name)
        {
            // It is not needed; if it cannot be removed, it is left.
            let _ = fs::remove_dir_all(beside(path, pid));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_of_dead_processes_are_removed() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("a.trace");
        // No process has so high a number.
        let dead = beside(&path, u32::MAX);
        let other = beside(&place.path().join("b.trace"), u32::MAX);
        let living = beside(&path, 1);
        for folder in [&dead, &other, &living] {
            fs::create_dir(folder).unwrap();
            fs::write(folder.join("camera.partial"), "").unwrap();
        }
        let parts = Parts::of(&path).unwrap();
        assert!(!dead.exists() && other.exists() && living.exists());
        drop(parts);
        assert_eq!(fs::read_dir(place.path()).unwrap().count(), 2);
    }

    #[test]
    fn a_folder_cannot_be_a_trace() {
        let place = tempfile::tempdir().unwrap();
        let error = format!("{:?}", Parts::of(place.path()).unwrap_err());
        assert!(error.contains(&format!("{}: is a directory", place.path().display())), "{error}");
    }
}
