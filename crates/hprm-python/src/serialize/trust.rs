//! Who may send pickles to whom: `HPRM_PICKLE`.
//!
//! Reading a pickle runs what its sender likes. A process of the same user on the same machine could
//! do so anyway; another machine could not.

use std::env;

const NAME: &str = "HPRM_PICKLE";

/// What `HPRM_PICKLE` says.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub(crate) enum Pickling {
    /// Nobody may.
    Deny,
    /// Federates of one user on one machine may.
    #[default]
    Local,
    /// All members of the federation may.
    Allow,
}

impl Pickling {
    /// What the environment says.
    ///
    /// # Errors
    ///
    /// A message, if it says something that is not known.
    pub(crate) fn of_environment() -> Result<Self, String> {
        let Some(text) = env::var_os(NAME) else { return Ok(Self::default()) };
        match text.to_str() {
            Some("deny") => Ok(Self::Deny),
            Some("local" | "") => Ok(Self::Local),
            Some("allow") => Ok(Self::Allow),
            _ => Err(format!(
                "{NAME}={} means nothing; it is `deny`, `local` or `allow`",
                text.to_string_lossy()
            )),
        }
    }

    /// For what goes to, or comes from, a federate that is `near`: on this machine, of this user.
    pub(crate) fn towards(self, near: bool) -> Trust {
        Trust { pickling: self, near }
    }
}

/// How far the other end is trusted.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Trust {
    pickling: Pickling,
    near: bool,
}

impl Trust {
    /// Whether pickles may pass.
    pub(crate) fn permits_pickle(self) -> bool {
        match self.pickling {
            Pickling::Deny => false,
            Pickling::Local => self.near,
            Pickling::Allow => true,
        }
    }

    /// Why they may not.
    pub(super) fn reason(self) -> &'static str {
        match self.pickling {
            Pickling::Deny => "HPRM_PICKLE=deny lets no pickle pass",
            Pickling::Local | Pickling::Allow => {
                "the other federate is on another machine, or reached over TCP as if it were, where \
                 HPRM_PICKLE=local, the default, lets no pickle pass"
            }
        }
    }

    /// What would let them pass.
    pub(super) fn remedy(self) -> &'static str {
        match self.pickling {
            Pickling::Deny => "start the program without HPRM_PICKLE=deny",
            Pickling::Local | Pickling::Allow => {
                "set HPRM_PICKLE=allow for all federates, which lets every member run code in every \
                 other"
            }
        }
    }
}
