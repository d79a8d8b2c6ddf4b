//! How a federate gets to tag zero: direct links, being ready, and what came before the start.

use hprm_core::{FederateId, PhysicalTime, Tag};

use super::{Coordinator, Federate};
use crate::startup::EarlyMessage;
use crate::stop::Stop;
use crate::{End, Frame, Output};

impl Federate {
    /// The link to the RTI has ended. As long as the others do not know of this federate, it can
    /// join again.
    pub(super) fn rti_lost(&mut self) {
        if self.startup.awaits_peers() {
            self.rti_link_lost = true;
            self.outputs.push_back(Output::Rejoin);
        } else {
            self.end(End::RtiLost);
        }
    }

    /// There is another link to the RTI.
    pub(super) fn rejoin(&mut self) {
        self.rti_link_lost = false;
        if let Frame::Hello { attempt, .. } = &mut self.hello {
            attempt.number += 1;
        }
        self.outputs.push_back(Output::ToRti(self.hello.clone()));
        self.report_loaded();
    }

    /// Tells the RTI that the program is loaded, if both are there.
    pub(super) fn report_loaded(&mut self) {
        if self.startup.is_loaded() && !self.rti_link_lost {
            self.outputs.push_back(Output::ToRti(Frame::Loaded));
        }
    }

    /// Opens the direct links to the federates to which this one sends messages. One link serves two that
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
        self.opened.insert(peer);
        self.outputs.push_back(Output::Connect { peer, listen });
    }

    pub(super) fn get_ready(&mut self, now: PhysicalTime) {
        if !self.ended && self.startup.becomes_ready() {
            self.outputs.push_back(Output::ToRti(Frame::Ready { now }));
        }
    }

    pub(super) fn begin(&mut self, now: PhysicalTime, at: PhysicalTime, first: Tag) {
        self.limit_broken_links(now);
        let early = self.startup.begin(at);
        self.first = first;
        self.outputs.push_back(Output::Start { at, first });
        if let Coordinator::Decentralized(machine) = &mut self.coordinator {
            machine.begin(at, first);
        }
        if let Some(showing) = &mut self.showing {
            showing.boards.starts_at(first);
        }
        for EarlyMessage { channel, tag, payload } in early {
            self.deliver((channel, tag), payload);
        }
        // Physical messages that came before the start have been read.
        self.reached(first);
        if self.stop == Stop::Wanted {
            self.request_stop();
        }
    }
}
