//! What two shipping services say to one another, over a link that agents lead.
//!
//! ```text
//! sender:     len:u32 Hello   then  len:u32 Item,  with bytes behind each piece
//! receiver:   for each shipment that it has          stream:u64 number:u64
//! ```
//!
//! Lengths and numbers are little endian, `Hello` and [`Item`] in the format of `postcard`. Pieces of one shipment come in
//! order, and between them may be those of others: of what a router leads, not all may be there. A shipment that has no
//! receipt when the link ends is sent again over the next one.

use hprm_core::Shipment;
use hprm_federated::FederationId;
use serde::{Deserialize, Serialize};

use super::records::Destination;
use crate::records::encode;

/// The version of this protocol.
pub(super) const VERSION: u32 = 3;

/// The most bytes of a label, or of what a service says first: there is room for all federates of a federation.
pub(super) const LABEL_LIMIT: usize = 1 << 20;

/// The bytes of a length.
pub(super) const LENGTH: usize = 4;

/// The bytes of a receipt.
pub(super) const RECEIPT: usize = 16;

/// What the sender says first.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub(super) struct Hello {
    pub(super) version: u32,
    /// The sender's machine.
    pub(super) machine: String,
    /// The machines from which it leads shipments here, as long as they reach it.
    pub(super) leads: Vec<String>,
}

/// Which shipment it is.
pub(super) type Key = (u64, u64);

/// The most shipments that have begun on a link and are not complete.
pub(super) const OPEN: usize = 64;

/// What the sender says after that.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub(super) enum Item {
    /// A shipment begins. Its bytes come in pieces.
    Shipment(Label),
    /// Its next `len` bytes follow, as they are, or compressed to so many.
    Piece { of: Key, len: u32, packed: Option<u32> },
    /// The other pieces of a shipment do not come over this link, because they have not come to the sender. If they do, it
    /// begins anew.
    Broken { of: Key },
    /// It leads shipments of another machine here from now on, or that machine does not reach it any more.
    Leads { machine: String, is_there: bool },
}

/// What stands before the bytes of a shipment.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub(super) struct Label {
    /// The federation, by its name in frames.
    pub(super) federation: FederationId,
    pub(super) shipment: Shipment,
    /// The machine of the sender.
    pub(super) from: String,
    pub(super) to: Vec<Destination>,
    /// Whether its pieces are compressed.
    pub(super) compress: bool,
    /// Why no bytes come, if none do: then the shipment is lost.
    #[serde(deserialize_with = "crate::shown::maybe")]
    pub(super) lost: Option<String>,
}

impl Label {
    /// How many bytes come.
    pub(super) fn bytes(&self) -> u64 {
        if self.lost.is_some() { 0 } else { self.shipment.len }
    }
}

/// A value with its length in front.
pub(super) fn framed(value: &impl Serialize) -> Vec<u8> {
    let body = encode(value);
    let len = u32::try_from(body.len()).expect("a label is short");
    let mut bytes = len.to_le_bytes().to_vec();
    bytes.extend(body);
    bytes
}

/// The receipt for a shipment.
pub(super) fn receipt(shipment: Shipment) -> [u8; RECEIPT] {
    let mut bytes = [0; RECEIPT];
    bytes[..8].copy_from_slice(&shipment.stream.to_le_bytes());
    bytes[8..].copy_from_slice(&shipment.number.to_le_bytes());
    bytes
}
