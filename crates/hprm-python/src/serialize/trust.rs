//! How far the other end of a channel is trusted: whether pickles may pass.
//!
//! What `HPRM_PICKLE` says is read when a program is loaded; here it meets where a federate is.

use hprm::Pickling;

/// How far the other end is trusted.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Trust {
    pickling: Pickling,
    is_local: bool,
    only_looks: bool,
}

impl Trust {
    /// Trust in a federate that is `is_local`: on this machine, of this user.
    pub(crate) const fn new(pickling: Pickling, is_local: bool) -> Self {
        Self { pickling, is_local, only_looks: false }
    }

    /// That of a process that only looks at what others send: no pickle is read, and no module imported.
    pub(crate) const fn looking() -> Self {
        Self { pickling: Pickling::Deny, is_local: true, only_looks: true }
    }

    /// Whether that is all.
    pub(super) fn only_looks(self) -> bool {
        self.only_looks
    }

    /// Whether pickles may pass.
    pub(crate) fn permits_pickle(self) -> bool {
        match self.pickling {
            Pickling::Deny => false,
            Pickling::Local => self.is_local,
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
