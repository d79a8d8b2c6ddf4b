//! A seeded world for the pure crates: whole federations on one thread, from one number.
//!
//! Real schedulers, real federates and a real RTI run over links with random latencies, in virtual
//! time; what they do is compared with a run of the same program in one scheduler. A seed that
//! fails is printed, and fails again.
//!
//! Where to start: [`World`] runs a federation, [`generate`] makes a program, [`reference()`] says
//! what it must do.

#![deny(clippy::disallowed_methods, clippy::disallowed_types)]
#![forbid(unsafe_code)]

mod behaviour;
mod generate;
mod network;
mod node;
mod oracle;
mod rng;
mod world;

pub use behaviour::{Entry, Log};
pub use generate::{Shape, generate};
pub use oracle::{difference, reference};
pub use rng::Rng;
pub use world::{Outcome, Plan, World};
