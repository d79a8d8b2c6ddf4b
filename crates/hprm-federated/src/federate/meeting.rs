//! How a federate gets to know federates that join late: transient ones, for the first time or again.
//!
//! The RTI announces a federate that is about to join. This federate answers that it sends its messages
//! to that one too from now on; under decentralized coordination it first needs a new direct link, and
//! the end of the old one, on which messages may still be in transit.

use std::collections::{BTreeMap, BTreeSet};

use hprm_core::{FederateId, Nanos, PhysicalTime, Tag};

use super::ending::Lingering;
use super::{Coordinator, Federate};
use crate::boards::readings;
use crate::{Frame, Output, Peer};

/// The federates that are about to join.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Default)]
pub(super) struct Meeting {
    /// The federates whose former link has not ended.
    returning: BTreeMap<FederateId, Peer>,
    /// The federates to which a link is being opened.
    linking: BTreeSet<FederateId>,
    /// With boards: the federates of whose predecessors something may still be read.
    waiting: BTreeSet<FederateId>,
    /// With boards: the federates about which this one answers once it shows what it knows. The first time, with the latest tag
    /// that their predecessors may have begun.
    unanswered: BTreeMap<FederateId, Option<Tag>>,
}

impl Meeting {
    /// The federates to which a link is being opened.
    pub(super) fn linking(&self) -> impl Iterator<Item = FederateId> {
        self.linking.iter().copied()
    }

    /// Whether messages can already be sent to a federate that is about to join, and must not.
    pub(super) fn withholds_from(&self, peer: FederateId) -> bool {
        self.waiting.contains(&peer)
    }

    /// Whether this federate waits until boards show that all has been read of one that was killed.
    pub(super) fn awaits_boards(&self) -> bool {
        !self.waiting.is_empty()
    }

    pub(super) fn forget(&mut self, peer: FederateId) {
        self.returning.remove(&peer);
        self.linking.remove(&peer);
        self.waiting.remove(&peer);
        self.unanswered.remove(&peer);
    }
}

impl Federate {
    /// Takes the list of the federates that have joined. No message comes from the others.
    pub(super) fn set_peers(&mut self, peers: Vec<Peer>) {
        let present: BTreeSet<_> = peers.iter().map(|peer| peer.federate).collect();
        let absent = self.topology.federates().filter(|federate| !present.contains(federate));
        self.gone = absent.filter(|federate| *federate != self.me).collect();
        if let Coordinator::Decentralized(machine) = &mut self.coordinator {
            self.gone.iter().for_each(|peer| machine.closed(*peer));
        }
        self.startup.set_peers(peers);
    }

    /// A federate is about to join. What its predecessor has sent comes first.
    pub(super) fn peer_joining(&mut self, now: PhysicalTime, peer: Peer) {
        let federate = peer.federate;
        if self.startup.is_linked(federate) {
            self.meeting.returning.insert(federate, peer);
            self.expect_link_end(now, federate);
            return;
        }
        self.startup.add(peer);
        let downstream = self.topology.downstream(self.me);
        let sends = downstream.iter().any(|edge| edge.federate == federate);
        if sends && let Coordinator::Decentralized(_) = self.coordinator {
            self.meeting.linking.insert(federate);
            self.open_link(federate);
        } else {
            self.meet(federate);
        }
    }

    /// This federate can take a joining one into account. With boards, it shows first what it has read of the predecessor, and of
    /// others that have died: the joining federate learns that only from boards.
    fn meet(&mut self, federate: FederateId) {
        match self.reads_boards() {
            true => drop(self.meeting.waiting.insert(federate)),
            false => self.include(federate),
        }
    }

    /// Takes those into account of whose predecessors nothing can be read any more.
    pub(super) fn include_those_that_may_be(&mut self, elapsed: Nanos) {
        let Some(showing) = &self.showing else { return };
        if self.meeting.waiting.is_empty()
            || self.lingering.values().any(Lingering::is_of_one_that_was_killed)
        {
            return;
        }
        let waiting = self.meeting.waiting.iter().copied();
        let ready: Vec<_> = waiting.filter(|it| !showing.boards.may_receive_from(*it)).collect();
        for federate in ready {
            self.meeting.waiting.remove(&federate);
            let last = self.last_of(federate, elapsed);
            self.include(federate);
            if let Some(showing) = &mut self.showing {
                showing.boards.follows(federate, last);
            }
            self.meeting.unanswered.insert(federate, Some(last));
        }
    }

