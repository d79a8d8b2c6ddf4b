//! Which federates may send pickles to which: `HPRM_PICKLE`.
//!
//! A process that reads a pickle runs any code that the sender has put into it. A process of the same user on
//! the same machine could run that code anyway; another machine could not. The host decides what a pickle is,
//! and what needs none.

use std::ffi::OsStr;

use crate::variables;

/// What `HPRM_PICKLE` says.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub enum Pickling {
    /// No federate may.
    Deny,
    /// Federates of one user on one machine may.
    #[default]
    Local,
    /// All members of the federation may.
    Allow,
}

impl Pickling {
    /// The name of the environment variable.
    pub const NAME: &'static str = "HPRM_PICKLE";

    /// What the variable says, if it is set.
    ///
    /// # Errors
    ///
    /// A message, if it says something that is not known.
    pub fn of(variable: Option<&OsStr>) -> Result<Self, String> {
        let Some(text) = variable.filter(|text| !text.is_empty()) else {
            return Ok(Self::default());
        };
        match text.to_str() {
            Some("deny") => Ok(Self::Deny),
            Some("local") => Ok(Self::Local),
            Some("allow") => Ok(Self::Allow),
            _ => Err(variables::wrong(Self::NAME, text, "not `deny`, `local` or `allow`")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unset_or_empty_is_local() {
        let of = |text: &str| Pickling::of(Some(OsStr::new(text)));
        assert_eq!(Pickling::of(None), Ok(Pickling::Local));
        assert_eq!(of(""), Ok(Pickling::Local));
        assert_eq!(of("local"), Ok(Pickling::Local));
        assert_eq!(of("deny"), Ok(Pickling::Deny));
        assert_eq!(of("allow"), Ok(Pickling::Allow));
        for text in ["ALLOW", "yes", "1", " allow"] {
            assert!(of(text).unwrap_err().contains("`deny`, `local` or `allow`"), "{text}");
        }
    }
}
