//! Simulation of whole federations on one thread, from a seed.
//!
//! Real schedulers, real federates and a real RTI run over links with random latencies, in virtual
//! time; what they do is compared with a run of the same program in one scheduler. A seed that
//! fails is printed, and fails again.
//!
//! [`explore`] leaves nothing to chance: it visits every state that a small federation can reach.
//!
//! Where to start: [`World`] runs a federation, [`generate`] makes a program, [`reference()`] computes
//! what it must do; [`scenario`] makes a small one for [`explore`].

#![deny(clippy::disallowed_methods, clippy::disallowed_types)]
#![forbid(unsafe_code)]

mod behaviour;
mod boards;
mod changes;
mod direct_links;
mod explained;
mod generate;
mod history;
mod lives;
mod machines;
mod mailboxes;
mod model;
mod network;
mod node;
mod oracle;
mod patience;
mod places;
mod plan;
mod relayed;
mod rng;
mod scenario;
mod trial;
mod visits;
mod world;

pub use behaviour::{Entry, Log};
pub use changes::Maxwait;
pub use generate::{Shape, generate};
pub use machines::{Machines, Traffic};
pub use model::{Action, Explored, Happening, Setting, Violation, explore};
pub use network::{Instance, Latency, Partition, Place};
pub use oracle::{difference, reference, reference_until};
pub use plan::{Ending, Life, Outcome, Plan, Skew, Visit};
pub use relayed::{RelayTrial, RelayVerdict};
pub use rng::Rng;
pub use scenario::scenario;
pub use trial::{Trial, Verdict};
pub use world::World;
