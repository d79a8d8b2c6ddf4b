//! Packets of a relayed link, as bytes.
//!
//! ```text
//! packet = postcard(Header)  bytes       the bytes of the frame, if the body is one
//! ```
//!
//! Every packet says all that its sender has received and what it may be sent. So any packet may be lost, and the next
//! one makes up for it.

use serde::{Deserialize, Serialize};

use super::bytes::Bytes;

/// The most bytes of a frame. Pieces of this size cost little more per byte than larger ones, and one that is lost
/// costs little to send again.
pub const FRAME_LIMIT: usize = 64 << 10;

/// The most bytes of a header: its fields and runs, each number with at most ten bytes, and a reason.
const HEADER_LIMIT: usize = 1024;

/// The most runs of frames that a packet tells of. A carrier that drops packets drops many at a time.
pub(super) const RUNS: usize = 16;

/// The most bytes of the text of a reason; a longer one is cut.
const REASON_LIMIT: usize = 256;

/// The version of the packets. Ends with different versions do not understand each other.
const VERSION: u8 = 1;

/// What every packet says.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub(super) struct Header {
    version: u8,
    /// The epoch of the sender: which life of that end this is.
    pub(super) from: u64,
    /// The epoch of the receiver as the sender knows it; zero if it knows none yet.
    pub(super) to: u64,
    /// The number of the first frame that the sender has not received.
    pub(super) next: u64,
    /// Which frames after that one it has received, from the lowest: how many are missing, and how many are there.
    /// There may be more.
    pub(super) held: Vec<(u32, u32)>,
    /// The sender takes frames with lower numbers.
    pub(super) frame_limit: u64,
    /// The sender takes so many bytes of frames, counted from the beginning of the link.
    pub(super) byte_limit: u64,
    /// The receiver is to answer at once.
    pub(super) asks: bool,
    pub(super) body: Body,
}

/// What a packet carries beyond that.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub(super) enum Body {
    Nothing,
    /// A frame; its bytes follow the header. The length tells a packet that was cut.
    Frame {
        number: u64,
        len: u32,
    },
    /// The sender sends no more frames. It has a number as a frame has.
    Finish {
        number: u64,
    },
    /// The link has ended at the sender.
    Reset(Reason),
}

/// Why a link has ended at the other end.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub(super) enum Reason {
    Aborted(String),
    Restarted,
    Silent,
    Broken,
    Unknown,
}

/// A packet for the carrier: its header, and the bytes of a frame, which are not copied.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub struct Packet {
    /// The header.
    pub head: Vec<u8>,
    /// What follows it, if anything does.
    pub frame: Option<Bytes>,
}

impl Packet {
    pub(super) fn new(header: &Header, frame: Option<Bytes>) -> Self {
        Self { head: header.encode(), frame }
    }

    /// All of it in one piece.
    #[must_use]
    pub fn into_vec(self) -> Vec<u8> {
        let mut whole = self.head;
        whole.extend_from_slice(self.frame.as_deref().unwrap_or_default());
        whole
    }
}

impl Header {
    /// A header that knows nothing but the epochs.
    pub(super) fn between(from: u64, to: u64, body: Body) -> Self {
        let (next, held, frame_limit, byte_limit) = (0, Vec::new(), 0, 0);
        Self { version: VERSION, from, to, next, held, frame_limit, byte_limit, asks: false, body }
    }

    /// The header as bytes.
    pub(super) fn encode(&self) -> Vec<u8> {
        let room = Vec::with_capacity(80);
        postcard::to_extend(self, room).expect("a vector takes everything")
    }

    /// Reads a packet: its header, and the bytes of its frame. None if it is no packet, has been cut, or is longer
    /// than any.
    pub(super) fn decode(packet: &[u8]) -> Option<(Self, &[u8])> {
        if packet.len() > HEADER_LIMIT + FRAME_LIMIT {
            return None;
        }
        let (header, bytes) = postcard::take_from_bytes::<Self>(packet).ok()?;
        let len = match header.body {
            Body::Frame { len, .. } => len as usize,
            _ => 0,
        };
        let whole = header.version == VERSION && bytes.len() == len && len <= FRAME_LIMIT;
        let whole = whole && header.held.len() <= RUNS;
        (whole && header.from != 0).then_some((header, bytes))
    }
}

impl Reason {
    /// An end that the program asks for, with at most so much text as fits into a packet.
    pub(super) fn aborted(text: &str) -> Self {
        let fits = |end: &usize| text.is_char_boundary(*end);
        let end = (0..=text.len().min(REASON_LIMIT)).rev().find(fits).unwrap_or_default();
        Self::Aborted(text[..end].to_owned())
    }
}
