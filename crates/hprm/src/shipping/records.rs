//! What a federate and the shipping service of its machine say to one another, as records.

use hprm_core::{FederateId, ObjectRef, Shipment};
use hprm_federated::FederationId;
use serde::{Deserialize, Serialize};

/// The version of these records. A service of another version is none.
pub(super) const VERSION: u32 = 2;

/// Where a shipment goes: a machine, and the receivers there, each with the number of times that messages name it.
pub(super) type Destination = (String, Vec<(FederateId, u32)>);

/// What a federate says.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub(super) enum Ask {
    /// First of all: which federate it is, of which federation, by its name in frames.
    Join { version: u32, federation: FederationId, federate: FederateId },
    /// A segment with objects of later shipments. Its descriptor comes with the record.
    Segment { segment: u32, len: u64 },
    /// Segments that the service may unmap.
    Retired { segments: Vec<u32> },
    /// An object is to be shipped. The service holds it from now on.
    Ship { shipment: Shipment, object: ObjectRef, to: Vec<Destination>, compress: bool },
    /// It does not read these objects of the service any more.
    Release { serials: Vec<u64> },
    /// A message waits for this shipment, which comes from that machine. If the link on which the message came has ended,
    /// it waits only as long as there is a link for shipments.
    Expect { shipment: Shipment, from: String, link_ended: bool },
}

/// What the service says.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub(super) enum Told {
    /// The answer to [`Ask::Join`], with the name of the machine.
    Joined { version: u32, machine: String },
    /// It does not read these objects of the federate any more.
    Released { serials: Vec<u64> },
    /// A segment with objects of later shipments. Its descriptor comes with the record.
    Segment { segment: u32, len: u64 },
    /// Segments that the federate may unmap.
    Retired { segments: Vec<u32> },
    /// A shipment is here. The federate holds the object so many times.
    Arrived { shipment: Shipment, object: ObjectRef, uses: u32 },
    /// A shipment will not come, for this reason.
    Lost { shipment: Shipment, why: String },
    /// Last of all: what the federate has sent cannot be read.
    Refused { why: String },
}
