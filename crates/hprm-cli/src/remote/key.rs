//! Fleet keys: a user with one may start programs on machines whose agents know it.
//!
//! A stand-in and a starter each prove to the other that they have the key, by an HMAC of what both have drawn, so that
//! neither sends the key, nor anything else before the proof. What follows is protected by the links between agents.
//!
//! A file of keys has one a line, 32 hexadecimal digits, and behind it what its owner is called. A file with one key is
//! such a file, too.

use std::fs::File;
use std::io::Read;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::Path;

use hmac::{Hmac, Mac};
use hprm::{FederationId, random_bytes};
use sha2::Sha256;

use super::protocol::{Nonce, Proof};
use crate::message::{self, Error};

/// The most bytes of a file of keys.
const FILE_LIMIT: u64 = 1 << 20;

/// Which side a proof is from: no proof of one side is one of the other.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Side {
    StandIn,
    Starter,
}

/// What both sides know that a proof is about.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct Occasion<'a> {
    /// The machine on which something is to be started.
    pub(super) machine: &'a str,
    /// What the starter has drawn, and what the stand-in.
    pub(super) nonces: [Nonce; 2],
}

/// A key, and what its owner is called.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct Key {
    secret: FederationId,
    pub(super) owner: String,
}

impl Key {
    pub(super) fn prove(&self, side: Side, occasion: &Occasion<'_>) -> Proof {
        self.mac(side, occasion).finalize().into_bytes().into()
    }

    pub(super) fn is_proved(&self, side: Side, occasion: &Occasion<'_>, proof: &Proof) -> bool {
        self.mac(side, occasion).verify_slice(proof).is_ok()
    }

    fn mac(&self, side: Side, occasion: &Occasion<'_>) -> Hmac<Sha256> {
        let key = self.secret.0.to_be_bytes();
        let mut mac = Hmac::<Sha256>::new_from_slice(&key).expect("a key of any length will do");
        mac.update(match side {
            Side::StandIn => b"hprm fleet 1 stand-in\0",
            Side::Starter => b"hprm fleet 1 starter\0\0",
        });
        occasion.nonces.iter().for_each(|nonce| mac.update(nonce));
        // Last, because its length is not fixed.
        mac.update(occasion.machine.as_bytes());
        mac
    }
}

/// A number that is used once.
///
/// # Errors
///
/// If the system has no random numbers.
pub(super) fn nonce() -> Result<Nonce, Error> {
    let mut nonce = Nonce::default();
    for chunk in nonce.chunks_exact_mut(8) {
        chunk.copy_from_slice(&random_bytes::<8>()?);
    }
    Ok(nonce)
}

/// The keys of a file, which only its owner may read.
///
/// # Errors
///
/// If others can read it, or it has no keys.
pub(super) fn read(path: &Path) -> Result<Vec<Key>, Error> {
    let shown = path.display();
    let failed = |error: std::io::Error| {
        Error::option(format!("cannot read fleet keys in {shown}: {}", message::reason(&error)))
    };
    // If it is a pipe, it does not block.
    let mut options = File::options();
    let file = options.read(true).custom_flags(libc_nonblock()).open(path).map_err(failed)?;
    let metadata = file.metadata().map_err(failed)?;
    if !metadata.is_file() {
        return Err(Error::option(format!("{shown} is not a file with fleet keys")));
    }
    if metadata.mode() & 0o077 != 0 || metadata.uid() != rustix::process::geteuid().as_raw() {
        return Err(Error::option(format!("others can read the fleet keys in {shown}, or own it"))
            .hint(format!(
                "chmod 600 {shown}, if no other user has read it; else make other keys"
            )));
    }
    let mut text = String::new();
    file.take(FILE_LIMIT).read_to_string(&mut text).map_err(failed)?;
    let lines = text.lines().map(str::trim).enumerate();
    let lines = lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    let keys = lines.map(|(number, line)| {
        let (digits, owner) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let secret = digits.parse().map_err(|_| {
            Error::option(format!("{shown}, line {}: that is no fleet key", number + 1)).hint(
                "a line has a key, 32 hexadecimal digits, and behind it the name of its owner",
            )
        })?;
        Ok(Key { secret, owner: owner.trim().to_owned() })
    });
    let keys = keys.collect::<Result<Vec<_>, Error>>()?;
    match keys.is_empty() {
        true => Err(Error::option(format!("{shown} has no fleet keys"))),
        false => Ok(keys),
    }
}

fn libc_nonblock() -> i32 {
    i32::try_from(rustix::fs::OFlags::NONBLOCK.bits()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    #[test]
    fn a_proof_is_for_one_side_one_occasion_and_one_key() {
        let key = |number| Key { secret: FederationId(number), owner: String::new() };
        let occasion = Occasion { machine: "robot1", nonces: [[1; 32], [2; 32]] };
        let proof = key(1).prove(Side::StandIn, &occasion);
        assert!(key(1).is_proved(Side::StandIn, &occasion, &proof));
        assert!(!key(1).is_proved(Side::Starter, &occasion, &proof));
        assert!(!key(2).is_proved(Side::StandIn, &occasion, &proof));
        for other in [
            Occasion { machine: "robot2", ..occasion.clone() },
            Occasion { nonces: [[1; 32], [3; 32]], ..occasion.clone() },
            Occasion { nonces: [[2; 32], [1; 32]], ..occasion },
        ] {
            assert!(!key(1).is_proved(Side::StandIn, &other, &proof));
        }
    }

    #[test]
    fn a_file_has_a_key_a_line_that_only_its_owner_may_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("keys");
        let digits = "0123456789abcdef0123456789abcdef";
        fs::write(&path, digits).unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).unwrap();
        assert_eq!(read(&path).unwrap().len(), 1);
        fs::write(&path, format!("# ours\n{digits} ada\n\n{digits}\tbo b\n")).unwrap();
        let owners: Vec<_> = read(&path).unwrap().into_iter().map(|key| key.owner).collect();
        assert_eq!(owners, ["ada", "bo b"]);
        for wrong in ["", "# none\n", "abc\n", "0123456789abcdef0123456789abcdeg\n"] {
            fs::write(&path, wrong).unwrap();
            assert!(read(&path).is_err(), "{wrong}");
        }
        fs::set_permissions(&path, fs::Permissions::from_mode(0o640)).unwrap();
        assert!(format!("{:?}", read(&path)).contains("others can read"));
        assert!(read(folder.path()).is_err());
    }
}
