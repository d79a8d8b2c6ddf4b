//! Where credentials are kept, and who may read them.
//!
//! ```text
//! ~/.config/hprm/agent/       machine.pem, machine.key, authority.pem, roster.json: those of this machine
//! ~/.config/hprm/authority/   authority.pem, authority.key, roster.json: those of an authority
//! ```
//!
//! In both folders, `certificates.pem` has the certificates of all machines, as far as they are known.
//!
//! Keys are made here and stay here. A file is complete or it is not there; one with a key can be read by its user alone.

use std::fs::{self, DirBuilder, File};
use std::io::{self, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use rustix::fs::{FlockOperation, flock};

use crate::Failure;

/// The most bytes of a file of credentials: the certificates of all machines are the longest.
const LIMIT: u64 = 4 << 20;
const _: () = assert!(LIMIT > super::bundle::LIMIT as u64);

/// The folder of that name of this user.
pub(super) fn folder(name: &str) -> Result<PathBuf, Failure> {
    let named = |name| std::env::var_os(name).map(PathBuf::from).filter(|it| it.is_absolute());
    let config = named("XDG_CONFIG_HOME").or_else(|| Some(named("HOME")?.join(".config")));
    let config = config.ok_or_else(|| {
        Failure::new("there is no folder for credentials").hint("HOME or XDG_CONFIG_HOME names it")
    })?;
    Ok(config.join("hprm").join(name))
}

/// Makes a folder that no other user can look into.
pub(super) fn make(folder: &Path) -> Result<(), Failure> {
    let made = DirBuilder::new().recursive(true).mode(0o700).create(folder);
    made.map_err(|error| failed("make", folder, &error))
}

/// Has a folder for itself, until the result is dropped.
pub(super) fn lock(folder: &Path) -> Result<File, Failure> {
    let locked = File::open(folder).and_then(|file| {
        flock(&file, FlockOperation::LockExclusive)?;
        Ok(file)
    });
    locked.map_err(|error| failed("lock", folder, &error))
}

/// Writes a file that is complete or not there. Only its user can read it.
pub(super) fn write(path: &Path, text: &[u8]) -> Result<(), Failure> {
    let draft = path.with_extension("new");
    let written = (|| {
        // What a process has left that was killed.
        remove(&draft)?;
        let mut file = File::options().write(true).create_new(true).mode(0o600).open(&draft)?;
        file.write_all(text)?;
        file.sync_all()?;
        fs::rename(&draft, path)
    })();
    written.map_err(|error| {
        // The error says more than this one.
        let _ = fs::remove_file(&draft);
        failed("write", path, &error)
    })
}

fn remove(path: &Path) -> io::Result<()> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}

/// That what is in a file is of no use.
pub(super) fn unusable(path: &Path, why: &str) -> Failure {
    Failure::new(format!("cannot use {}: {why}", path.display()))
}

/// Reads a file.
pub(super) fn read(path: &Path) -> Result<String, Failure> {
    use std::io::Read;
    let mut text = String::new();
    let read = File::open(path).and_then(|file| file.take(LIMIT).read_to_string(&mut text));
    read.map_err(|error| failed("read", path, &error))?;
    Ok(text)
}

/// Refuses a key that others can read, or that is not this user's.
pub(super) fn check_key(path: &Path) -> Result<(), Failure> {
    let found = fs::metadata(path).map_err(|error| failed("read", path, &error))?;
    if found.mode() & 0o077 != 0 {
        let text = format!("others can read the key in {}", path.display());
        return Err(Failure::new(text).hint(format!("chmod 600 {}", path.display())));
    }
    if found.uid() != rustix::process::geteuid().as_raw() {
        return Err(Failure::new(format!("the key in {} is another user's", path.display())));
    }
    Ok(())
}

fn failed(what: &str, path: &Path, error: &io::Error) -> Failure {
    Failure::new(format!("cannot {what} {}: {error}", path.display()))
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    #[test]
    fn files_are_their_user_s_alone_and_keys_that_others_can_read_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let inner = folder.path().join("a/b");
        make(&inner).unwrap();
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o777;
        assert_eq!(mode(&inner), 0o700);
        let path = inner.join("machine.key");
        fs::write(inner.join("machine.new"), "left").unwrap();
        for text in ["one", "two"] {
            write(&path, text.as_bytes()).unwrap();
            assert_eq!((read(&path).unwrap().as_str(), mode(&path)), (text, 0o600));
        }
        check_key(&path).unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o640)).unwrap();
        assert!(check_key(&path).unwrap_err().to_string().contains("others can read the key"));
        assert_eq!(fs::read_dir(&inner).unwrap().count(), 1);
    }
}