    /// The latest tag that the predecessor of a federate may have begun, if it has not said so: no later one than is due, unless
    /// tags begin before that.
    fn last_of(&self, federate: FederateId, elapsed: Nanos) -> Tag {
        let last = self.showing.as_ref().and_then(|showing| showing.boards.last_of(federate));
        let due = if self.is_fast { Tag::FOREVER } else { Tag::new(elapsed.max(0), u32::MAX) };
        last.unwrap_or(Tag::NEVER).min(due)
    }

    /// With boards: the earliest tag that no federate downstream has begun that does not answer itself, because it was killed, or
    /// has only just joined in place of one that was.
    pub(super) fn after_others(&self, now: PhysicalTime) -> Tag {
        let (Some(showing), Some(start)) = (&self.showing, self.startup.start()) else {
            return Tag::NEVER;
        };
        let elapsed = now.since(start);
        let transient = self.topology.reachable(self.me).into_iter();
        let transient = transient.filter(|it| *it != self.me && self.topology.is_transient(*it));
        let after = transient.map(|it| match self.is_live(it) {
            true => showing.boards.first_of(it),
            false => self.last_of(it, elapsed).succ(),
        });
        after.max().unwrap_or(Tag::NEVER)
    }

    /// Answers about federates that join, once the others can see what this one has read.
    pub(super) fn answer_about_arrivals(&mut self) {
        let Some(showing) = &self.showing else { return };
        if showing.boards.unshown() == 0 {
            for (federate, last) in std::mem::take(&mut self.meeting.unanswered) {
                self.answer(federate, last.unwrap_or(Tag::NEVER));
                if last.is_some() {
                    self.hand_board_to(federate);
                }
            }
        }
    }

    /// The direct link to a federate is up.
    pub(super) fn link_is_up(&mut self, peer: FederateId) {
        if self.meeting.linking.remove(&peer) {
            self.meet(peer);
        }
    }

    /// The direct link to a federate has ended.
    pub(super) fn link_has_ended(&mut self, now: PhysicalTime, peer: FederateId) {
        if let Some(peer) = self.meeting.returning.remove(&peer) {
            self.peer_joining(now, peer);
        }
    }

    /// Takes a joining federate into account: from now on, this federate sends its messages to that one too.
    fn include(&mut self, federate: FederateId) {
        self.flow.forget(federate);
        self.gone.remove(&federate);
        self.resigned.remove(&federate);
        if let Coordinator::Decentralized(machine) = &mut self.coordinator {
            machine.meets(&self.topology, federate);
        }
        match self.reads_boards() {
            true => self.include_on_boards(federate),
            false => self.answer(federate, Tag::NEVER),
        }
    }

    /// The federate does nothing before it starts, which is to come.
    fn include_on_boards(&mut self, federate: FederateId) {
        if let Some(showing) = &mut self.showing {
            showing.boards.awaits(federate);
        }
        self.meet_on_boards(federate);
    }

    /// A federate joins, and starts at `first` or later.
    pub(super) fn joined(&mut self, federate: FederateId, first: Tag) {
        if let Coordinator::Decentralized(machine) = &mut self.coordinator {
            machine.joined(&self.topology, federate, first);
            if let Some(showing) = &mut self.showing {
                showing.boards.joins(federate, first);
                machine.only_safe(showing.boards.known(&self.topology));
                self.meeting.unanswered.insert(federate, None);
            } else if self.topology.upstream(self.me).iter().any(|edge| edge.federate == federate) {
                self.answer(federate, Tag::NEVER);
            }
        }
    }

    /// Tells the RTI that this federate takes a joining one into account from now on.
    fn answer(&mut self, federate: FederateId, last: Tag) {
        let incarnation = self.startup.incarnation(federate);
        let after = self.current.max(last);
        self.outputs.push_back(Output::ToRti(Frame::Met { federate, incarnation, after }));
    }

    /// Gives this federate's board to one that is about to join, and shares its memory.
    fn hand_board_to(&mut self, federate: FederateId) {
        if self.startup.shares_boards_with(federate) {
            let readings = readings(&self.topology).into_iter();
            self.hand_out_board(readings.filter(|it| it.reader == federate));
        }
    }
}
