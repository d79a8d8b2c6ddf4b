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
pub struct Patience {
    /// The longest silence, in nanoseconds.
    pub limit: Option<Nanos>,
}

#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
struct Pulse {
    heard: PhysicalTime,
    asked: Option<PhysicalTime>,
    reported: bool,
}

/// See the module.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(super) struct Watch {
    patience: Patience,
    pulses: Table<FederateId, Pulse>,
}

impl Watch {
    pub(super) fn new(federates: usize, patience: Patience) -> Self {
        let pulse = Pulse { heard: PhysicalTime(0), asked: None, reported: false };
        Self { patience, pulses: Table::filled(federates, pulse) }
    }

    /// When the RTI has to act if a federate stays silent.
    fn due(&self, federate: FederateId) -> PhysicalTime {
        let Pulse { heard, asked, reported } = self.pulses[federate];
        let Some(asked) = asked else { return heard.plus(self.ping()) };
        let report = if reported { PhysicalTime::FOREVER } else { heard.plus(SILENCE) };
        let limit = self.patience.limit.map_or(PhysicalTime::FOREVER, |limit| heard.plus(limit));
        // If the RTI itself stood still, it has asked late; then the federate may answer first.
        report.min(limit).max(asked.plus(self.ping()))
    }

    /// After how long a silence the RTI sends a `Ping`, and how long at least a federate has to answer.
    fn ping(&self) -> Nanos {
        self.patience.limit.map_or(PING, |limit| PING.min(limit / 2))
    }
}

impl Rti {
    /// Makes the RTI watch for silent federates.
    #[must_use]
    pub fn watching(mut self, patience: Patience) -> Self {
        self.watch = Some(Watch::new(self.members.len(), patience));
        self
    }

    /// A frame, or a part of one, has come from a federate.
    pub(super) fn heard(&mut self, federate: FederateId, now: PhysicalTime) {
        let Some(watch) = &mut self.watch else { return };
        let silence = now.since(watch.pulses[federate].heard);
        let pulse = Pulse { heard: now, asked: None, reported: false };
        let before = std::mem::replace(&mut watch.pulses[federate], pulse);
        if before.reported {
            self.outputs.push_back(RtiOutput::Answers { federate, silence });
        }
    }

    /// All federates count as heard now.
    pub(super) fn heard_all(&mut self, now: PhysicalTime) {
        self.topology.federates().for_each(|federate| self.heard(federate, now));
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
            let limit = watch.patience.limit;
            let pulse = &mut watch.pulses[federate];
            let silence = now.since(pulse.heard);
            if pulse.asked.is_none() {
                pulse.asked = Some(now);
                self.send(federate, Frame::Ping);
            } else if limit.is_some_and(|limit| silence >= limit) {
                self.give_up(federate, silence);
            } else {
                pulse.reported = true;
                self.outputs.push_back(RtiOutput::Silent { federate, silence });
            }
        }
    }

    fn give_up(&mut self, federate: FederateId, silence: Nanos) {
        let seconds = silence / 1_000_000_000;
        let name = self.topology.name(federate);
        let message = format!("federate {name} has not answered for {seconds} s");
        if let Some(link) = self.members[federate].link() {
            self.outputs.push_back(RtiOutput::Close { link });
        }
        self.fail(federate, message, 1);
    }
}
