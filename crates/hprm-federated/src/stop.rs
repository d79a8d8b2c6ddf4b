//! A federate's part in agreeing on a last tag: it names one, and stays before it until the RTI decides.

use hprm_core::Tag;

/// See the module.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub(crate) enum Stop {
    /// No federate has asked to stop.
    Open,
    /// This federate has asked before the start, and will ask again.
    Wanted,
    /// This federate has asked or answered with this tag, and stays before it.
    Held(Tag),
    /// The RTI has decided; the scheduler knows the last tag.
    Decided,
}

impl Stop {
    /// Whether `tag` may not begin before the decision. The named tag itself may not: it could be the
    /// last one, and its reactions to shutdown would be missing.
    pub(crate) fn refuses(self, tag: Tag) -> bool {
        matches!(self, Self::Held(held) if tag >= held)
    }

    /// The tag before which this federate stays until the decision, if it has named one.
    pub(crate) fn held(self) -> Option<Tag> {
        match self {
            Self::Held(held) => Some(held),
            Self::Open | Self::Wanted | Self::Decided => None,
        }
    }

    /// Asks to stop after `current`. Returns the tag to ask for, if asking is of use.
    pub(crate) fn request(&mut self, current: Tag) -> Option<Tag> {
        match *self {
            Self::Open | Self::Wanted => {
                let tag = current.succ().max(Tag::START);
                *self = Self::Held(tag);
                Some(tag)
            }
            Self::Held(_) | Self::Decided => None,
        }
    }

    /// Answers a request to stop at `tag`. None, if the RTI has decided already.
    pub(crate) fn reply(&mut self, tag: Tag, current: Tag) -> Option<Tag> {
        let held = match *self {
            Self::Open | Self::Wanted => current.succ(),
            Self::Held(held) => held,
            Self::Decided => return None,
        };
        let tag = tag.max(held);
        *self = Self::Held(tag);
        Some(tag)
    }
}
