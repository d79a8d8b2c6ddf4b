//! What is to happen to a federation besides its program, and its outcome.

use std::collections::BTreeSet;

use hprm_core::{ChannelId, FederateId, Nanos, PhysicalTime, Table, Tag};
use hprm_federated::DnetMode;

use crate::network::{Instance, Latency, Partition};
use crate::{Log, Machines, Maxwait, Traffic};

/// What is to happen besides the program.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct Plan {
    /// How long frames are in transit.
    pub latency: Latency,
    /// The same on direct links between federates, if they are slower or faster than those of the RTI.
    pub direct_latency: Option<Latency>,
    /// A federate that is cut off for a while.
    pub partition: Option<Partition>,
    /// How each federate's clock deviates from true time; those that are not here do not.
    pub clocks: Vec<Skew>,
    /// A federate that asks to stop once it has processed that tag or a later one.
    pub stop: Option<(FederateId, Tag)>,
    /// Federates that leave, each at its first reaction at that tag or a later one.
    pub leaves: Vec<(FederateId, Tag)>,
    /// Federates that change after which tag how long they wait.
    pub maxwaits: Vec<Maxwait>,
    /// A federate that is killed at that time.
    pub crash: Option<(FederateId, PhysicalTime)>,
    /// A federate whose link to the RTI breaks at that time.
    pub cut: Option<(FederateId, PhysicalTime)>,
    /// Two federates whose direct link breaks at that time.
    pub broken: Option<(FederateId, FederateId, PhysicalTime)>,
    /// A federate whose direct links break when it has ended: what is in transit on them is lost.
    pub broken_at_end: Option<FederateId>,
    /// How often direct links end while they are opened, if at all.
    pub resets: Option<Resets>,
    /// Transient federates that are not launched at the beginning.
    pub absent: BTreeSet<FederateId>,
    /// Processes of transient federates that users start; a launcher starts the others.
    pub by_hand: BTreeSet<Instance>,
    /// What happens to transient federates, and when.
    pub visits: Vec<(FederateId, PhysicalTime, Visit)>,
    /// How many bytes may be in transit to a receiver when a tag begins, if not as many as usual.
    pub flow_limit: Option<u64>,
    /// When the RTI sends downstream next event tags.
    pub dnet: DnetMode,
    /// Whether federates coordinate themselves by boards, if the program permits it.
    pub boards: bool,
    /// The machines, if there are several: agents lead the links between them.
    pub machines: Option<Machines>,
    /// When which federate's physical action is scheduled from outside.
    pub events: Vec<(FederateId, PhysicalTime)>,
}

/// Direct links that end while they are opened, once for the acceptor before its opener knows of it.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub struct Resets {
    /// How many.
    pub count: u64,
    /// After how long a link is opened again.
    pub pause: Nanos,
}

/// How a clock deviates.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Default)]
pub struct Skew {
    /// By how much it is fast at time zero.
    pub offset: Nanos,
    /// How much it gains in a million.
    pub drift: Nanos,
}

impl Skew {
    /// What the clock shows at a true time.
    pub(crate) fn local(self, time: PhysicalTime) -> PhysicalTime {
        let gained = i128::from(time.0) * i128::from(self.drift) / 1_000_000;
        let gained = Nanos::try_from(gained).unwrap_or(Nanos::MAX);
        PhysicalTime(time.0.saturating_add(self.offset).saturating_add(gained))
    }

    /// The first time at which it shows that much or more.
    pub(crate) fn global(self, reading: PhysicalTime) -> PhysicalTime {
        let elapsed = i128::from(reading.0) - i128::from(self.offset);
        let time = elapsed * 1_000_000 / i128::from(1_000_000 + self.drift);
        let mut time = PhysicalTime(Nanos::try_from(time).unwrap_or(Nanos::MAX).saturating_sub(2));
        while self.local(time) < reading {
            time = time.plus(1);
        }
        time
    }
}

/// What happens to a transient federate.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Visit {
    /// A process is launched that joins as this federate, and takes over from an earlier one.
    Launch,
    /// The federate that runs asks to leave.
    Leave,
    /// The process that was launched last is killed.
    Crash,
}

/// The outcome of a run.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Outcome {
    /// What its reactions did.
    pub log: Log,
    /// The last tag of each federate.
    pub last: Table<FederateId, Tag>,
    /// Which of them left before the others.
    pub left: Table<FederateId, bool>,
    /// How many processes did not take part, while the one ran whose place they would have taken.
    pub withdrawn: usize,
    /// How many messages were tardy.
    pub tardy: usize,
    /// How many messages did not arrive before their receiver ended, although it had to get them.
    pub lost: usize,
    /// The federate that the RTI reported as failed.
    pub failed: Option<FederateId>,
    /// The last tag of the program, as far as any federate knew it.
    pub stop: Tag,
    /// The processes of each federate that have started, in order.
    pub lives: Vec<Life>,
    /// The least tag of a message that a broken link has lost, although its receiver came as far.
    pub lost_from: Tag,
    /// What has come of the links between machines.
    pub traffic: Traffic,
    /// When the last process ended.
    pub over: PhysicalTime,
    /// How many things happened.
    pub events: usize,
    /// By how much, at most, a tag has begun after it was due by the federate's clock.
    pub lag: Nanos,
    /// How many frames the federates sent to the RTI, and the RTI to them.
    pub frames: (usize, usize),
    /// What federates and the RTI have waited for, by kind, at the moments at which that was looked at.
    pub seen: BTreeSet<&'static str>,
}

/// What a process of a federate has done.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub struct Life {
    /// Which federate it was.
    pub federate: FederateId,
    /// Its first tag.
    pub first: Tag,
    /// The federates that had no process when it started, as it knew.
    pub without: Vec<FederateId>,
    /// The last tag that it has begun.
    pub last: Tag,
    /// How it has ended.
    pub end: Ending,
    /// What its reactions did.
    pub log: Log,
    /// The messages that it has taken.
    pub arrivals: Vec<(ChannelId, Tag)>,
}

/// How a process has ended.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Ending {
    /// At its last tag.
    InOrder,
    /// The same, after the RTI had given it up, so that the others may have agreed on an earlier one.
    GivenUp,
    /// The RTI told it to end, or it was killed, between two tags.
    Between,
    /// The same within a tag.
    Within,
}
