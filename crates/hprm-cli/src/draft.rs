//! Files that are whole as soon as they are there: each is written under another name, and renamed.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Has `write` make a file, and puts it into its place; what was there before is gone. A link stays, and leads to the new
/// file; a device is written to.
///
/// # Errors
///
/// If that fails; the place is as it was then, and nothing else is left.
pub(crate) fn replace(path: &Path, write: impl FnOnce(&Path) -> io::Result<()>) -> io::Result<()> {
    if path.metadata().is_ok_and(|there| !there.is_file() && !there.is_dir()) {
        return write(path);
    }
    let behind_link = path.is_symlink().then(|| path.canonicalize().ok()).flatten();
    let path = behind_link.as_deref().unwrap_or(path);
    let mut draft = path.as_os_str().to_owned();
    draft.push(format!(".{}", std::process::id()));
    let draft = PathBuf::from(draft);
    let written = write(&draft).and_then(|()| fs::rename(&draft, path));
    if written.is_err() {
        // The error that is told is the first one.
        let _ = fs::remove_file(&draft);
    }
    written
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_replaced_when_it_is_whole_and_a_failure_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        replace(&path, |draft| fs::write(draft, "one")).unwrap();
        let failed =
            replace(&path, |draft| fs::write(draft, "t").and(Err(io::Error::other("full"))));
        assert_eq!(failed.unwrap_err().to_string(), "full");
        assert_eq!(fs::read_to_string(&path).unwrap(), "one");
        replace(&path, |draft| fs::write(draft, "two")).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "two");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
        let link = folder.path().join("link");
        std::os::unix::fs::symlink(&path, &link).unwrap();
        replace(&link, |draft| fs::write(draft, "three")).unwrap();
        assert!(link.is_symlink());
        assert_eq!(fs::read_to_string(&path).unwrap(), "three");
    }
}
