//! Transient federates: joining a running federation, leaving it, joining it again, and replacing an
//! instance that still runs.
//!
//! An arriving federate loads its program first, so that no other federate waits for that. If an earlier
//! instance of the federate still runs, its predecessor, the RTI then tells that instance to leave. Next the
//! RTI tells the neighbours, and each neighbour answers from which tag on it takes the arriving federate into
//! account. Then the arriving federate links to the others, and the RTI gives it the tag at which it starts.
//! This tag is after all grants that the RTI made while the federate was absent.

use std::collections::{BTreeMap, BTreeSet};

use hprm_core::{FederateId, Nanos, PhysicalTime, Tag};

use super::ending::Negotiation;
use super::join::Member;
use super::{LinkId, Phase, Rti, RtiOutput};
use crate::{Fault, Frame, Peer, Refusal};

/// How long a predecessor has to leave.
const DEPARTURE: Nanos = 2_000_000_000;

/// How long an arriving federate may take to link to the others, which may be on other machines.
const LINKING: Nanos = 10_000_000_000;

/// The most by which the RTI postpones the start of a federate each time, while a receiver is busy.
const LONGEST_MARGIN: Nanos = 1_000_000_000;

/// The least time that receivers have to answer before the RTI postpones the start.
const SHORTEST_ANSWER: Nanos = 1_000;

/// How far an arriving federate has come.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
enum Stage {
    /// The federate loads its program.
    Loading,
    /// The program is loaded. If there is a predecessor, the RTI has told it to leave, and it has until then.
    Waiting { until: Option<PhysicalTime> },
    /// The RTI has told the neighbours. These have not answered yet that they know of the federate.
    Meeting { unanswered: BTreeSet<FederateId> },
    /// The federate links to the others, and has time to do so until then.
    Linking { until: PhysicalTime },
    /// The federate could start at `first`. The `unanswered` receivers have not answered yet that they wait
    /// for its messages from that tag on. If they have not at `until`, the RTI postpones the start by
    /// `margin`.
    Agreeing { unanswered: BTreeSet<FederateId>, first: Tag, until: PhysicalTime, margin: Nanos },
}

#[derive(Clone, PartialEq, Eq, Hash, Debug)]
struct Arrival {
    link: LinkId,
    peer: Peer,
    launched: bool,
    stage: Stage,
    /// The neighbours that have answered: they know of the federate, and may send to it.
    met: BTreeSet<FederateId>,
    /// The federate starts after this tag: up to it, neighbours may have processed tags without the federate.
    after: Tag,
}

impl Arrival {
    /// Whether the RTI has told the neighbours of the federate.
    fn is_known(&self) -> bool {
        !matches!(self.stage, Stage::Loading | Stage::Waiting { .. })
    }
}

/// The transient federates that are joining the running federation.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Default)]
pub(super) struct Arrivals(BTreeMap<FederateId, Arrival>);

impl Arrivals {
    pub(super) fn add(&mut self, link: LinkId, peer: Peer, launched: bool) {
        let arrival = Arrival {
            link,
            launched,
            stage: Stage::Loading,
            met: BTreeSet::new(),
            after: Tag::NEVER,
            peer: peer.clone(),
        };
        self.0.insert(peer.federate, arrival);
    }

    /// Whether the federate is joining.
    pub(super) fn has(&self, federate: FederateId) -> bool {
        self.0.contains_key(&federate)
    }

    pub(super) fn is_link_of(&self, federate: FederateId, link: LinkId) -> bool {
        self.0.get(&federate).is_some_and(|arrival| arrival.link == link)
    }

    /// The link to an arriving federate, if its neighbour `from` knows of it.
    pub(super) fn link_of(&self, federate: FederateId, from: FederateId) -> Option<LinkId> {
        let arrival = self.0.get(&federate)?;
        arrival.met.contains(&from).then_some(arrival.link)
    }

    /// The link to an arriving federate, if the RTI has told it its peers.
    pub(super) fn link_of_linking(&self, federate: FederateId) -> Option<LinkId> {
        let arrival = self.0.get(&federate)?;
        let knows = matches!(arrival.stage, Stage::Linking { .. } | Stage::Agreeing { .. });
        knows.then_some(arrival.link)
    }

    /// A federate has ended: no arriving federate waits for its answer any more.
    pub(super) fn forget(&mut self, federate: FederateId) {
        for arrival in self.0.values_mut() {
            if let Stage::Meeting { unanswered } | Stage::Agreeing { unanswered, .. } =
                &mut arrival.stage
            {
                unanswered.remove(&federate);
            }
        }
    }

    pub(super) fn next_wakeup(&self) -> Option<PhysicalTime> {
        let times = self.0.values().filter_map(|arrival| match arrival.stage {
            Stage::Waiting { until } => until,
            Stage::Linking { until } | Stage::Agreeing { until, .. } => Some(until),
            Stage::Loading | Stage::Meeting { .. } => None,
        });
        times.min()
    }
}

