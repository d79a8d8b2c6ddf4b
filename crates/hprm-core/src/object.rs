//! What a message carries: a head, and buffers that are either inline or in an object store.
//!
//! Plain data. The store writes, maps and releases the bytes.

use alloc::vec::Vec;
use serde::{Deserialize, Serialize};

use crate::FederateId;

/// A reference to a sealed object: about 40 bytes in place of any number of them.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug, Serialize, Deserialize)]
pub struct ObjectRef {
    /// The federate whose store holds the object.
    pub owner: FederateId,
    /// The number that the owner gave the object; never used twice.
    pub serial: u64,
    /// The owner's segment in which it is.
    pub segment: u32,
    /// First byte in the segment.
    pub offset: u64,
    /// Length in bytes.
    pub len: u64,
}

/// A buffer that reaches the receiver's machine apart from the message, once for all receivers there: the message only
/// names it.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug, Serialize, Deserialize)]
pub struct Shipment {
    /// A random number of the sender.
    pub stream: u64,
    /// The number of the shipment in its stream; never used twice.
    pub number: u64,
    /// Length in bytes.
    pub len: u64,
}

impl Shipment {
    /// What tells it from all others.
    #[must_use]
    pub fn key(self) -> (u64, u64) {
        (self.stream, self.number)
    }
}

/// One buffer of a payload.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub enum Part {
    /// The bytes themselves.
    Inline(Vec<u8>),
    /// A reference to bytes in the sender's object store.
    Object(ObjectRef),
    /// The name of bytes that agents take to the receiver's machine. The receiver's end of the link waits for them, so no
    /// reaction ever sees this.
    Shipped(Shipment),
}

/// A value that one federate sends to another (paper, section III-C, adaptive serialization).
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

/// The system has no memory for so many bytes of a message. A program decides how long its messages are,
/// so the process does not abort.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, thiserror::Error)]
#[error("no memory is left for {0} bytes of a message")]
pub struct NoMemory(pub usize);

/// A copy of bytes of a message.
///
/// # Errors
///
/// If there is no memory for it.
#[inline]
pub fn copy_of(bytes: &[u8]) -> Result<Vec<u8>, NoMemory> {
    let mut copy = Vec::new();
    copy.try_reserve_exact(bytes.len()).map_err(|_| NoMemory(bytes.len()))?;
    copy.extend_from_slice(bytes);
    Ok(copy)
}

/// So many bytes for a message, zero at first.
///
/// # Errors
///
/// If there is no memory for them.
pub fn zeroed(len: usize) -> Result<Vec<u8>, NoMemory> {
    let mut bytes = Vec::new();
    bytes.try_reserve_exact(len).map_err(|_| NoMemory(len))?;
    bytes.resize(len, 0);
    Ok(bytes)
}

impl Payload {
    /// A copy.
    ///
    /// # Errors
    ///
    /// If there is no memory for it.
    pub fn try_clone(&self) -> Result<Self, NoMemory> {
        let parts = self.parts.iter().map(|part| match part {
            Part::Inline(bytes) => copy_of(bytes).map(Part::Inline),
            Part::Object(object) => Ok(Part::Object(*object)),
            Part::Shipped(shipment) => Ok(Part::Shipped(*shipment)),
        });
        let parts = parts.collect::<Result<_, _>>()?;
        Ok(Self { head: copy_of(&self.head)?, parts, physical: self.physical })
    }

    /// What stands for a value of this process, which has that number and so many bytes.
    #[must_use]
    pub fn reference(number: u64, bytes: u64) -> Self {
        let head = [number.to_le_bytes(), bytes.to_le_bytes()].concat();
        Self { head, ..Self::default() }
    }

    /// The number of the value that this payload stands for, and its bytes; none, if it stands for no value of this process.
    #[must_use]
    pub fn referred(&self) -> Option<(u64, u64)> {
        let (words, []) = self.head.as_chunks() else { return None };
        let [number, bytes] = words else { return None };
        Some((u64::from_le_bytes(*number), u64::from_le_bytes(*bytes)))
    }

    /// How many bytes the value has, wherever they are.
    #[must_use]
    pub fn byte_count(&self) -> u64 {
        let parts = self.parts.iter().map(|part| match part {
            Part::Inline(bytes) => bytes.len() as u64,
            Part::Object(object) => object.len,
            Part::Shipped(shipment) => shipment.len,
        });
        self.head.len() as u64 + parts.sum::<u64>()
    }

    /// The objects that this payload refers to.
    pub fn objects(&self) -> impl Iterator<Item = ObjectRef> {
        self.parts.iter().filter_map(|part| match part {
            Part::Object(object) => Some(*object),
            Part::Inline(_) | Part::Shipped(_) => None,
        })
    }

    /// The buffers of this payload that travel apart from it.
    pub fn shipments(&self) -> impl Iterator<Item = Shipment> {
        self.parts.iter().filter_map(|part| match part {
            Part::Shipped(shipment) => Some(*shipment),
            Part::Inline(_) | Part::Object(_) => None,
        })
    }
}
