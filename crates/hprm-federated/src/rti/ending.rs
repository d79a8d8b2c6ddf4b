//! How a federation ends: agreeing on a last tag, federates that resign, and federates that fail.

use hprm_core::{FederateId, Table, Tag};

use super::join::Member;
use super::{Phase, Rti, RtiOutput};
use crate::{Fault, Frame, Refusal};

/// Agreeing on a last tag. A federate that has answered stays before the tag that it named.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(super) enum Negotiation {
    /// No federate has asked to stop.
    Idle,
    /// A federate or the user has asked; these federates have answered, and the last tag is at least
    /// `latest`.
    Asking { latest: Tag, answered: Table<FederateId, bool> },
    /// The last tag is decided.
    Decided,
}

/// The exit code that the RTI reports for a federate whose link ended without a `Resign`.
const LOST: i32 = 1;

impl Rti {
    /// A federate asks to stop. A second one, while the RTI asks the others, is among those and will
    /// answer; its request only counts as a lower bound.
    ///
    /// A federate that has resigned has processed the last tag of the program. Then that tag holds for
    /// the others too: there is one last tag for all.
    pub(super) fn stop_request(&mut self, from: FederateId, tag: Tag) {
        let tag = if self.ended { Tag::FOREVER } else { tag.max(self.latest_departure.succ()) };
        match &mut self.stop {
            Negotiation::Decided => return,
            Negotiation::Asking { latest, .. } => *latest = (*latest).max(tag),
            Negotiation::Idle => {
                self.refuse_arrivals();
                let mut answered = Table::filled(self.members.len(), false);
                answered[from] = true;
                self.stop = Negotiation::Asking { latest: tag, answered };
                for federate in self.topology.federates().filter(|federate| *federate != from) {
                    self.send(federate, Frame::StopRequest { tag });
                }
            }
        }
        self.decide();
    }

    /// The user, or a program that is no federate, asks to stop, as soon as all federates can. A
    /// federation that has not started does not start any more.
    pub(super) fn request_stop(&mut self) {
        if self.phase == Phase::Running {
            self.ask_to_stop(Tag::START);
        } else if !self.failed {
            self.refuse_all(&Refusal::Stopped);
        }
    }

    /// The federation does not start: refuses all federates that have joined or want to join.
    pub(super) fn refuse_all(&mut self, reason: &Refusal) {
        self.failed = true;
        let candidates = std::mem::take(&mut self.candidates).into_keys();
        let links = self.members.values().filter_map(Member::link).chain(candidates);
        let links: Vec<_> = links.collect();
        self.topology.federates().for_each(|federate| self.members[federate] = Member::Gone);
        for link in links {
            self.send_refusal(link, reason.clone());
        }
        self.finish();
    }

    /// Asks all federates to stop, at `tag` at the earliest.
    pub(super) fn ask_to_stop(&mut self, tag: Tag) {
        self.refuse_arrivals();
        if self.stop == Negotiation::Idle {
            let answered = Table::filled(self.members.len(), false);
            let latest =
                if self.ended { Tag::FOREVER } else { tag.max(self.latest_departure.succ()) };
            self.stop = Negotiation::Asking { latest, answered };
            self.send_all(&Frame::StopRequest { tag: latest });
        }
        self.decide();
    }

    /// A federate answers.
    pub(super) fn stop_reply(&mut self, from: FederateId, tag: Tag) -> Result<(), Fault> {
        match &mut self.stop {
            Negotiation::Asking { latest, answered } if !answered[from] => {
                *latest = (*latest).max(tag);
                answered[from] = true;
            }
            _ => return Err(Fault::Unexpected { frame: "StopReply" }),
        }
        self.decide();
        Ok(())
    }

