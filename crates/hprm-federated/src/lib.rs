//! Federations: the frames of the protocol, the RTI, and a federate's side of both coordinations.
//!
//! This crate is pure. A machine is told the time and what happened, with `handle`; it answers with
//! outputs, which the caller drains with `poll` until there are none; `next_wakeup` tells when the
//! caller must call the machine again if nothing happens. A fault leaves a machine as it was. Sockets,
//! descriptors and waiting are the driver's; running reactions is the scheduler's.
//!
//! The machines rely on two things only: a link keeps the order of its frames, and both ends learn
//! when it ends. [`relay`] makes such a link of a carrier that promises neither.
//!
//! Where to start: [`Frame`] is what the machines send to one another, [`Federate`] is the one end,
//! [`Rti`] the other, [`Topology`] what both know of the program.

#![deny(clippy::disallowed_methods, clippy::disallowed_types)]
#![forbid(unsafe_code)]

mod blocker;
mod boards;
mod centralized;
mod clock_sync;
mod decentralized;
mod earliest;
mod fault;
mod federate;
#[cfg(test)]
mod fixture;
mod flow;
mod frame;
mod input;
mod log;
mod rti;
mod slewed;
mod startup;
mod step;
mod stop;
mod topology;

pub mod codec;
pub mod relay;

pub use blocker::{Blocker, FederationPhase, Hold, MemberView, Standing};
pub use boards::{Posting, Tally};
pub use clock_sync::{ClockSync, Correction, DRIFT, Estimate};
pub use fault::Fault;
pub use federate::Federate;
pub use frame::{
    Attempt, BadFederationId, Carried, Count, FederationId, Frame, HostId, Missing, PROTOCOL, Peer,
    Refusal, addresses_in, is_reached_through_agent, machine_in, shipments_to,
};
pub use input::{End, Input, Output, Permission};
pub use rti::{DnetMode, HangTimeout, LinkId, Rti, RtiInput, RtiOutput, show_silence};
pub use slewed::SlewedClock;
pub use step::{Edge, Step};
pub use topology::Topology;
