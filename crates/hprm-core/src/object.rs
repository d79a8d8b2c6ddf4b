//! What a message carries: a head, and buffers that are either inline or in an object store.
//!
//! Plain data. Who writes the bytes, who maps them and who gives them back is the store's business.

use serde::{Deserialize, Serialize};

use crate::FederateId;

/// Where a sealed object lies: about 40 bytes that stand for any number of them.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug, Serialize, Deserialize)]
pub struct ObjectRef {
    /// The federate whose store holds the object.
    pub owner: FederateId,
    /// The number that the owner gave the object; never used twice.
    pub serial: u64,
    /// The owner's segment that holds it.
    pub segment: u32,
    /// First byte in the segment.
    pub offset: u64,
    /// Length in bytes.
    pub len: u64,
}

/// One buffer of a payload.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub enum Part {
    /// The bytes themselves.
    Inline(Vec<u8>),
    /// A reference to bytes in the sender's object store.
    Object(ObjectRef),
}

/// A value on its way from one federate to another (paper, section III-C, adaptive serialization).
#[derive(Clone, PartialEq, Eq, Hash, Debug, Default, Serialize, Deserialize)]
pub struct Payload {
    /// The structure of the value, and the small things in it.
    pub head: Vec<u8>,
    /// The large buffers that the head refers to, in its order.
    pub parts: Vec<Part>,
    /// Whether the value stems from the physical world; known only while the sender records what
    /// its reactions do.
    pub physical: bool,
}

impl Payload {
    /// The objects that this payload refers to.
    pub fn objects(&self) -> impl Iterator<Item = ObjectRef> {
        self.parts.iter().filter_map(|part| match part {
            Part::Object(object) => Some(*object),
            Part::Inline(_) => None,
        })
    }
}
