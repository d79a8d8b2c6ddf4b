//! What a machine says of an input that it cannot accept.
//!
//! A fault concerns one link or one call; the machine is as it was before. Failures of the
//! federation are outputs, not faults.

use hprm_core::{ChannelId, FederateId, Tag};

/// An input that breaks the protocol. The link that it came from should be closed.
#[derive(Clone, PartialEq, Eq, Hash, Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Fault {
    /// A frame that may not come on this link, or not yet, or not any more.
    #[error("an unexpected {frame} frame: the other side does not follow the protocol")]
    Unexpected {
        /// The kind of the frame.
        frame: &'static str,
    },
    /// A frame on a link that is not open.
    #[error("a frame on a link that is not open")]
    UnknownLink,
    /// A federate that the program does not have, or that is no neighbour.
    #[error("the program has no such federate here: {0:?}")]
    UnknownFederate(FederateId),
    /// A channel that the program does not have, or that does not lead this way.
    #[error("the program has no such channel here: {0:?}")]
    UnknownChannel(ChannelId),
    /// A message whose tag the receiver may already have processed.
    #[error("a message for tag {tag}, but {granted} has been granted")]
    InThePast {
        /// The tag of the message.
        tag: Tag,
        /// What its receiver may process.
        granted: Tag,
    },
    /// A value with too many large buffers.
    #[error(
        "a value with {parts} arrays or texts of more than 12 KiB is too much for a message; the \
         limit is {limit} of them"
    )]
    TooManyParts {
        /// How many it has.
        parts: usize,
        /// The limit.
        limit: usize,
    },
}