    /// Announces the last tag if all federates that have not ended have answered.
    fn decide(&mut self) {
        let Negotiation::Asking { latest, answered } = &self.stop else {
            return;
        };
        let waits =
            |(federate, member): (FederateId, &Member)| member.is_live() && !answered[federate];
        if self.members.iter().any(waits) {
            return;
        }
        let tag = *latest;
        self.stop = Negotiation::Decided;
        self.send_all(&Frame::StopGranted { tag });
        self.advance.stop_at(&self.topology, tag);
        self.send_grants();
    }

    /// A federate has completed the last tag.
    pub(super) fn resigned(&mut self, federate: FederateId) {
        self.ended = true;
        self.refuse_arrivals();
        if self.boards {
            // It has relied on those upstream to the end, and those may ask to leave after this.
            self.advance.completed_all(federate);
        }
        if let Negotiation::Asking { latest, .. } = &mut self.stop {
            *latest = Tag::FOREVER;
        }
        self.gone(federate, true);
    }

    /// A federate has ended before the last tag of the program, which is after its own.
    pub(super) fn left(&mut self, federate: FederateId, tag: Tag) {
        self.latest_departure = self.latest_departure.max(tag);
        self.advance.left(federate, tag);
        if let Negotiation::Asking { latest, .. } = &mut self.stop {
            *latest = (*latest).max(tag.succ());
        }
        self.gone(federate, true);
    }

    /// A federate has ended, at the last tag or before, and the others go on.
    pub(super) fn gone(&mut self, federate: FederateId, in_order: bool) {
        self.members[federate] = Member::Gone;
        self.announce_end(federate, in_order);
        self.arrivals.forget(federate);
        self.forget_departure(federate);
        self.send_grants();
        self.decide();
        self.end_if_starved();
        self.admit_arrivals();
        self.finish();
    }

    /// A federate's link has ended. Before all have joined, no other federate knows it, so it may join
    /// again.
    pub(super) fn lost(&mut self, federate: FederateId) {
        if !self.members[federate].is_live() {
            return;
        }
        if self.is_joining() && !self.topology.is_transient(federate) {
            self.leaves_before_start(federate);
        } else {
            let message = self.lost_message(federate);
            self.fail(federate, message, LOST);
        }
    }

    /// A federate leaves before all have joined, and may join again.
    pub(super) fn leaves_before_start(&mut self, federate: FederateId) {
        self.members[federate] = Member::Absent;
        self.left_early.insert(federate);
        self.outputs.push_back(RtiOutput::Left { federate });
    }

    pub(super) fn lost_message(&self, federate: FederateId) -> String {
        let when = match self.phase {
            Phase::Joining | Phase::Loading => "before the federation started",
            Phase::Running => "before its last tag",
        };
        format!("the process of federate {} ended {when}", self.topology.name(federate))
    }

    /// The link of a federate cannot be used: the federate breaks the protocol, which is a defect of HPRM or an
    /// attack, or memory is short.
    pub(super) fn broken(&mut self, federate: FederateId, message: String) {
        if self.members[federate].is_live() {
            self.fail(federate, message, LOST);
        }
    }

    /// A federate cannot go on, so the federation cannot, unless the federate is transient. The RTI
    /// reports only the first failure: the others fail because the RTI told them to end.
    pub(super) fn fail(&mut self, federate: FederateId, message: String, code: i32) {
        if self.topology.is_transient(federate) && !self.failed {
            self.dropped(federate, message, code);
            return;
        }
        self.members[federate] = Member::Gone;
        if !std::mem::replace(&mut self.failed, true) {
            self.refuse_arrivals();
            self.send_all(&Frame::Failed { federate, message: message.clone(), code });
            self.outputs.push_back(RtiOutput::Failed { federate, message, code });
        }
        self.finish();
    }

    fn finish(&mut self) {
        let over = self.failed || self.phase == Phase::Running;
        if over && !self.finished && !self.members.values().any(Member::is_live) {
            self.finished = true;
            self.outputs.push_back(RtiOutput::Finished);
        }
    }
}