impl Rti {
    /// Whether the federation ends, so that no federate may join any more.
    #[must_use]
    pub fn is_closing(&self) -> bool {
        self.failed || self.ended || self.stop != Negotiation::Idle || self.finished
    }

    /// Why a transient federate may not join any more, or not now. What a launcher starts takes no place that a process
    /// has which a user has started.
    pub(super) fn late_refusal(&self, federate: FederateId, launched: bool) -> Option<Refusal> {
        if self.is_closing() {
            return Some(Refusal::TooLate);
        }
        let member = &self.members[federate];
        let is_taken = launched && matches!(member, Member::Live { launched: false, .. });
        (is_taken || self.arrivals.0.contains_key(&federate)).then_some(Refusal::Duplicate)
    }

    /// A frame from an arriving federate.
    pub(super) fn arrival_frame(
        &mut self,
        federate: FederateId,
        frame: Frame,
    ) -> Result<(), Fault> {
        let unexpected = Err(Fault::Unexpected { frame: frame.name() });
        let Some(arrival) = self.arrivals.0.get_mut(&federate) else {
            return unexpected;
        };
        match (frame, &arrival.stage) {
            (Frame::Loaded, Stage::Loading) => {
                arrival.stage = Stage::Waiting { until: None };
                self.admit_arrivals();
            }
            (Frame::Ready { .. }, Stage::Linking { .. }) => self.agree(federate),
            (Frame::Met { .. }, _) => {}
            (frame @ Frame::Board { owner, reader, .. }, Stage::Linking { .. })
                if owner == federate && self.topology.has(reader) =>
            {
                self.forward(federate, reader, frame);
            }
            (Frame::Release { owner, reader, .. }, _) if reader != federate => {
                return Err(Fault::UnknownFederate(owner));
            }
            (frame @ Frame::Release { owner, .. }, _) if self.topology.has(owner) => {
                self.forward(federate, owner, frame);
            }
            (Frame::Failed { message, code, .. }, _) => {
                self.withdraw(federate, Some((message, code)));
            }
            (Frame::Leave { .. }, _) => self.withdraw(federate, None),
            _ => return unexpected,
        }
        Ok(())
    }

    /// The link of a federate that is arriving has ended.
    pub(super) fn arrival_lost(&mut self, federate: FederateId, message: Option<String>) {
        let message = message.unwrap_or_else(|| self.lost_message(federate));
        self.withdraw(federate, Some((message, 1)));
    }

    /// Forgets an arriving federate, which does not join after all, perhaps because of a `failure`.
    pub(super) fn withdraw(&mut self, federate: FederateId, failure: Option<(String, i32)>) {
        let Some(arrival) = self.arrivals.0.remove(&federate) else { return };
        self.outputs.push_back(RtiOutput::Withdrawn { federate, failure });
        if arrival.is_known() {
            self.announce_end(federate, false);
            self.forget_departure(federate);
            self.send_grants();
        }
        self.admit_arrivals();
    }

    /// The federation ends: the RTI refuses all arriving federates.
    pub(super) fn refuse_arrivals(&mut self) {
        for (federate, arrival) in std::mem::take(&mut self.arrivals.0) {
            self.refuse(arrival.link, self.topology.name(federate), Refusal::TooLate);
            self.outputs.push_back(RtiOutput::Withdrawn { federate, failure: None });
            if arrival.is_known() {
                self.announce_end(federate, false);
                self.forget_departure(federate);
            }
        }
    }

    /// A transient federate could not continue. The others continue without it.
    pub(super) fn dropped(&mut self, federate: FederateId, message: String, code: i32) {
        self.outputs.push_back(RtiOutput::Dropped { federate, message, code });
        if self.phase == Phase::Running {
            self.gone(federate, false);
            return;
        }
        self.members[federate] = Member::Absent;
        self.announce_end(federate, false);
        self.load_together();
        self.start_together();
    }

    /// Takes each arriving federate through as many stages as is possible now.
    pub(super) fn admit_arrivals(&mut self) {
        if self.phase != Phase::Running {
            return;
        }
        let arriving: Vec<_> = self.arrivals.0.keys().copied().collect();
        for federate in arriving {
            self.replace_predecessor(federate);
            self.link_up(federate);
            self.start_late(federate);
        }
    }

