//! A federation at a moment: what its boards showed, put together. Plain data.

use std::time::Duration;

use hprm::board::{ChannelName, FederateState, MemberView, Names, RtiState, Stage, Standing};
use hprm_core::{FederateId, Nanos, PhysicalTime, Tag};

/// What the system tells of a process.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum ProcessState {
    /// It runs, or sleeps until something comes.
    Alive,
    /// A signal or a debugger has stopped it.
    Stopped,
    /// It has ended.
    Ended,
}

/// A process of the federation on this machine.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Process {
    pub(crate) pid: u32,
    pub(crate) state: ProcessState,
    /// The machine by its name, which in a container is that of the container.
    pub(crate) host: String,
}

/// A reaction that a federate runs.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct RunningReaction {
    pub(crate) label: String,
    /// Where it is, as `FILE:LINE`.
    pub(crate) place: Option<String>,
}

/// What a federate has on its board.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Board {
    pub(crate) state: FederateState,
    pub(crate) names: Names,
    /// What the federation's clock shows now.
    pub(crate) now: PhysicalTime,
    /// The tag that it processes, if it has begun one since it showed its state, and when.
    pub(crate) begun: Option<(Tag, PhysicalTime)>,
    /// The reactions that it runs.
    pub(crate) reactions: Vec<RunningReaction>,
}

impl Board {
    /// A channel by its number.
    pub(crate) fn channel(&self, channel: u32) -> Option<&ChannelName> {
        self.names.channels.get(&channel)
    }

    /// How long ago something was, by the federation's clock.
    pub(crate) fn ago(&self, at: PhysicalTime) -> Nanos {
        self.now.since(at).max(0)
    }

    /// The tag that it has come to: that which it processes, or has processed last.
    pub(crate) fn tag(&self) -> Option<Tag> {
        self.begun.map(|(tag, _)| tag).or(self.state.current)
    }

    /// By how much the federate is behind its clock: how long the tag that it processes, or would process next, is
    /// overdue. None before the start.
    pub(crate) fn lag(&self) -> Option<Nanos> {
        let start = self.state.start?;
        let within = self.state.current.filter(|_| !self.state.complete);
        let tag = self.begun.map(|(tag, _)| tag).or(within).unwrap_or(self.state.next);
        let ended = tag == Tag::FOREVER || self.state.stage == Stage::Ending;
        Some(if ended { 0 } else { self.ago(tag.due(start)) })
    }
}

/// A federate of the federation, whether or not its process can be seen.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Member {
    pub(crate) name: String,
    pub(crate) process: Option<Process>,
    pub(crate) board: Option<Board>,
    /// What the RTI knows of it.
    pub(crate) known: Option<MemberView>,
    /// How often it was started again.
    pub(crate) restarts: u32,
}

impl Member {
    /// Whether it has ended, or a transient one that is not there: nothing has to be said of it.
    pub(crate) fn is_absent_rightly(&self) -> bool {
        let Some(MemberView { standing, transient, .. }) = self.known else { return false };
        let absent = standing == Standing::Gone || transient && standing == Standing::Absent;
        self.board.is_none() && absent
    }
}

/// The RTI.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct RtiMember {
    pub(crate) process: Process,
    pub(crate) state: Option<RtiState>,
    /// What the federation's clock shows now.
    pub(crate) now: PhysicalTime,
}

/// A federation at a moment.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Federation {
    pub(crate) name: String,
    pub(crate) id: String,
    pub(crate) centralized: bool,
    /// Federates by their number, in the order of the program.
    pub(crate) members: Vec<Member>,
    pub(crate) rti: Option<RtiMember>,
    /// Whether boards were there that have another form than this command understands.
    pub(crate) has_foreign: bool,
    /// The monotonic clock of this machine, when the boards were read.
    pub(crate) read_at: Duration,
}

impl Federation {
    pub(crate) fn member(&self, federate: FederateId) -> Option<&Member> {
        self.members.get(federate.index())
    }

    /// For how long the program runs, if it has started.
    pub(crate) fn elapsed(&self) -> Option<Nanos> {
        let of_rti =
            self.rti.iter().filter_map(|rti| Some(rti.now.since(rti.state.as_ref()?.start?)));
        let boards = self.members.iter().filter_map(|member| member.board.as_ref());
        let of_boards = boards.filter_map(|board| Some(board.now.since(board.state.start?)));
        of_rti.chain(of_boards).next()
    }
}
