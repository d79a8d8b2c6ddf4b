//! The options of a program, or of its user, for the object stores of its federates.
//!
//! The command line, the processes that it starts and the front end read the same words. The store and
//! its driver obey them.

use serde::{Deserialize, Serialize};

/// What a federate does with a large value when its object store has no room for it.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Default, Serialize, Deserialize)]
pub enum WhenFull {
    /// The value travels inside its message, which costs copies and loses nothing.
    #[default]
    Inline,
    /// The federation fails, with an error.
    Error,
}

impl WhenFull {
    /// Reads `inline` or `error`.
    #[must_use]
    pub fn read(text: &str) -> Option<Self> {
        match text.to_ascii_lowercase().as_str() {
            "inline" => Some(Self::Inline),
            "error" => Some(Self::Error),
            _ => None,
        }
    }

    /// The word that [`Self::read`] reads.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Inline => "inline",
            Self::Error => "error",
        }
    }
}

/// The options for object stores.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Default, Serialize, Deserialize)]
pub struct StoreOptions {
    /// The most bytes of one federate's store, if that is given.
    pub limit: Option<u64>,
    /// What happens beyond it.
    pub when_full: WhenFull,
}

/// The units of a size, longest names first, in bytes.
const UNITS: [(&str, u64); 9] = [
    ("kib", 1 << 10),
    ("mib", 1 << 20),
    ("gib", 1 << 30),
    ("tib", 1 << 40),
    ("kb", 1_000),
    ("mb", 1_000_000),
    ("gb", 1_000_000_000),
    ("tb", 1_000_000_000_000),
    ("b", 1),
];

/// Reads a size in bytes: `2 GB`, `512MiB` or a whole number of bytes.
#[must_use]
pub fn read_size(text: &str) -> Option<u64> {
    let text = text.trim().to_ascii_lowercase();
    let unit = UNITS.iter().find_map(|(name, unit)| Some((text.strip_suffix(name)?, *unit)));
    let (number, unit) = unit.unwrap_or((&text, 1));
    let number = number.trim_end();
    // `parse` would take a sign as well.
    let digits = number.bytes().all(|byte| byte.is_ascii_digit());
    digits.then(|| number.parse::<u64>().ok()?.checked_mul(unit)).flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_whole_numbers_with_a_unit() {
        for (text, bytes) in [
            ("0", 0),
            ("17", 17),
            ("17 B", 17),
            ("64 KB", 64_000),
            ("64kib", 65_536),
            (" 2 GB ", 2_000_000_000),
            ("2GiB", 2 << 30),
            ("1 TB", 1_000_000_000_000),
        ] {
            assert_eq!(read_size(text), Some(bytes), "{text}");
        }
        let wrong = ["", "GB", "-1", "+1 GB", "1.5 GB", "2 parsec", "1 G B", "99999999999 TB"];
        for text in wrong {
            assert_eq!(read_size(text), None, "{text}");
        }
    }

    #[test]
    fn every_policy_has_a_word() {
        for policy in [WhenFull::Inline, WhenFull::Error] {
            assert_eq!(WhenFull::read(policy.word()), Some(policy));
        }
        assert_eq!(WhenFull::read("Error"), Some(WhenFull::Error));
        assert_eq!(WhenFull::read("explode"), None);
    }
}
