//! Values as a trace knows them: a digest for machines, and a short text for people.

use std::fmt;
use std::str::FromStr;

use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use twox_hash::XxHash3_128;

/// 128 bits that stand for a value: two values with equal digests are taken for equal.
///
/// It is the hash XXH3, which is quick and not meant to resist a search for collisions.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Digest(pub u128);

/// Computes a [`Digest`] of bytes that come in pieces.
#[derive(Clone)]
pub struct Digester(XxHash3_128);

/// A value in a trace.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct Described {
    /// Equal for equal values, in every process and on every machine.
    pub digest: Digest,
    /// A short hint for people; two different values may have the same.
    pub text: String,
    /// Whether something in the value could not be looked into: then the digest covers its type.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub opaque: bool,
}

impl Described {
    /// A value that is opaque.
    #[must_use]
    pub fn opaque(name: &str) -> Self {
        let mut digester = Digester::new();
        digester.write(name.as_bytes());
        Self { digest: digester.finish(), text: name.to_owned(), opaque: true }
    }
}

impl Digest {
    /// The digest of a value of that kind, as its bytes tell it.
    #[must_use]
    pub fn of_bytes(kind: &str, bytes: &[u8]) -> Self {
        let mut digester = Digester::of_kind(kind);
        digester.write(bytes);
        digester.finish()
    }
}

impl Digester {
    /// The digest of a value of that kind begins so; what tells the value follows.
    #[must_use]
    pub fn of_kind(kind: &str) -> Self {
        let mut digester = Self::new();
        digester.write(kind.as_bytes());
        digester.write(&[0]);
        digester
    }

    /// Nothing so far.
    #[must_use]
    pub fn new() -> Self {
        Self(XxHash3_128::new())
    }

    /// Adds bytes. How they are cut into pieces does not matter.
    pub fn write(&mut self, bytes: &[u8]) {
        self.0.write(bytes);
    }

    /// The digest of all bytes so far.
    #[must_use]
    pub fn finish(&self) -> Digest {
        Digest(self.0.finish_128())
    }
}

impl Default for Digester {
    fn default() -> Self {
        Self::new()
    }
}

impl fmt::Debug for Digester {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Digester").field(&self.finish()).finish()
    }
}

impl fmt::Display for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:032x}", self.0)
    }
}

impl fmt::Debug for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// A text that is no digest.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
#[error("a digest has 32 hexadecimal digits")]
pub struct BadDigest;

impl FromStr for Digest {
    type Err = BadDigest;

    fn from_str(text: &str) -> Result<Self, BadDigest> {
        let is_hex = text.len() == 32 && text.bytes().all(|byte| byte.is_ascii_hexdigit());
        let digits = is_hex.then_some(text).ok_or(BadDigest)?;
        u128::from_str_radix(digits, 16).map(Self).map_err(|_| BadDigest)
    }
}

impl Serialize for Digest {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Digest {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = std::borrow::Cow::<'de, str>::deserialize(deserializer)?;
        text.parse().map_err(D::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_digest_does_not_depend_on_the_pieces() {
        let bytes: Vec<u8> = (0..=255).cycle().take(10_000).collect();
        let digest = |piece| {
            let mut digester = Digester::new();
            bytes.chunks(piece).for_each(|chunk| digester.write(chunk));
            digester.finish()
        };
        assert_eq!(digest(1), digest(10_000));
        assert_ne!(digest(1), Digester::new().finish());
    }

    /// Traces are kept and compared later: the hash must stay the one that it is.
    #[test]
    fn the_hash_is_xxh3_of_128_bits() {
        assert_eq!(Digester::new().finish().to_string(), "99aa06d3014798d86001c324468d497f");
    }

    #[test]
    fn a_digest_is_read_as_it_is_written() {
        let digest = Digest(0x0123_4567_89ab_cdef);
        assert_eq!(digest.to_string().parse(), Ok(digest));
        for bad in ["", "12", "+0000000000000000123456789abcdef"] {
            assert_eq!(bad.parse::<Digest>(), Err(BadDigest), "{bad}");
        }
    }
}
