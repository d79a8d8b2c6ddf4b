//! Transient federates: joining a federation that runs, leaving it, coming back, and taking over from
//! an instance that is still there.
//!
//! Who arrives loads its program first, so that a successor does not let anybody wait. Then the one
//! whose place it takes is asked to leave; then its neighbours are told, and answer from which tag on
//! they know of it; then it links to them, and is given the tag at which it starts. That is after
//! whatever the others have been granted in the belief that it is not there.

use std::collections::{BTreeMap, BTreeSet};

use hprm_core::{FederateId, Nanos, PhysicalTime, Tag};

use super::ending::Negotiation;
use super::join::Member;
use super::{LinkId, Phase, Rti, RtiOutput};
use crate::{Fault, Frame, Peer, Refusal};

/// How long the neighbours have to answer. One that is busy for longer misses the start of the
/// newcomer: what it sends before it has answered does not go there.
const INTRODUCTION: Nanos = 500_000_000;

/// How long a predecessor has to leave.
const DEPARTURE: Nanos = 2_000_000_000;

#[derive(Clone, PartialEq, Eq, Hash, Debug)]
enum Stage {
    /// It loads the program.
    Loading,
    /// The program is loaded. Its predecessor, if there is one, has until then to leave.
    Waiting { until: Option<PhysicalTime> },
    /// These have until then to answer.
    Meeting { unanswered: BTreeSet<FederateId>, until: PhysicalTime },
    /// It links to the others.
    Linking,
}

#[derive(Clone, PartialEq, Eq, Hash, Debug)]
struct Arrival {
    link: LinkId,
    peer: Peer,
    stage: Stage,
    /// The neighbours that have answered.
    met: BTreeSet<FederateId>,
    /// No neighbour has processed anything after this tag without it.
    after: Tag,
}

/// Who is arriving.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Default)]
pub(super) struct Arrivals {
    arrivals: BTreeMap<FederateId, Arrival>,
    /// Neighbours that have not answered in time, and who has started without them.
    strangers: BTreeSet<(FederateId, FederateId)>,
}

impl Arrivals {
    pub(super) fn add(&mut self, link: LinkId, peer: Peer) {
        let arrival = Arrival {
            link,
            stage: Stage::Loading,
            met: BTreeSet::new(),
            after: Tag::NEVER,
            peer: peer.clone(),
        };
        self.arrivals.insert(peer.federate, arrival);
    }

    pub(super) fn is_link_of(&self, federate: FederateId, link: LinkId) -> bool {
        self.arrivals.get(&federate).is_some_and(|arrival| arrival.link == link)
    }

    /// The link to a federate that is arriving, if `from` has answered.
    pub(super) fn link_of(&self, federate: FederateId, from: FederateId) -> Option<LinkId> {
        let arrival = self.arrivals.get(&federate)?;
        arrival.met.contains(&from).then_some(arrival.link)
    }

    /// Whether one of the two does not know yet that the other one is back.
    pub(super) fn are_strangers(&self, from: FederateId, to: FederateId) -> bool {
        self.strangers.contains(&(from, to)) || self.strangers.contains(&(to, from))
    }

    /// A federate has ended.
    pub(super) fn forget(&mut self, federate: FederateId) {
        self.strangers.retain(|(one, other)| *one != federate && *other != federate);
        for arrival in self.arrivals.values_mut() {
            if let Stage::Meeting { unanswered, .. } = &mut arrival.stage {
                unanswered.remove(&federate);
            }
        }
    }

    pub(super) fn next_wakeup(&self) -> Option<PhysicalTime> {
        let stages = self.arrivals.values().map(|arrival| &arrival.stage);
        let times = stages.filter_map(|stage| match stage {
            Stage::Waiting { until } => *until,
            Stage::Meeting { until, .. } => Some(*until),
            Stage::Loading | Stage::Linking => None,
        });
        times.min()
    }
}

impl Rti {
    /// Why a transient federate may not join any more, or not now.
    pub(super) fn late_refusal(&self, federate: FederateId) -> Option<Refusal> {
        let over = self.failed || self.ended || self.stop != Negotiation::Idle;
        if over || self.finished {
            return Some(Refusal::TooLate);
        }
        self.arrivals.arrivals.contains_key(&federate).then_some(Refusal::Duplicate)
    }

