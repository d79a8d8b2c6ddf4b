//! Who is silent: a federate that does not answer for a while may hang, or compute for long. From
//! here that looks the same, so it is reported, and it is the user's decision whether it is a failure.
//!
//! A federate that has ended, or whose link has, is not silent; that is noticed elsewhere.

use hprm_core::{FederateId, Nanos, PhysicalTime, Table};

use super::{Phase, Rti, RtiOutput};
use crate::Frame;

/// How long a federate may say nothing before it is asked whether it is there.
const QUIET: Nanos = 1_000_000_000;

/// How long it may say nothing before that is reported.
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

    /// When something is to be done about a federate that stays silent.
    fn due(&self, federate: FederateId) -> PhysicalTime {
        let Pulse { heard, asked, reported } = self.pulses[federate];
        let Some(asked) = asked else { return heard.plus(self.quiet()) };
        let report = if reported { PhysicalTime::FOREVER } else { heard.plus(SILENCE) };
        let limit = self.patience.limit.map_or(PhysicalTime::FOREVER, |limit| heard.plus(limit));
        // Whoever has been asked late, because the RTI itself stood still, may answer first.
        report.min(limit).max(asked.plus(self.quiet()))
    }

    /// How long a federate may say nothing before it is asked, and has at least to answer.
    fn quiet(&self) -> Nanos {
        self.patience.limit.map_or(QUIET, |limit| QUIET.min(limit / 2))
    }
}

impl Rti {
    /// Has the RTI watch who is silent.
    #[must_use]
    pub fn watching(mut self, patience: Patience) -> Self {
        self.watch = Some(Watch::new(self.members.len(), patience));
        self
    }

    /// Something has come from a federate.
    pub(super) fn heard(&mut self, federate: FederateId, now: PhysicalTime) {
        let Some(watch) = &mut self.watch else { return };
        let silence = now.since(watch.pulses[federate].heard);
        let pulse = Pulse { heard: now, asked: None, reported: false };
        let before = std::mem::replace(&mut watch.pulses[federate], pulse);
        if before.reported {
            self.outputs.push_back(RtiOutput::Answers { federate, silence });
        }
    }

    /// Everybody has been heard now.
    pub(super) fn heard_all(&mut self, now: PhysicalTime) {
        self.topology.federates().for_each(|federate| self.heard(federate, now));
    }

    /// When somebody's silence is worth an action.
    pub(super) fn next_silence(&self) -> Option<PhysicalTime> {
        let watch = self.watch.as_ref().filter(|_| self.phase == Phase::Running)?;
        let live = self.members.iter().filter(|(_, member)| member.is_live());
        let due = live.map(|(federate, _)| watch.due(federate)).min()?;
        Some(due).filter(|due| *due < PhysicalTime::FOREVER)
    }

    /// Asks, reports and gives up those that are silent.
    pub(super) fn look_after(&mut self, now: PhysicalTime) {
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
