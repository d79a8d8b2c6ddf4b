//! How a federate gets to know federates that join late: transient ones, for the first time or again.
//!
//! The RTI announces a federate that is about to join. This federate answers that it sends its messages
//! to that one too from now on; under decentralized coordination it first needs a new direct link, and
//! the end of the old one, on which messages may still be in transit.

use std::collections::{BTreeMap, BTreeSet};

use hprm_core::{FederateId, PhysicalTime, Tag};

use super::{Coordinator, Federate};
use crate::{Frame, Output, Peer};

/// The federates that are about to join.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Default)]
pub(super) struct Meeting {
    /// The federates whose former link has not ended.
    returning: BTreeMap<FederateId, Peer>,
    /// The federates to which a link is being opened.
    linking: BTreeSet<FederateId>,
}

impl Meeting {
    /// The federates to which a link is being opened.
    pub(super) fn linking(&self) -> impl Iterator<Item = FederateId> {
        self.linking.iter().copied()
    }

    pub(super) fn forget(&mut self, peer: FederateId) {
        self.returning.remove(&peer);
        self.linking.remove(&peer);
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
            self.include(federate);
        }
    }

    /// The direct link to a federate is up.
    pub(super) fn link_is_up(&mut self, peer: FederateId) {
        if self.meeting.linking.remove(&peer) {
            self.include(peer);
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
        self.answer(federate);
    }

    /// A federate joins, and starts at `first` or later.
    pub(super) fn joined(&mut self, federate: FederateId, first: Tag) {
        if let Coordinator::Decentralized(machine) = &mut self.coordinator {
            machine.joined(&self.topology, federate, first);
            if self.topology.upstream(self.me).iter().any(|edge| edge.federate == federate) {
                self.answer(federate);
            }
        }
    }

    /// Tells the RTI that this federate takes a joining one into account from now on.
    fn answer(&mut self, federate: FederateId) {
        let (incarnation, after) = (self.startup.incarnation(federate), self.current);
        self.outputs.push_back(Output::ToRti(Frame::Met { federate, incarnation, after }));
    }
}
