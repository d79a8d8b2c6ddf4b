//! The secret of a federation: given, read from a file, or chosen.
//!
//! A process that knows it can join. So it is kept where only its owner can read it: in the environment of processes,
//! or in a file with the permissions 600.

use std::fs::OpenOptions;
use std::io::{self, ErrorKind, Read, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::Path;
use std::time::{Duration, Instant};

use hprm::{FederationId, random_federation};

use crate::args::Secret;
use crate::message::{self, Error};

/// More is not a secret of this kind, whatever it is.
const LONGEST: u64 = 64;

/// How often to look whether the file is there.
const LOOKING: Duration = Duration::from_millis(20);

/// The secret, if one is given. A file that is missing is made.
///
/// # Errors
///
/// If the file is no secret, or a secret no more.
pub(crate) fn of_rti(secret: &Secret) -> Result<Option<FederationId>, Error> {
    match &secret.federation_file {
        Some(path) if !path.exists() => make(path).map(Some),
        Some(path) => read(path).map(Some),
        None => Ok(secret.federation),
    }
}

/// Whether [`of_federate`] would wait for the file with the secret.
pub(crate) fn is_awaited(secret: &Secret) -> bool {
    secret.federation_file.as_ref().is_some_and(|path| !path.exists())
}

/// The secret of a federation that another process has started, or starts within `timeout`: until then
/// the file may be missing. Returns what is left of that time, too.
///
/// # Errors
///
/// If none is given, or as [`of_rti`].
pub(crate) fn of_federate(
    secret: &Secret,
    timeout: Duration,
) -> Result<(FederationId, Duration), Error> {
    let since = Instant::now();
    let left = || timeout.saturating_sub(since.elapsed());
    let pause = || {
        std::thread::sleep(LOOKING.min(left()));
        !left().is_zero()
    };
    let read = secret.federation_file.as_deref().map(|path| await_file(path, pause)).transpose()?;
    let secret = read.or(secret.federation).ok_or_else(|| {
        Error::option("the secret of the federation is missing")
            .hint("name the file with it, --federation-file FILE, or set HPRM_FEDERATION_ID")
    })?;
    Ok((secret, left()))
}

/// Reads the file once it is there, or once `pause` says that it has been waited for long enough.
fn await_file(path: &Path, mut pause: impl FnMut() -> bool) -> Result<FederationId, Error> {
    if !path.exists() {
        let line = format!("waiting for the RTI, which makes the file {}\n", path.display());
        message::print_error(line.as_bytes());
    }
    while !path.exists() && pause() {}
    let missing = !path.exists();
    read(path).map_err(|error| match missing {
        true => error.hint(
            "`hprm rti --federation-file FILE` makes it; on another machine, it is a copy of that file",
        ),
        false => error,
    })
}

fn read(path: &Path) -> Result<FederationId, Error> {
    let failed = |error: io::Error| {
        Error::option(format!("cannot read {}: {}", path.display(), message::reason(&error)))
    };
    let file = std::fs::File::open(path).map_err(failed)?;
    let metadata = file.metadata().map_err(failed)?;
    if !metadata.is_file() {
        let what = if metadata.is_dir() { "a directory" } else { "not a file" };
        return Err(Error::option(format!(
            "--federation-file {}: that is {what}, where a file with the secret should be",
            path.display()
        ))
        .hint("name a file; the RTI makes it if it is missing"));
    }
    if metadata.mode() & 0o077 != 0 || metadata.uid() != rustix::process::geteuid().as_raw() {
        let path = path.display();
        return Err(Error::option(format!("others can read the secret in {path}, or own it"))
            .hint(format!(
                "chmod 600 {path}, if no other user has read it; else choose another one"
            )));
    }
    let mut text = String::new();
    file.take(LONGEST).read_to_string(&mut text).map_err(failed)?;
    text.trim().parse().map_err(|error| {
        Error::option(format!("{}: {error}", path.display()))
            .hint("the file has the secret alone, 32 hexadecimal digits; the RTI makes one if it is missing")
    })
}

/// Makes the file, unless another process makes it first.
fn make(path: &Path) -> Result<FederationId, Error> {
    write(path).or_else(|error| if path.exists() { read(path) } else { Err(error) })
}

/// Makes the file, which is whole as soon as it is there.
fn write(path: &Path) -> Result<FederationId, Error> {
    let secret = random_federation()?;
    let mut name = path.as_os_str().to_owned();
    name.push(format!(".{}", std::process::id()));
    let draft = Path::new(&name);
    let written = OpenOptions::new()
        .write(true)
        .create_new(true)
        .mode(0o600)
        .open(draft)
        .and_then(|mut file| writeln!(file, "{secret}"))
        .and_then(|()| put(draft, path));
    // There may be none.
    let _ = std::fs::remove_file(draft);
    written.map_err(|error| {
        Error::option(format!("cannot write {}: {}", path.display(), message::reason(&error)))
            .hint("--federation-file names a file in a folder that you may write to")
    })?;
    Ok(secret)
}

/// Gives the draft its name, unless another process has made such a file meanwhile.
fn put(draft: &Path, path: &Path) -> io::Result<()> {
    // Unlike a rename, a link does not replace a file.
    std::fs::hard_link(draft, path).or_else(|error| match error.kind() {
        // Some file systems know no links.
        ErrorKind::PermissionDenied | ErrorKind::Unsupported if !path.exists() => {
            std::fs::rename(draft, path)
        }
        _ => Err(error),
    })
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    fn in_file(path: &Path) -> Secret {
        Secret { federation: None, federation_file: Some(path.to_owned()) }
    }

    #[test]
    fn the_rti_makes_the_file_and_federates_read_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("secret");
        assert!(of_federate(&in_file(&path), Duration::ZERO).is_err());
        let secret = of_rti(&in_file(&path)).unwrap();
        assert_eq!(path.metadata().unwrap().mode() & 0o777, 0o600);
        assert_eq!(Some(of_federate(&in_file(&path), Duration::ZERO).unwrap().0), secret);
        assert_eq!(of_rti(&in_file(&path)).unwrap(), secret);
    }

    #[test]
    fn a_file_that_others_read_is_no_secret() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("secret");
        of_rti(&in_file(&path)).unwrap();
        for mode in [0o640, 0o604, 0o660] {
            std::fs::set_permissions(&path, std::fs::Permissions::from_mode(mode)).unwrap();
            assert!(of_rti(&in_file(&path)).is_err(), "{mode:o}");
        }
    }

    #[test]
    fn a_file_with_something_else_is_not_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("secret");
        of_rti(&in_file(&path)).unwrap();
        for text in ["", "12", &"a".repeat(80)] {
            std::fs::write(&path, text).unwrap();
            assert!(of_federate(&in_file(&path), Duration::ZERO).is_err(), "{text}");
        }
    }

    #[test]
    fn a_federate_without_a_secret_is_refused() {
        let secret = Secret { federation: None, federation_file: None };
        assert!(of_federate(&secret, Duration::ZERO).is_err());
    }

    #[test]
    fn a_federate_waits_for_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("secret");
        let mut made = None;
        let waited = await_file(&path, || {
            made = of_rti(&in_file(&path)).unwrap();
            true
        });
        assert_eq!(Some(waited.unwrap()), made);
        assert!(await_file(&folder.path().join("other"), || false).is_err());
    }

    #[test]
    fn of_two_that_make_it_at_once_one_takes_the_others() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("secret");
        let first = make(&path).unwrap();
        assert_eq!(make(&path).unwrap(), first);
    }

    #[test]
    fn the_first_reason_is_told() {
        // Neither this user nor root may make a file there.
        let error = format!("{:?}", write(Path::new("/sys/secret")).unwrap_err());
        assert!(error.contains("cannot write /sys/secret: "), "{error}");
        assert!(!error.contains("No such file"), "{error}");
    }

    #[test]
    fn what_is_there_already_is_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("secret");
        std::fs::write(&path, "").unwrap();
        assert!(write(&path).is_err());
        assert_eq!(std::fs::read(&path).unwrap(), b"");
        // Nothing is left beside it, either.
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
