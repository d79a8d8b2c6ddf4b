//! What a watcher and a federate say to one another, as records.
//!
//! The two are processes of one user on one machine. The first record of the federate begins with [`VERSION`], so that
//! processes of different versions notice that they are.

use hprm_core::{ChannelId, FederateId, Nanos, Payload, PhysicalTime, Program, Tag};
use serde::{Deserialize, Serialize};

use super::Tally;
use crate::records::{decode, encode};

/// The version of this protocol.
pub(super) const VERSION: u32 = 2;

/// What a watcher wants to know of the messages of a channel.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub enum Wish {
    /// Each message with its value.
    Values,
    /// How many there are, when asked.
    Counts,
}

/// What a watcher says.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub(super) enum Ask {
    /// Which channels it watches from now on, of those on which the federate sends.
    Watch { channels: Vec<ChannelId>, wish: Wish },
    /// It does not read these objects any more.
    Release { serials: Vec<u64> },
    /// What has been counted since the last time?
    Counts,
}

/// What a federate says.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub(super) enum Told {
    /// First of all: which federate it is. The program says what the numbers of channels mean.
    Federate(Box<Introduction>),
    /// First and last of all: it has as many watchers as it may have.
    Full,
    /// The watcher's channels are watched from now on.
    Watching,
    /// A segment with objects of later messages. Its descriptor comes with the record.
    Segment { segment: u32, len: u64 },
    /// Segments that the watcher may unmap.
    Retired { segments: Vec<u32> },
    /// A message that the federate sends.
    Message(Seen),
    /// What has been counted in some time.
    Counts { span: Nanos, tallies: Vec<(ChannelId, Tally)> },
}

/// What a federate says of itself.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub(super) struct Introduction {
    pub(super) program: Program,
    pub(super) federate: FederateId,
}

/// A message, as a watcher sees it.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub(super) struct Seen {
    pub(super) channel: ChannelId,
    /// The sender's tag.
    pub(super) tag: Tag,
    /// The receiver's tag; none if that is the time of arrival.
    pub(super) arrives: Option<Tag>,
    /// The time of tag zero.
    pub(super) start: PhysicalTime,
    /// When it was sent.
    pub(super) at: PhysicalTime,
    /// How many bytes its value has.
    pub(super) bytes: u64,
    /// How many messages the watcher has not got so far.
    pub(super) dropped: u64,
    /// What the watcher has to release when it has read the record, because that is long.
    pub(super) ticket: Option<u64>,
    pub(super) value: Content,
}

/// The value of a message.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub(super) enum Content {
    /// As a receiver gets it.
    Payload(Payload),
    /// It is larger than what watchers may hold.
    TooLarge,
    /// It has no encoding: between threads of one process, it needs none.
    Unencodable(String),
}

/// The first record of a federate, with the version in front.
pub(super) fn encode_first(record: &Told) -> Vec<u8> {
    let mut bytes = VERSION.to_le_bytes().to_vec();
    bytes.extend(encode(record));
    bytes
}

/// What is in the first record of a federate; none if that has another version.
pub(super) fn decode_first(bytes: &[u8]) -> Option<Told> {
    let (version, record) = bytes.split_first_chunk::<4>()?;
    (*version == VERSION.to_le_bytes()).then(|| decode(record))?
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_record_of_another_version_is_none() {
        let mut first = encode_first(&Told::Full);
        assert_eq!(decode_first(&first), Some(Told::Full));
        first[0] += 1;
        assert_eq!(decode_first(&first), None);
        assert_eq!(decode_first(&first[..3]), None);
    }

    proptest! {
        #[test]
        fn any_bytes_are_a_record_or_none(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            if let Some(ask) = decode::<Ask>(&bytes) {
                prop_assert_eq!(decode::<Ask>(&encode(&ask)), Some(ask));
            }
            let _ = decode::<Told>(&bytes);
        }
    }
}
