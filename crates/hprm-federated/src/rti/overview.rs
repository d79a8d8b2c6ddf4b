//! What the RTI knows of the federates, and why it does not let them advance: for watchers. Nothing is
//! decided here.

use hprm_core::{FederateId, PhysicalTime};

use super::ending::Negotiation;
use super::join::Member;
use super::{Phase, Rti};
use crate::{FederationPhase, Hold, MemberView, Standing, Step};

impl Rti {
    /// How far the federation has got.
    #[must_use]
    pub fn phase(&self) -> FederationPhase {
        match (&self.stop, self.phase) {
            _ if self.failed => FederationPhase::Failed,
            (_, Phase::Joining) => FederationPhase::Joining,
            (_, Phase::Loading) => FederationPhase::Loading,
            (Negotiation::Idle, Phase::Running) => FederationPhase::Running,
            (Negotiation::Asking { .. }, Phase::Running) => FederationPhase::Stopping,
            (Negotiation::Decided, Phase::Running) => FederationPhase::Ending,
        }
    }

    /// What the RTI knows of each federate, in the order of the program.
    pub fn members(&self, now: PhysicalTime) -> impl Iterator<Item = MemberView> {
        self.topology.federates().map(move |federate| self.member(federate, now))
    }

    fn member(&self, federate: FederateId, now: PhysicalTime) -> MemberView {
        let advance = &self.advance;
        MemberView {
            standing: self.standing(federate),
            transient: self.topology.is_transient(federate),
            next: advance.reported(federate),
            completed: advance.completed(federate),
            granted: advance.granted(federate),
            wanted: self.wanted(federate),
            holds: self.holds(federate),
            owes_stop_reply: self.owes_stop_reply(federate),
            silence: self.silence(federate, now),
        }
    }

    fn standing(&self, federate: FederateId) -> Standing {
        match &self.members[federate] {
            Member::Live { ready: None, .. } if self.phase != Phase::Running => Standing::Joined,
            Member::Live { .. } => Standing::Ready,
            _ if self.arrivals.has(federate) => Standing::Joined,
            Member::Absent => Standing::Absent,
            Member::Gone => Standing::Gone,
        }
    }

    /// What a federate wants to process next, if it needs a grant and has none.
    fn wanted(&self, federate: FederateId) -> Option<Step> {
        let lives = self.members[federate].is_live() && self.phase == Phase::Running;
        let asks = lives && !self.boards && !self.topology.upstream(federate).is_empty();
        self.advance.ungranted(federate).filter(|_| asks)
    }

    /// What the RTI waits for before it grants that.
    fn holds(&self, federate: FederateId) -> Vec<Hold> {
        let Some(wanted) = self.wanted(federate) else { return Vec::new() };
        let mut holds = self.in_transit();
        holds.extend(self.advance.arrivals_before(federate, wanted));
        if holds.is_empty() && self.topology.is_after_transient(federate) {
            holds.push(Hold::Due { tag: wanted.tag });
        }
        holds
    }

    /// The channels because of which the RTI grants nothing.
    fn in_transit(&self) -> Vec<Hold> {
        let lagging = self.traffic.lagging();
        let hold = |channel| {
            let receiver = self.topology.channels()[channel].to;
            Hold::InTransit { channel, receiver }
        };
        lagging.map(hold).collect()
    }

    fn owes_stop_reply(&self, federate: FederateId) -> bool {
        match &self.stop {
            Negotiation::Asking { answered, .. } => {
                self.members[federate].is_live() && !answered[federate]
            }
            Negotiation::Idle | Negotiation::Decided => false,
        }
    }
}
