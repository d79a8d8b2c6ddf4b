//! What a federate waits for, and what the RTI waits for before it lets a federate advance: plain facts, for
//! people that ask why a federation does not go on.
//!
//! The machines say which of them hold (`federate/blockers.rs`, `rti/overview.rs`); nothing is decided by them.

use hprm_core::{ChannelId, FederateId, Nanos, PhysicalTime, Tag};
use serde::{Deserialize, Serialize};

use crate::Step;

/// One thing without which a federate cannot advance. If there are several, it needs all of them.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub enum Blocker {
    /// Its link to the RTI is lost, and it opens another one.
    RtiLink,
    /// The RTI has not announced that all federates have joined.
    Joining,
    /// It has not loaded its program, or has not compared its clock with the RTI's.
    Loading,
    /// A direct link that it needs before the start is not up.
    Link {
        /// The federate at the other end.
        peer: FederateId,
    },
    /// It is ready, and the RTI has not announced the start: others are not ready.
    Start,
    /// A direct link has broken; the RTI will tell whether its federate has ended.
    BrokenLink {
        /// The federate at the other end.
        peer: FederateId,
    },
    /// It has no event: a message or a physical action may cause one.
    Events {
        /// The federates that may send it messages, apart from those that have ended.
        from: Vec<FederateId>,
    },
    /// Its next tag is not due by its clock.
    Time {
        /// When it is.
        until: PhysicalTime,
    },
    /// The federates are agreeing on a last tag, and it stays before this one until the RTI has decided.
    Stop {
        /// The tag that it named.
        tag: Tag,
    },
    /// It has no more events, and the RTI has not found out whether others have.
    Starvation,
    /// It has no grant for this step.
    Grant {
        /// The last step of the tag that it wants to process, or the step that it wants to take within it.
        through: Step,
    },
    /// It does not know whether a message comes on a channel.
    Message {
        /// The channel.
        channel: ChannelId,
        /// The federate that would send it.
        from: FederateId,
        /// It must know through this tag.
        through: Tag,
        /// When it waits no longer; none if never.
        until: Option<PhysicalTime>,
    },
    /// It has sent more to a receiver than may be unprocessed.
    Unprocessed {
        /// The receiver.
        receiver: FederateId,
        /// How many bytes sent at earlier tags are not known to be processed. An object in the store counts for
        /// less than its length.
        bytes: u64,
        /// How many may be.
        limit: u64,
    },
    /// As many messages wait at the receiver of a physical connection as the program allows, and the connection
    /// blocks its sender.
    Bound {
        /// The channel.
        channel: ChannelId,
        /// Its receiver.
        receiver: FederateId,
        /// How many messages wait.
        messages: u64,
    },
}

/// What the RTI waits for before it lets a federate process the tag that the federate wants.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub enum Hold {
    /// A message may still come from a federate upstream.
    Upstream {
        /// The federate upstream.
        federate: FederateId,
        /// The federate whose progress this depends on: the same, or one further upstream. It is the federate that
        /// waits for the grant, if that has not reported its next event.
        source: FederateId,
        /// The earliest tag that such a message may have.
        arrival: Tag,
    },
    /// The tag is not due, and a transient federate may still join before it is.
    Due {
        /// The tag.
        tag: Tag,
    },
    /// Under decentralized coordination, a sender has reported more messages than their receiver has.
    InTransit {
        /// The channel.
        channel: ChannelId,
        /// Its receiver.
        receiver: FederateId,
    },
}

/// How far a federate has got with joining and leaving.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub enum Standing {
    /// It has not joined.
    Absent,
    /// It has joined; before the start, it may still be loading its program.
    Joined,
    /// It has joined and has loaded its program.
    Ready,
    /// It has ended.
    Gone,
}

/// What the RTI knows of a federate.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub struct MemberView {
    /// How far it has got with joining and leaving.
    pub standing: Standing,
    /// Whether it may be absent while others run.
    pub transient: bool,
    /// The next event that it has reported since it last completed a tag; none, if the RTI does not know it.
    pub next: Option<Tag>,
    /// The latest tag that it has reported as completed.
    pub completed: Tag,
    /// Through which step it may advance, as the RTI has told it.
    pub granted: Step,
    /// What it wants to process next, if it has no grant for that and needs one.
    pub wanted: Option<Step>,
    /// What the RTI waits for before it grants that.
    pub holds: Vec<Hold>,
    /// Whether the RTI waits for its answer to a request to stop.
    pub owes_stop_reply: bool,
    /// For how long nothing has come from it, if the RTI has asked it for a sign of life.
    pub silence: Option<Nanos>,
}

/// How far a federation has got, as its RTI knows.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub enum FederationPhase {
    /// Federates are still to join.
    Joining,
    /// All have joined, and load their programs.
    Loading,
    /// The program runs.
    Running,
    /// The federates are agreeing on a last tag.
    Stopping,
    /// The last tag is decided.
    Ending,
    /// A federate has failed, or the start was called off.
    Failed,
}
