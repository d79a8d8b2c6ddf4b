//! Silent federates: a federate that does not answer for a while may hang, or compute for long. The RTI
//! cannot tell the difference, so it reports the federate, and the user decides whether it is a failure.
//!
//! A federate that has ended, or whose link has ended, is not silent; other files handle that.

use hprm_core::{FederateId, Nanos, PhysicalTime, Table};

use super::{Phase, Rti, RtiOutput};
use crate::Frame;

/// After how long a silence the RTI sends a federate a `Ping`.
const PING: Nanos = 1_000_000_000;

/// After how long a silence the RTI reports a federate.
const SILENCE: Nanos = 5_000_000_000;

/// When a federate's silence is a failure, if ever.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Default)]
pub struct HangTimeout {
    /// The longest silence, in nanoseconds.
    pub limit: Option<Nanos>,
}

/// Since when a federate has been silent, and what the RTI has done about it.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
struct Liveness {
    /// When the last frame, or a part of it, came.
    last_frame: PhysicalTime,
    /// When the RTI sent a `Ping` that the federate has not answered.
    ping_sent: Option<PhysicalTime>,
    /// Whether the RTI has reported the federate as silent.
    reported: bool,
}

/// See the module.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(super) struct Watch {
    hang_timeout: HangTimeout,
    liveness: Table<FederateId, Liveness>,
}

impl Watch {
    pub(super) fn new(federates: usize, hang_timeout: HangTimeout) -> Self {
        let liveness = Liveness { last_frame: PhysicalTime(0), ping_sent: None, reported: false };
        Self { hang_timeout, liveness: Table::filled(federates, liveness) }
    }

    /// When the RTI has to act if a federate stays silent.
    fn due(&self, federate: FederateId) -> PhysicalTime {
        let Liveness { last_frame, ping_sent, reported } = self.liveness[federate];
        let Some(ping_sent) = ping_sent else { return last_frame.plus(self.ping()) };
        let report = if reported { PhysicalTime::FOREVER } else { last_frame.plus(SILENCE) };
        let limit =
            self.hang_timeout.limit.map_or(PhysicalTime::FOREVER, |limit| last_frame.plus(limit));
        // If the RTI itself stood still, it has sent the `Ping` late; then the federate may answer first.
        report.min(limit).max(ping_sent.plus(self.ping()))
    }

    /// After how long a silence the RTI sends a `Ping`, and how long at least a federate has to answer.
    fn ping(&self) -> Nanos {
        self.hang_timeout.limit.map_or(PING, |limit| PING.min(limit / 2))
    }
}

/// A silence in the words of messages: whole seconds, or milliseconds if there are no whole ones.
#[must_use]
pub fn show_silence(silence: Nanos) -> String {
    match silence / 1_000_000_000 {
        0 => format!("{} ms", silence / 1_000_000),
        seconds => format!("{seconds} s"),
    }
}

impl Rti {
    /// Makes the RTI watch for silent federates.
    #[must_use]
    pub fn watching(mut self, hang_timeout: HangTimeout) -> Self {
        self.watch = Some(Watch::new(self.members.len(), hang_timeout));
        self
    }

    /// A frame, or a part of one, has come from a federate.
    pub(super) fn note_frame(&mut self, federate: FederateId, now: PhysicalTime) {
        let Some(watch) = &mut self.watch else { return };
        let silence = now.since(watch.liveness[federate].last_frame);
        let liveness = Liveness { last_frame: now, ping_sent: None, reported: false };
        let before = std::mem::replace(&mut watch.liveness[federate], liveness);
        if before.reported {
            self.outputs.push_back(RtiOutput::Answers { federate, silence });
        }
    }

    /// For how long nothing has come from a federate that the RTI has asked to answer.
    pub(super) fn silence(&self, federate: FederateId, now: PhysicalTime) -> Option<Nanos> {
        let liveness = self.watch.as_ref()?.liveness[federate];
        let asked = liveness.ping_sent.filter(|_| self.members[federate].is_live());
        asked.map(|_| now.since(liveness.last_frame))
    }

    /// The silence of every federate is counted from now on: the program starts.
    pub(super) fn restart_silence(&mut self, now: PhysicalTime) {
        self.topology.federates().for_each(|federate| self.note_frame(federate, now));
    }

    /// When the RTI has to act if all federates stay silent.
    pub(super) fn next_silence(&self) -> Option<PhysicalTime> {
        let watch = self.watch.as_ref().filter(|_| self.phase == Phase::Running)?;
        let live = self.members.iter().filter(|(_, member)| member.is_live());
        let due = live.map(|(federate, _)| watch.due(federate)).min()?;
        Some(due).filter(|due| *due < PhysicalTime::FOREVER)
    }

    /// Asks silent federates to answer. Reports those that do not, and fails once one has been silent for the
    /// limit.
    pub(super) fn check_for_silence(&mut self, now: PhysicalTime) {
        if self.phase != Phase::Running {
            return;
        }
        for federate in self.topology.federates() {
            let Some(watch) = &mut self.watch else { return };
            if !self.members[federate].is_live() || watch.due(federate) > now {
                continue;
            }
            let limit = watch.hang_timeout.limit;
            let liveness = &mut watch.liveness[federate];
            let silence = now.since(liveness.last_frame);
            if liveness.ping_sent.is_none() {
                liveness.ping_sent = Some(now);
                self.send(federate, Frame::Ping);
            } else if limit.is_some_and(|limit| silence >= limit) {
                self.give_up(federate, silence);
            } else {
                liveness.reported = true;
                self.outputs.push_back(RtiOutput::Silent { federate, silence });
            }
        }
    }

    fn give_up(&mut self, federate: FederateId, silence: Nanos) {
        let (name, time) = (self.topology.name(federate), show_silence(silence));
        let message = format!("federate {name} has not answered for {time}");
        if let Some(link) = self.members[federate].link() {
            self.outputs.push_back(RtiOutput::Close { link });
        }
        self.fail(federate, message, 1);
    }
}
