//! The secret of a federation: given, read from a file, or chosen.
//!
//! Who knows it can join. So it is kept where only its owner reads: in the environment of processes,
//! or in a file with the permissions 600.

use std::fs::OpenOptions;
use std::io::{self, Read, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::Path;

use hprm::federated::FederationId;

use crate::args::Secret;
use crate::message::Error;

/// More is not a secret of this kind, whatever it is.
const LONGEST: u64 = 64;

/// The secret, if one is given. A file that is missing is made.
///
/// # Errors
///
/// If the file is no secret, or a secret no more.
pub(crate) fn of_rti(secret: &Secret) -> Result<Option<FederationId>, Error> {
    match &secret.federation_file {
        Some(path) if !path.exists() => write(path).map(Some),
        Some(path) => read(path).map(Some),
        None => Ok(secret.federation),
    }
}

/// The secret of a federation that somebody else has started.
///
/// # Errors
///
/// If none is given, or as [`of_rti`].
pub(crate) fn of_federate(secret: &Secret) -> Result<FederationId, Error> {
    let read = secret.federation_file.as_deref().map(read).transpose()?;
    read.or(secret.federation).ok_or_else(|| {
        Error::new("the secret of the federation is missing")
            .hint("name the file with it, --federation-file FILE, or set HPRM_FEDERATION_ID")
    })
}

/// A secret that nobody guesses.
///
/// # Errors
///
/// If the system has no randomness.
pub(crate) fn random() -> Result<FederationId, Error> {
    random_bytes().map(|bytes| FederationId(u128::from_ne_bytes(bytes)))
}

/// Bytes that nobody guesses.
///
/// # Errors
///
/// If the system has no randomness.
pub(crate) fn random_bytes<const N: usize>() -> Result<[u8; N], Error> {
    let mut bytes = [0; N];
    std::fs::File::open("/dev/urandom")
        .and_then(|mut source| source.read_exact(&mut bytes))
        .map_err(|error| Error::new(format!("cannot read /dev/urandom: {error}")))?;
    Ok(bytes)
}

fn read(path: &Path) -> Result<FederationId, Error> {
    let failed = |error: io::Error| Error::new(format!("cannot read {}: {error}", path.display()));
    let file = std::fs::File::open(path).map_err(failed)?;
    let metadata = file.metadata().map_err(failed)?;
    if metadata.mode() & 0o077 != 0 || metadata.uid() != rustix::process::geteuid().as_raw() {
        let path = path.display();
        return Err(Error::new(format!("others can read the secret in {path}, or own it"))
            .hint(format!("chmod 600 {path}, if nobody else knows it; else choose another one")));
    }
    let mut text = String::new();
    file.take(LONGEST).read_to_string(&mut text).map_err(failed)?;
    text.trim().parse().map_err(|error| Error::new(format!("{}: {error}", path.display())))
}

fn write(path: &Path) -> Result<FederationId, Error> {
    let secret = random()?;
    OpenOptions::new()
        .write(true)
        .create_new(true)
        .mode(0o600)
        .open(path)
        .and_then(|mut file| writeln!(file, "{secret}"))
        .map_err(|error| Error::new(format!("cannot write {}: {error}", path.display())))?;
    Ok(secret)
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
        assert!(of_federate(&in_file(&path)).is_err());
        let secret = of_rti(&in_file(&path)).unwrap();
        assert_eq!(path.metadata().unwrap().mode() & 0o777, 0o600);
        assert_eq!(Some(of_federate(&in_file(&path)).unwrap()), secret);
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
            assert!(of_federate(&in_file(&path)).is_err(), "{text}");
        }
    }

    #[test]
    fn nobody_is_a_federate_without_a_secret() {
        assert!(of_federate(&Secret { federation: None, federation_file: None }).is_err());
    }
}
