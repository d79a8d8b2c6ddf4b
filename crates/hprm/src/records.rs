//! Records between two processes of one user on this machine: each a value in the format of `postcard`, with perhaps a
//! descriptor.
//!
//! `socket.rs` carries them, `queue.rs` keeps those for which the socket has no room yet. What they mean is with those
//! that use them: watchers, and shipments.

mod queue;
mod socket;

use serde::Serialize;
use serde::de::DeserializeOwned;

pub(crate) use queue::{RecordQueue, may_be_tried_again};
pub(crate) use socket::{Received, RecordListener, RecordSocket, SHORT};

/// A record as bytes.
pub(crate) fn encode(record: &impl Serialize) -> Vec<u8> {
    postcard::to_allocvec(record).expect("records are plain data")
}

/// The record that is in some bytes; none if they are no record.
pub(crate) fn decode<T: DeserializeOwned>(bytes: &[u8]) -> Option<T> {
    let (record, rest) = postcard::take_from_bytes(bytes).ok()?;
    rest.is_empty().then_some(record)
}