    /// Applies the time limits of arriving federates: drops a predecessor that has not left in time and an
    /// arriving federate that has not linked in time, and postpones a start that receivers have not confirmed.
    pub(super) fn apply_arrival_limits(&mut self) {
        let now = self.now;
        let due = self.arrivals.0.iter().filter_map(|(federate, arrival)| {
            let until = match arrival.stage {
                Stage::Waiting { until } => until?,
                Stage::Linking { until } | Stage::Agreeing { until, .. } => until,
                Stage::Loading | Stage::Meeting { .. } => return None,
            };
            (until <= now).then(|| (*federate, arrival.stage.clone(), arrival.link))
        });
        let due: Vec<_> = due.collect();
        for (federate, stage, link) in due {
            let name = self.topology.name(federate);
            match stage {
                Stage::Waiting { .. } => {
                    if let Some(link) = self.members[federate].link() {
                        self.outputs.push_back(RtiOutput::Close { link });
                        let message =
                            format!("federate {name} did not leave for its successor in time");
                        self.dropped(federate, message, 1);
                    }
                }
                Stage::Linking { .. } => {
                    self.outputs.push_back(RtiOutput::Close { link });
                    let message = format!("federate {name} did not link to the others in time");
                    self.withdraw(federate, Some((message, 1)));
                }
                _ => self.offer_start(federate),
            }
        }
        self.admit_arrivals();
    }

    /// Tells the predecessor of an arriving federate that has loaded its program to leave. If no predecessor
    /// runs, the RTI introduces the arriving federate to its neighbours. Of two neighbours that arrive at the
    /// same time, one waits for the other: the RTI can introduce a federate only to those that have joined.
    fn replace_predecessor(&mut self, federate: FederateId) {
        let concerned = self.concerned_by(federate);
        let joining = |(other, arrival): (&FederateId, &Arrival)| {
            arrival.is_known() && concerned.contains(other)
        };
        let waits = self.arrivals.0.iter().any(joining);
        let Some(arrival) = self.arrivals.0.get_mut(&federate) else { return };
        let Stage::Waiting { until } = &mut arrival.stage else { return };
        if !self.members[federate].is_live() {
            // The predecessor, if there was one, has left in time.
            *until = None;
            if !waits {
                self.introduce(federate);
            }
        } else if until.is_none() {
            *until = Some(self.now.plus(DEPARTURE));
            match self.boards {
                true => self.tell_to_ask(federate),
                false => self.tell_to_leave(federate, Tag::START),
            }
        }
    }

    /// Tells a federate to leave at the earliest tag for which no other federate relies on its reports yet,
    /// but not before `least`. A federate that has been told keeps that tag, unless it has passed it: what it
    /// asked for and what it is told may cross in transit, and it answers if it leaves later than it is told.
    pub(super) fn tell_to_leave(&mut self, federate: FederateId, least: Tag) {
        let told = self.advance.told_to_leave(federate);
        let tag = told.unwrap_or_else(|| self.entry_tag(federate)).max(least);
        self.advance.depart(&self.topology, federate, tag);
        if told.is_none() {
            self.send(federate, Frame::Depart { tag });
        }
        self.send_grants();
    }

    /// Tells a federate to ask at which tag it may leave, because others have read its board.
    fn tell_to_ask(&mut self, federate: FederateId) {
        let Some(incarnation) = self.members[federate].link().map(|link| link.0) else { return };
        self.send(federate, Frame::Departing { federate, incarnation });
    }

    /// Tells the neighbours of an arriving federate that it is about to join.
    fn introduce(&mut self, federate: FederateId) {
        let concerned = self.concerned_by(federate).into_iter();
        let unanswered: BTreeSet<_> = concerned.filter(|n| self.members[*n].is_live()).collect();
        let Some(arrival) = self.arrivals.0.get_mut(&federate) else { return };
        let frame = Frame::Joining { peer: arrival.peer.clone() };
        arrival.stage = Stage::Meeting { unanswered: unanswered.clone() };
        for neighbour in unanswered {
            self.send(neighbour, frame.clone());
        }
    }

    /// Once all neighbours know of an arriving federate, sends it what it needs to link to the others.
    fn link_up(&mut self, federate: FederateId) {
        let Some(arrival) = self.arrivals.0.get_mut(&federate) else { return };
        match &arrival.stage {
            Stage::Meeting { unanswered } if unanswered.is_empty() => {}
            _ => return,
        }
        arrival.stage = Stage::Linking { until: self.now.plus(LINKING) };
        let (link, own) = (arrival.link, arrival.peer.clone());
        let boards = self.boards;
        let peers = self.peers().into_iter().chain(Some(own).filter(|_| boards)).collect();
        self.outputs.push_back(RtiOutput::Send { link, frame: Frame::Peers { peers, boards } });
    }