    /// A frame from a federate that is arriving.
    pub(super) fn arrival_frame(
        &mut self,
        federate: FederateId,
        frame: Frame,
    ) -> Result<(), Fault> {
        let unexpected = Err(Fault::Unexpected { frame: frame.name() });
        let Some(arrival) = self.arrivals.arrivals.get_mut(&federate) else {
            return unexpected;
        };
        match (frame, &arrival.stage) {
            (Frame::Loaded, Stage::Loading) => {
                arrival.stage = Stage::Waiting { until: None };
                self.admit_arrivals();
            }
            (Frame::Ready { .. }, Stage::Linking) => self.start_late(federate),
            (Frame::Met { .. }, _) => {}
            (Frame::Release { owner, reader, .. }, _) if reader != federate => {
                return Err(Fault::UnknownFederate(owner));
            }
            (frame @ Frame::Release { owner, .. }, _) if self.topology.has(owner) => {
                self.pass_on(federate, owner, frame);
            }
            (Frame::Failed { message, code, .. }, _) => {
                self.outputs.push_back(RtiOutput::Dropped { federate, message, code });
                self.withdraw(federate);
            }
            (Frame::Leave { .. }, _) => self.withdraw(federate),
            _ => return unexpected,
        }
        Ok(())
    }

    /// The link of a federate that is arriving has ended.
    pub(super) fn arrival_lost(&mut self, federate: FederateId, reason: Option<&str>) {
        let message = match reason {
            None => self.words_on_lost(federate),
            Some(reason) => self.words_on_broken(federate, reason),
        };
        self.outputs.push_back(RtiOutput::Dropped { federate, message, code: 1 });
        self.withdraw(federate);
    }

    /// A federate does not join after all.
    fn withdraw(&mut self, federate: FederateId) {
        let Some(arrival) = self.arrivals.arrivals.remove(&federate) else { return };
        if matches!(arrival.stage, Stage::Meeting { .. } | Stage::Linking) {
            self.send_gone(federate);
            self.tell();
        }
    }

    /// The federation ends: nobody may join any more.
    pub(super) fn turn_away(&mut self) {
        for (federate, arrival) in std::mem::take(&mut self.arrivals.arrivals) {
            self.refuse(arrival.link, self.topology.name(federate), Refusal::TooLate);
            if matches!(arrival.stage, Stage::Meeting { .. } | Stage::Linking) {
                self.send_gone(federate);
            }
        }
    }

    /// A transient federate cannot go on. The others do.
    pub(super) fn dropped(&mut self, federate: FederateId, message: String, code: i32) {
        self.outputs.push_back(RtiOutput::Dropped { federate, message, code });
        if self.phase == Phase::Running {
            self.gone(federate);
            return;
        }
        self.members[federate] = Member::Absent;
        self.send_gone(federate);
        self.gather();
        self.start_together();
    }

    /// Goes on with everybody who is arriving, as far as that is possible.
    pub(super) fn admit_arrivals(&mut self) {
        if self.phase != Phase::Running {
            return;
        }
        let arriving: Vec<_> = self.arrivals.arrivals.keys().copied().collect();
        for federate in arriving {
            self.replace(federate);
            self.link_up(federate);
        }
    }

    /// Time has passed: those who have not left or answered in time are not waited for.
    pub(super) fn hurry_arrivals(&mut self) {
        let now = self.now;
        let mut late = Vec::new();
        for (federate, arrival) in &mut self.arrivals.arrivals {
            match &mut arrival.stage {
                Stage::Waiting { until: Some(until) } if *until <= now => late.push(*federate),
                Stage::Meeting { unanswered, until } if *until <= now => {
                    let missing = std::mem::take(unanswered);
                    self.arrivals.strangers.extend(missing.into_iter().map(|m| (m, *federate)));
                }
                _ => {}
            }
        }
        for federate in late {
            if let Some(link) = self.members[federate].link() {
                self.outputs.push_back(RtiOutput::Close { link });
                let name = self.topology.name(federate);
                let message = format!("federate {name} did not leave for its successor in time");
                self.dropped(federate, message, 1);
            }
        }
        self.admit_arrivals();
    }

    /// Asks the predecessor of a federate that has loaded its program to leave, and introduces it to
    /// its neighbours if there is none.
    fn replace(&mut self, federate: FederateId) {
        let Some(arrival) = self.arrivals.arrivals.get_mut(&federate) else { return };
        let Stage::Waiting { until } = &mut arrival.stage else { return };
        if !self.members[federate].is_live() {
            self.introduce(federate);
        } else if until.is_none() {
            *until = Some(self.now.plus(DEPARTURE));
            self.dismiss(federate, Tag::START);
        }
    }

