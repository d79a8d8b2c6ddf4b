//! How a federate gets to tag zero: direct links, being ready, and what came before the start.

use hprm_core::{FederateId, PhysicalTime, Tag};

use super::{Coordinator, Federate};
use crate::stop::Stop;
use crate::{End, Frame, Output};

impl Federate {
    /// Opens the direct links to those whom this federate sends messages. One link serves two that
    /// send to each other; the one with the smaller number opens it.
    pub(super) fn connect(&mut self) {
        if matches!(self.coordinator, Coordinator::Centralized(_)) {
            return;
        }
        let upstream = self.topology.upstream(self.me);
        let mutual = |peer| upstream.iter().any(|edge| edge.federate == peer);
        let peers = self.topology.downstream(self.me).iter().map(|edge| edge.federate);
        let mine = |peer: &FederateId| self.me < *peer || !mutual(*peer);
        let missing = |peer: &FederateId| self.is_live(*peer) && !self.startup.is_linked(*peer);
        let peers: Vec<_> = peers.filter(mine).filter(missing).collect();
        for peer in peers {
            self.open_link(peer);
        }
    }

    pub(super) fn open_link(&mut self, peer: FederateId) {
        let Some(listen) = self.startup.address(peer) else {
            let name = self.topology.name(peer);
            let message = format!("federate {name} accepts no direct links, but has inputs");
            let reason = End::Failed { federate: self.me, message: message.clone(), code: 1 };
            self.fail(message, 1);
            self.end(reason);
            return;
        };
        self.outputs.push_back(Output::Connect { peer, listen });
    }

    pub(super) fn get_ready(&mut self, now: PhysicalTime) {
        if !self.over && self.startup.becomes_ready() {
            self.outputs.push_back(Output::ToRti(Frame::Ready { now }));
        }
    }

    pub(super) fn begin(&mut self, at: PhysicalTime, first: Tag) {
        let early = self.startup.begin(at);
        self.first = first;
        self.outputs.push_back(Output::Start { at, first });
        if let Coordinator::Decentralized(machine) = &mut self.coordinator {
            machine.begin(at, first);
        }
        for message in early {
            self.deliver(message);
        }
        if self.stop == Stop::Wanted {
            self.request_stop();
        }
    }
}
