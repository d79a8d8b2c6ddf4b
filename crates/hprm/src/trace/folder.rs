//! A folder beside a trace for what processes write of it, while the run lasts.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

use super::Draft;
use crate::Failure;

/// What comes between the name of a trace and the number of a process in the name of a folder.
const PARTS: &str = ".parts-";

/// The folder. It is gone when this is.
#[derive(Debug)]
pub(crate) struct Folder {
    path: PathBuf,
    /// Whether it is beside the trace.
    is_beside: bool,
}

impl Folder {
    /// Makes the folder of a trace that will be called `path`.
    ///
    /// # Errors
    ///
    /// If it cannot be made.
    pub(crate) fn of(path: &Path) -> Result<Self, Failure> {
        let unwritten = |error| Failure::trace(path, &error);
        let is_beside = Draft::replaces(path).map_err(unwritten)?;
        let folder = if is_beside {
            if let Some(name) = path.file_name().and_then(OsStr::to_str) {
                let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
                remove_abandoned(folder.unwrap_or(Path::new(".")), &format!("{name}{PARTS}"));
            }
            beside(path, std::process::id())
        } else {
            // Beside a device or a link is no place for files.
            beside(&std::env::temp_dir().join("hprm-trace"), std::process::id())
        };
        fs::create_dir(&folder).map_err(unwritten)?;
        // Federates may run elsewhere in the file system.
        Ok(Self { path: folder.canonicalize().unwrap_or(folder), is_beside })
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Whether it is beside the trace.
    pub(crate) fn is_beside(&self) -> bool {
        self.is_beside
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // If that fails, what is left tells where it is.
        let _ = fs::remove_dir_all(&self.path);
    }
}

/// The folder of the process `pid` with the shares of the trace `path`.
fn beside(path: &Path, pid: u32) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(format!("{PARTS}{pid}"));
    PathBuf::from(name)
}

/// Removes the folders of traces in `folder` of processes that were killed before they could do that: those whose names
/// are `prefix` and the number of a process.
pub fn remove_abandoned(folder: &Path, prefix: &str) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for name in entries.flatten().map(|entry| entry.file_name()) {
        let pid = name.to_str().and_then(|name| name.strip_prefix(prefix)?.parse::<u32>().ok());
        let is_dead = |pid: &u32| !Path::new("/proc").join(pid.to_string()).exists();
        if let Some(pid) = pid.filter(is_dead) {
            // It is not needed; if it cannot be removed, it is left.
            let _ = fs::remove_dir_all(folder.join(format!("{prefix}{pid}")));
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
        let folder = Folder::of(&path).unwrap();
        assert!(!dead.exists() && other.exists() && living.exists());
        drop(folder);
        assert_eq!(fs::read_dir(place.path()).unwrap().count(), 2);
    }

    #[test]
    fn a_folder_cannot_be_a_trace() {
        let place = tempfile::tempdir().unwrap();
        let error = format!("{:?}", Folder::of(place.path()).unwrap_err());
        assert!(error.contains(&format!("{}: is a directory", place.path().display())), "{error}");
    }
}
