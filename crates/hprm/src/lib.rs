//! Running programs: the only place with sockets, threads and clocks.
//!
//! The pure crates decide; this one waits, reads, writes and asks. [`run_whole`] runs a program in
//! one process, [`run_federate`] one federate of it, [`Rti`] coordinates a federation. What a value
//! is, and how a reaction's body runs, is up to a [`Host`].
//!
//! A program written in Rust starts at [`Program`], and with `use hprm::prelude::*`.

/// The programs in Rust of the handbook.
#[cfg(doctest)]
// Blocks with file names have attributes that are Sphinx's.
#[allow(rustdoc::invalid_codeblock_attributes)]
#[doc = include_str!("../../../docs/howto/mixed.md")]
#[doc = include_str!("../../../docs/howto/rust.md")]
#[doc = include_str!("../../../docs/reference/language/index.md")]
#[doc = include_str!("../../../docs/reference/language/reactions.md")]
#[doc = include_str!("../../../docs/reference/language/connections.md")]
#[doc = include_str!("../../../docs/reference/language/modes.md")]
#[doc = include_str!("../../../docs/reference/language/federations.md")]
struct Handbook;

pub mod agent;
mod answer;
pub mod board;
mod clock;
pub mod console;
mod copying;
mod describing;
mod disk;
mod failure;
mod federate_loop;
mod frame_log;
mod handover;
mod host;
mod inbox;
mod lag;
pub mod launch;
mod link;
mod local_loop;
mod log;
mod notifier;
mod pickling;
mod pipe_notifier;
mod poller;
pub mod prelude;
mod program;
mod random;
mod realtime;
pub mod recorder;
mod records;
mod rti_loop;
mod shipping;
mod shown;
mod spin;
mod staging;
mod stall;
mod stop_timer;
mod store_limits;
pub mod supervisor;
pub mod trace;
mod value_exchange;
mod variables;
mod wait;
pub mod watch;
mod workers;

pub use answer::Answer;
pub use clock::{Clock, nanoseconds};
pub use copying::copy_value;
pub use describing::{DESCRIPTIONS, Descriptions, declaration_of, read_descriptions};
pub use disk::{Disk, Unreadable};
pub use failure::{Failure, Kind, Label, Raised, ReactionFailure, Report, Source, exit_code};
pub use federate_loop::{
    EndProcess, FederateOptions, Reach, THROUGH_AGENT, run_federate, run_federate_in,
};
pub use frame_log::{FRAMES, FRAMES_TO, begin_frame_log};
pub use handover::{Handover, Meeting, Which};
pub use host::{Host, SharedBodies};
pub use hprm_codec::{Array, Dtype, Dynamic, DynamicArray, Element, ShapeError, Transfer};
pub use inbox::Inbox;
pub use link::{Address, AddressError, Security, TlsFiles};
pub use local_loop::{run_whole, run_whole_traced};
pub use log::log_to_stderr;
pub use pickling::Pickling;
pub use program::{
    Action, CarriedPort, Connections, Context, Entry, Federate, Federation, InputPort, Interface,
    Loan, LogicalAction, Message, Mode, Outcome, OutputPort, PhysicalAction, Port, Ports, Program,
    ReactionBuilder, Reactor, ReactorBuilder, Readable, Reset, Restart, Runnable, ScheduleError,
    Sender, Shutdown, Startup, Timer, Triggers, WhenFull, run_as_federate, run_as_federate_with,
};
pub use random::{random_bytes, random_federation};
pub use realtime::enter_realtime;
pub use rti_loop::{Rti, RtiEvent, RtiHandle, RtiOptions};
pub use shipping::{Pipe, SHIPMENTS, ShippingDock, ShippingService, WantedLink};
pub use shown::{printable, printable_lines};
pub use staging::{STAGE, Stage, is_stage_of};
pub use stall::{ReactionRun, Stall, StallWatch};
pub use stop_timer::{StopProgress, StopStep, StopTimer};
pub use store_limits::{container_memory, store_limits};
pub use value_exchange::ValueExchange;
pub use variables::{EventLimit, LongReaction, check_variables};

pub use hprm_core::{Overflow, Policy, ProgramError, Properties, Spacing, Tag};
pub use hprm_federated::{BadFederationId, FederationId, HangTimeout, Refusal};
