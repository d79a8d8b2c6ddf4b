//! What loops show: the state of a federate and of the RTI, as they were at a moment.

use hprm_core::{Nanos, PhysicalTime, Tag};
use hprm_federated::{Blocker, FederationPhase, MemberView};
use serde::{Deserialize, Serialize};

use crate::Clock;

/// How far a federate's loop has got.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub enum Stage {
    /// It looks for the RTI.
    Connecting,
    /// It loads its program.
    Loading,
    /// It waits for the start.
    Joining,
    /// It runs.
    Running,
    /// It has processed its last tag, or has failed, and sends its last frames.
    Ending,
}

/// When a state was shown.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct Moment {
    /// The time by the federation's clock.
    pub at: PhysicalTime,
    /// By how much that clock is ahead of the monotonic clock of the machine.
    pub ahead: Nanos,
}

impl Moment {
    pub(crate) fn now() -> Self {
        let at = Clock::now();
        Self { at, ahead: at.0 - Clock::monotonic() }
    }

    /// What the federation's clock shows now.
    #[must_use]
    pub fn clock(&self) -> PhysicalTime {
        PhysicalTime(Clock::monotonic() + self.ahead)
    }
}

/// What has gone over a channel, counted where the board is.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct ChannelCount {
    /// The number of the channel.
    pub channel: u32,
    /// How many messages.
    pub messages: u64,
    /// How many bytes they have, shared objects included.
    pub bytes: u64,
    /// The tag of the last one; none, if there was none.
    pub last: Option<Tag>,
}

/// The memory of a federate's store, in bytes.
#[derive(Clone, PartialEq, Eq, Debug, Default, Serialize, Deserialize)]
pub struct StoreState {
    /// In use: being written, or held.
    pub in_use: u64,
    /// Mapped now.
    pub mapped: u64,
    /// The most that may be mapped.
    pub limit: u64,
    /// What which federate holds of it, by the number of the federate.
    pub held: Vec<(u16, u64)>,
    /// How many messages travelled without it because it was full.
    pub fallbacks: u64,
}

/// The state of a federate.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct FederateState {
    /// When this was.
    pub moment: Moment,
    /// How many notes there were by then: if there are more, the federate has begun another tag.
    pub notes: u64,
    /// How far the loop has got.
    pub stage: Stage,
    /// The time of tag zero, once it is known.
    pub start: Option<PhysicalTime>,
    /// The latest tag that has begun; none before the first.
    pub current: Option<Tag>,
    /// Whether that tag is complete.
    pub complete: bool,
    /// The next tag.
    pub next: Tag,
    /// Whether the loop waits.
    pub waits: bool,
    /// For what.
    pub blockers: Vec<Blocker>,
    /// How many tags have begun.
    pub tags: u64,
    /// The channels that lead from the federate or to it.
    pub channels: Vec<ChannelCount>,
    /// Its store.
    pub store: StoreState,
    /// How many messages have come too late for their tags.
    pub tardy: u64,
    /// How many messages were dropped because a physical connection has a bound.
    pub dropped: u64,
}

impl FederateState {
    /// The state of a federate that does not run yet.
    pub(crate) fn before(stage: Stage) -> Self {
        Self {
            moment: Moment::now(),
            notes: 0,
            stage,
            start: None,
            current: None,
            complete: true,
            next: Tag::START,
            waits: false,
            blockers: Vec::new(),
            tags: 0,
            channels: Vec::new(),
            store: StoreState::default(),
            tardy: 0,
            dropped: 0,
        }
    }

    /// The most bytes that the state of a federate with so many channels, in a program of so many federates,
    /// has when it is encoded.
    pub(crate) fn size(channels: usize, federates: usize) -> usize {
        1024 + channels * 128 + federates * 64
    }
}

/// The state of an RTI.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct RtiState {
    /// When this was.
    pub moment: Moment,
    /// How far the federation has got.
    pub phase: FederationPhase,
    /// The time of tag zero, once it is known.
    pub start: Option<PhysicalTime>,
    /// What the RTI knows of each federate, by its number.
    pub members: Vec<MemberView>,
    /// How often each federate was started again, by its number.
    pub restarts: Vec<u32>,
}

impl RtiState {
    /// The most bytes that the state of an RTI of so many federates has when it is encoded.
    pub(crate) fn size(federates: usize) -> usize {
        1024 + federates * 512
    }
}
