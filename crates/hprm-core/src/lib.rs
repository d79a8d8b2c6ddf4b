//! The reactor model: tags, the program graph, levels, the event queue and the scheduler.
//!
//! This crate is pure. It never reads a clock, opens a socket, starts a thread or touches a file;
//! time is an argument and values are a type parameter. A driver runs the bodies of reactions and
//! carries messages to other federates. It needs no operating system either: the crates `core` and `alloc` are
//! enough, and a main loop with a clock of its own can step a program by hand, as the example
//! `stepped_by_hand` does.
//!
//! Where to start: [`Tag`] and [`Delay`] are the algebra of time, [`Program`] is the checked
//! instance graph that [`ProgramBuilder`] builds, [`Scheduler`] executes it.

#![deny(clippy::disallowed_methods, clippy::disallowed_types)]
#![forbid(unsafe_code)]
#![no_std]

extern crate alloc;
#[cfg(test)]
extern crate std;

mod bound;
mod builder;
mod clock_sync;
mod fingerprint;
mod id;
mod level;
mod lists;
mod mode;
mod object;
mod order;
mod program;
mod queue;
mod reach;
mod restart;
mod scheduler;
mod scope;
mod sorted_map;
mod spacing;
mod store_options;
mod tag;
mod tag_map;
mod wiring;

pub mod limits;

pub use bound::blocking::{Unsafe, unsafe_blocking};
pub use bound::{Bound, LARGE_BACKLOG, Overflow};
pub use builder::{ProgramBuilder, ProgramError, ReactionSpec};
pub use clock_sync::{ClockSyncMode, ClockSyncOptions};
pub use fingerprint::{Content, Fact, Fingerprint, show_time};
pub use id::{
    ActionId, ChannelId, ConnectionId, FederateId, Id, ModeId, PortId, ReactionId, ReactorId,
    Table, TimerId,
};
pub use mode::{ModalElement, Mode, Transition};
pub use object::{NoMemory, ObjectRef, Part, Payload, Shipment, copy_of, zeroed};
pub use program::{
    Action, Channel, Connection, Coordination, Direction, Effect, Federate, Origin, Port, Program,
    Properties, Reaction, Reactor, Spin, Timer, Trigger, federate_name, means_federate,
};
pub use restart::{Restart, RestartCondition};
pub use scheduler::{
    Body, Effects, InputId, InputValue, OutboundMessage, ReactionRecord, ScheduleRequest,
    Scheduled, Scheduler, Turn,
};
pub use scope::Scope;
pub use sorted_map::SortedMap;
pub use spacing::{Policy, Spacing};
pub use store_options::{StoreOptions, WhenFull, read_size};
pub use tag::{Delay, Nanos, PhysicalTime, Reading, Tag};