    /// A neighbour has answered that it knows of an arriving federate, or waits for the federate's messages. It
    /// may have processed tags up to `tag` without them.
    pub(super) fn neighbour_answered(
        &mut self,
        neighbour: FederateId,
        federate: FederateId,
        incarnation: u32,
        tag: Tag,
    ) {
        let Some(arrival) = self.arrivals.0.get_mut(&federate) else { return };
        // The answer may be about an earlier process, which does not join any more.
        if arrival.peer.incarnation != incarnation {
            return;
        }
        let (Stage::Meeting { unanswered } | Stage::Agreeing { unanswered, .. }) =
            &mut arrival.stage
        else {
            return;
        };
        if !unanswered.remove(&neighbour) {
            return;
        }
        arrival.after = arrival.after.max(tag);
        if arrival.met.insert(neighbour) {
            self.traffic.meet(&self.topology, neighbour, federate);
            if !self.is_centralized() {
                // It may not have counted all messages of the predecessor, and reports again.
                self.advance.forget_report(&self.topology, neighbour);
            }
        }
        self.link_up(federate);
        self.start_late(federate);
    }

    /// The earliest tag at which a federate may join, or must leave.
    fn entry_tag(&self, federate: FederateId) -> Tag {
        let elapsed = self.now.since(self.start).max(0);
        // Under decentralized coordination no federate waits yet for the messages of an arriving federate. The
        // margin is time for the first ones to arrive, so that they are not tardy.
        let margin = if self.is_centralized() { 0 } else { self.start_delay };
        Tag::new(elapsed.saturating_add(margin), 0)
            .max(self.advance.entry(&self.topology, federate))
    }

    /// An arriving federate has linked to the others. Under centralized coordination it can start at once: no
    /// federate advances without a grant. Under decentralized coordination its receivers have to answer
    /// that they wait for its messages.
    fn agree(&mut self, federate: FederateId) {
        let receivers: Vec<_> = match self.boards {
            true => self.concerned_by(federate),
            false => self.topology.downstream(federate).iter().map(|edge| edge.federate).collect(),
        };
        let live = receivers.into_iter().filter(|receiver| self.members[*receiver].is_live());
        let unanswered = match self.is_centralized() {
            true => BTreeSet::new(),
            false => live.filter(|receiver| *receiver != federate).collect(),
        };
        let Some(arrival) = self.arrivals.0.get_mut(&federate) else { return };
        let (until, margin) = (self.now, self.start_delay.max(0));
        arrival.stage = Stage::Agreeing { unanswered, first: Tag::NEVER, until, margin };
        self.offer_start(federate);
        self.start_late(federate);
    }

    /// Announces the tag at which an arriving federate could start; from that tag on the others take it into
    /// account. They continue meanwhile: while a receiver is busy and does not answer, the RTI postpones the
    /// tag again and again.
    fn offer_start(&mut self, federate: FederateId) {
        let entry = self.entry_tag(federate);
        let Some(arrival) = self.arrivals.0.get_mut(&federate) else { return };
        let Stage::Agreeing { first, until, margin, .. } = &mut arrival.stage else { return };
        let later = if *first == Tag::NEVER { 0 } else { *margin };
        let tag =
            Tag::new(entry.time.saturating_add(later), entry.microstep).max(arrival.after.succ());
        (*first, *until) = (tag, self.now.plus((*margin / 2).max(SHORTEST_ANSWER)));
        *margin = margin.saturating_mul(2).min(LONGEST_MARGIN);
        if tag > self.topology.timeout() {
            let link = arrival.link;
            self.refuse(link, self.topology.name(federate), Refusal::TooLate);
            self.withdraw(federate, None);
            return;
        }
        self.advance.join(&self.topology, federate, tag);
        for other in self.concerned_by(federate) {
            self.send(other, Frame::Joined { federate, first: tag });
        }
        self.send_grants();
    }

    /// Starts an arriving federate, once all receivers wait for its messages.
    fn start_late(&mut self, federate: FederateId) {
        let Some(Arrival { after, stage, .. }) = self.arrivals.0.get(&federate) else { return };
        match stage {
            Stage::Agreeing { unanswered, first, .. } if unanswered.is_empty() => {
                // A receiver has already processed a tag that is not before `first`, so the federate starts
                // later.
                if *after >= *first {
                    self.offer_start(federate);
                }
            }
            _ => return,
        }
        let Some(arrival) = self.arrivals.0.remove(&federate) else { return };
        let Arrival { link, met, launched, peer: Peer { life, host, listen, .. }, .. } = arrival;
        let first = self.advance.first(federate);
        let ready = Some(self.now);
        self.members[federate] = Member::Live { link, life, host, listen, launched, ready };
        self.note_frame(federate, self.now);
        self.traffic.start(&self.topology, federate, &met);
        self.advance.join(&self.topology, federate, first);
        let at = self.start;
        self.outputs.push_back(RtiOutput::Send { link, frame: Frame::Start { at, first } });
        self.outputs.push_back(RtiOutput::Entered { federate });
        self.send_grants();
        self.admit_arrivals();
    }
}