    /// Tells a federate to leave: at the next tag at which nobody can be surprised by that, `least` or
    /// later.
    pub(super) fn dismiss(&mut self, federate: FederateId, least: Tag) {
        let tag = self.entry(federate).max(least);
        self.advance.depart(&self.topology, federate, tag);
        self.send(federate, Frame::Depart { tag });
        self.tell();
    }

    /// Tells the neighbours of a federate that it is about to join.
    fn introduce(&mut self, federate: FederateId) {
        let neighbours = self.topology.neighbours(federate).iter().copied();
        let unanswered: BTreeSet<_> = neighbours.filter(|n| self.members[*n].is_live()).collect();
        let Some(arrival) = self.arrivals.arrivals.get_mut(&federate) else { return };
        let frame = Frame::Joining { peer: arrival.peer.clone() };
        let until = self.now.plus(INTRODUCTION);
        arrival.stage = Stage::Meeting { unanswered: unanswered.clone(), until };
        for neighbour in unanswered {
            self.send(neighbour, frame.clone());
        }
    }

    /// Introduces the others to a federate of which all neighbours know.
    fn link_up(&mut self, federate: FederateId) {
        let Some(arrival) = self.arrivals.arrivals.get_mut(&federate) else { return };
        match &arrival.stage {
            Stage::Meeting { unanswered, .. } if unanswered.is_empty() => {}
            _ => return,
        }
        arrival.stage = Stage::Linking;
        let link = arrival.link;
        let mut peers = self.peers();
        // There is no link to who has not answered; messages by way of the RTI need none.
        let strangers = &self.arrivals.strangers;
        let centralized = self.is_centralized();
        peers.retain(|peer| centralized || !strangers.contains(&(peer.federate, federate)));
        self.outputs.push_back(RtiOutput::Send { link, frame: Frame::Peers { peers } });
    }

    /// A neighbour knows of a federate that is arriving, or has arrived.
    pub(super) fn met(&mut self, neighbour: FederateId, federate: FederateId, after: Tag) {
        if self.arrivals.strangers.remove(&(neighbour, federate)) {
            self.traffic.meet(&self.topology, neighbour, federate);
            let Member::Live { host, listen, .. } = &self.members[neighbour] else { return };
            let peer = Peer { federate: neighbour, host: *host, listen: listen.clone() };
            if !self.is_centralized() {
                self.send(federate, Frame::Joining { peer });
                let first = self.advance.first(federate);
                self.send(neighbour, Frame::Joined { federate, first });
            }
            return;
        }
        let Some(arrival) = self.arrivals.arrivals.get_mut(&federate) else { return };
        if let Stage::Meeting { unanswered, .. } = &mut arrival.stage
            && unanswered.remove(&neighbour)
        {
            arrival.met.insert(neighbour);
            arrival.after = arrival.after.max(after);
            self.traffic.meet(&self.topology, neighbour, federate);
            self.link_up(federate);
        }
    }

    /// The earliest tag at which a federate may join, or must leave.
    fn entry(&self, federate: FederateId) -> Tag {
        let elapsed = self.now.since(self.start).max(0);
        // Decentralized, nobody waits for it: its first messages should not come too late.
        let margin = if self.is_centralized() { 0 } else { self.start_delay };
        Tag::new(elapsed.saturating_add(margin), 0)
            .max(self.advance.entry(&self.topology, federate))
    }

    /// A federate has linked to the others, and starts.
    fn start_late(&mut self, federate: FederateId) {
        let entry = self.entry(federate);
        let Some(Arrival { link, peer, after, .. }) = self.arrivals.arrivals.remove(&federate)
        else {
            return;
        };
        let first = entry.max(after.succ());
        if first > self.topology.timeout() {
            self.refuse(link, self.topology.name(federate), Refusal::TooLate);
            self.send_gone(federate);
            self.tell();
            return;
        }
        let Peer { host, listen, .. } = peer;
        self.members[federate] = Member::Live { link, host, listen, ready: Some(self.now) };
        self.heard(federate, self.now);
        self.advance.join(&self.topology, federate, first);
        let at = self.start;
        self.outputs.push_back(RtiOutput::Send { link, frame: Frame::Start { at, first } });
        let neighbours: Vec<_> = self.topology.neighbours(federate).iter().copied().collect();
        for neighbour in neighbours {
            self.send(neighbour, Frame::Joined { federate, first });
        }
        self.tell();
    }
}
