//! Shipments: large parts of messages, which agents take to another machine once, however many receivers are there.
//!
//! ```text
//! federate ── object, shipment ──► service ═══ bytes, once for each machine ═══► service ── object ──► receivers
//!     └────────────── message, which names the shipment, over the link as always ────────────────────────┘
//! ```
//!
//! A federate hands its object to the *shipping service*, a thread of the agent of its machine, which reads it where it
//! lies. The service of the other machine puts the bytes into a store of its own, and all receivers there map them. The
//! message travels as before and names the shipment in place of the bytes; the receiver's end of the link waits for
//! them (`federate_loop/holding.rs`), as it waits for the rest of a message. So the machines of the protocol see what
//! they always see: a message that arrives a little later.
//!
//! Under this module: `client.rs` is a federate's end of the connection with the service, `records.rs` what they say.
//! Of the service, `service.rs` is the loop, `customer.rs` a federate as it sees it, and `depot.rs` the memory of one
//! federation here. `outgoing.rs` is what leaves for one machine, `incoming.rs` what comes from one, `content.rs` the
//! bytes of a shipment while they come, `label.rs` what two services say, and `blocks.rs` how they compress. `routes.rs`
//! knows which machine is next on the way to another one, and `led.rs` what a router has not handed on yet. Links between
//! machines are the business of agents. The service asks the loop of its agent for them (`dock.rs`), which is in the same
//! process: so of the bytes only references pass between the two (`pipe.rs`).

mod blocks;
mod client;
mod content;
mod customer;
mod depot;
mod dock;
mod incoming;
mod label;
mod led;
mod outgoing;
mod pipe;
mod records;
mod routes;
mod service;
#[cfg(test)]
mod tests;

pub(crate) use client::{Shipping, Way};
pub use dock::{ShippingDock, WantedLink};
pub use pipe::Pipe;
pub use service::ShippingService;

use hprm_core::FederateId;
use sha2::{Digest, Sha256};

use crate::Address;

/// The listener of every machine at which its shipping service takes what others send. No process can listen there.
pub const SHIPMENTS: &str = "shipments";

/// The shortest part of a message that becomes a shipment, in bytes.
pub(crate) const SHORTEST: u64 = 256 << 10;

/// By which number the service is a reader of a federate's store, and the owner of what it receives: one that no
/// federate has, and no watcher.
pub(crate) const SERVICE: FederateId = FederateId(u16::MAX - 64);

/// The name of the abstract socket at which the service of an agent listens for federates.
fn socket_name(agent: &Address) -> String {
    let user = rustix::process::geteuid().as_raw();
    let digest = Sha256::digest(format!("{agent}\0{user}"));
    let digits = digest.iter().take(16).map(|byte| format!("{byte:02x}"));
    format!("hprm-shipping-{}", digits.collect::<String>())
}
