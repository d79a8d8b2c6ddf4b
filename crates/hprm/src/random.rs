//! Random numbers for what other processes must not guess: secrets, and names.

use std::io;

use hprm_federated::FederationId;
use rustix::rand::{GetRandomFlags, getrandom};

use crate::Failure;

/// A random secret for a federation.
///
/// # Errors
///
/// If the system has no randomness.
pub fn random_federation() -> Result<FederationId, Failure> {
    random_bytes().map(|bytes| FederationId(u128::from_ne_bytes(bytes)))
}

/// A few random bytes.
///
/// # Errors
///
/// If the system has no randomness.
pub fn random_bytes<const N: usize>() -> Result<[u8; N], Failure> {
    fill().map_err(|error| Failure::command(format!("cannot get random numbers: {error}")))
}

/// The same, with the error of the system.
pub(crate) fn fill<const N: usize>() -> io::Result<[u8; N]> {
    let mut bytes = [0; N];
    // So few bytes come in one piece, once the system has any.
    let count = getrandom(&mut bytes, GetRandomFlags::empty())?;
    if count < bytes.len() {
        return Err(io::Error::other("the system has no randomness"));
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn secrets_differ() {
        assert_ne!(random_federation().unwrap(), random_federation().unwrap());
    }
}
