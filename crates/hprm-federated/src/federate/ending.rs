//! How a federate ends, in order or not, and how it handles the ends of others.

use std::collections::BTreeSet;

use hprm_core::{FederateId, Nanos, PhysicalTime, Tag};

use super::{Coordinator, Federate};
use crate::stop::Stop;
use crate::{End, Frame, Output};

/// How long the RTI has to explain why there is no direct link, and a link has to end after its federate.
pub(super) const EXPLANATION: Nanos = 2_000_000_000;

/// The longest text of a failure, in bytes; the rest is cut off.
const MESSAGE: usize = 64 * 1024;

/// A federate that has ended, and whose direct link has not.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub(super) struct Lingering {
    /// When this federate closes the link.
    pub(super) until: PhysicalTime,
    /// Whether all that was sent on it must have arrived when it ends.
    in_order: bool,
}

impl Lingering {
    /// Whether what the link still brings has not been counted by its sender.
    pub(super) fn is_of_one_that_was_killed(&self) -> bool {
        !self.in_order
    }
}

impl Federate {
    pub(super) fn request_stop(&mut self) {
        if self.startup.start().is_none() {
            self.stop = Stop::Wanted;
        } else if let Some(tag) = self.stop.request(self.current) {
            self.outputs.push_back(Output::ToRti(Frame::StopRequest { tag }));
        }
    }

    pub(super) fn stop_at(&mut self, tag: Tag) {
        self.stop = Stop::Decided;
        match &mut self.coordinator {
            Coordinator::Centralized(machine) => machine.stop_at(tag),
            Coordinator::Decentralized(machine) => machine.stop_at(tag),
        }
        if let Some(showing) = &mut self.showing {
            showing.boards.stop_at(tag);
        }
        self.expect(tag);
        self.outputs.push_back(Output::SetStop(tag));
    }

    /// Stops this federate alone, at `tag` or as soon as may be after it.
    pub(super) fn depart(&mut self, tag: Tag) {
        let tag = tag.max(self.current.succ()).max(self.first);
        let last = self.last_tag().min(tag);
        self.departure = Some(last);
        self.expect(last);
        self.outputs.push_back(Output::LeaveAt(last));
    }

    /// The RTI tells this federate to leave at `tag`. If this federate is in that tag or beyond it, it leaves
    /// later, and the RTI must know: it lets a federate advance no further than through its last tag. Under
    /// centralized coordination the RTI knows which tags are complete, and where there are boards, the board of this
    /// federate tells the others.
    pub(super) fn told_to_leave(&mut self, now: PhysicalTime, tag: Tag) {
        let tag = tag.max(self.after_others(now));
        self.depart(tag);
        let last = self.last_tag();
        let decentralized = matches!(self.coordinator, Coordinator::Decentralized(_));
        if last > tag && decentralized && !self.reads_boards() {
            self.outputs.push_back(Output::ToRti(Frame::Depart { tag: last }));
        }
    }

    /// Asks when this federate may stop alone. Its last report did not regard that, and others may rely
    /// on the report.
    pub(super) fn request_departure(&mut self) {
        if self.startup.start().is_some() && self.departure.is_none() && !self.wants_to_leave {
            let tag = self.current.succ().max(self.first);
            self.wants_to_leave = true;
            self.outputs.push_back(Output::ToRti(Frame::Depart { tag }));
        }
    }

    /// The last tag of this federate alone, if it leaves before the others.
    pub(super) fn last_tag(&self) -> Tag {
        self.departure.unwrap_or(Tag::FOREVER)
    }

    /// The last frame to the RTI, if the others go on.
    pub(super) fn leave_frame(&self) -> Frame {
        Frame::Leave { tag: self.current }
    }

    /// A federate has ended. If that was in order, its last frame on a direct link is a `Resign`; if not,
    /// no federate knows how much it has sent.
    pub(super) fn peer_gone(&mut self, now: PhysicalTime, peer: FederateId, in_order: bool) {
        self.gone.insert(peer);
        self.flow.forget(peer);
        self.meeting.forget(peer);
        let broken = matches!(self.broken_links.remove(&peer), Some((_, None)));
        if broken && in_order {
            self.fail_on_lost_frames(peer);
            return;
        }
        if self.startup.is_linked(peer) && !self.resigned.contains(&peer) {
            let until = if in_order { PhysicalTime::FOREVER } else { now.plus(self.explanation) };
            self.lingering.insert(peer, Lingering { until, in_order });
        }
        self.startup.needs_no_link_to(peer);
        self.get_ready(now);
        self.outputs.push_back(Output::ReaderGone(peer));
        if let Some(showing) = self.showing.as_mut().filter(|_| !in_order) {
            showing.boards.dies(peer);
        }
        // What it sent on a direct link may still be in transit.
        if !self.startup.is_linked(peer) {
            self.closed(peer);
        }
    }

    /// A direct link has ended. The RTI will tell whether its federate has ended, and how.
    pub(super) fn peer_lost(&mut self, now: PhysicalTime, peer: FederateId) {
        self.startup.unlink(peer);
        if self.lingering.remove(&peer).is_some_and(|lingering| lingering.in_order) {
            self.fail_on_lost_frames(peer);
            return;
        }
        if self.gone.contains(&peer) {
            self.closed(peer);
        } else if !self.resigned.contains(&peer) {
            // The peer sends nothing before it has been welcomed, so nothing is lost, and it opens the link
            // again; the RTI tells if it cannot.
            let is_opened_again = self.startup.start().is_none() && !self.opened.contains(&peer);
            let until =
                if is_opened_again { PhysicalTime::FOREVER } else { now.plus(self.explanation) };
            self.broken_links.insert(peer, (until, None));
        }
        self.link_has_ended(now, peer);
    }

    /// The federation starts: limits how long a direct link may stay broken. Its other end has seen it open, and
    /// does not open it again.
    pub(super) fn limit_broken_links(&mut self, now: PhysicalTime) {
        let limit = now.plus(self.explanation);
        self.broken_links.values_mut().for_each(|(until, _)| *until = limit.min(*until));
    }

    /// A federate has ended in order, but its direct link has broken before its `Resign`: frames are lost.
    fn fail_on_lost_frames(&mut self, peer: FederateId) {
        let name = self.topology.name(peer);
        let message =
            format!("the link to federate {name} has broken before all that it had sent was there");
        self.give_up(message);
    }

    /// A federate has ended, and its successor needs the direct link: closes the old one, or limits how long it
    /// may stay open.
    pub(super) fn expect_link_end(&mut self, now: PhysicalTime, peer: FederateId) {
        if self.resigned.contains(&peer) {
            // Nothing follows on it.
            self.outputs.push_back(Output::Disconnect(peer));
            self.peer_lost(now, peer);
        } else {
            let until = now.plus(self.explanation);
            self.lingering.entry(peer).or_insert(Lingering { until, in_order: false });
        }
    }

    /// Applies the time limits of links: closes the links that have stayed open too long after their peers have
    /// ended, and fails if the RTI has not explained in time why a link is broken.
    pub(super) fn apply_link_limits(&mut self, now: PhysicalTime) {
        self.close_overdue_links(now);
        self.fail_on_broken_link(now);
    }

    /// Closes the links that have stayed open too long: their federates have not ended in order, and may hang.
    fn close_overdue_links(&mut self, now: PhysicalTime) {
        let due = self.lingering.iter().filter(|(_, lingering)| lingering.until <= now);
        let due: Vec<_> = due.map(|(peer, _)| *peer).collect();
        for peer in due {
            self.outputs.push_back(Output::Disconnect(peer));
            self.peer_lost(now, peer);
        }
    }

    /// A direct link cannot be opened. Its federate may have ended just now, which the RTI will tell; a
    /// transient one may be gone, and that is no failure.
    pub(super) fn unreachable(&mut self, now: PhysicalTime, peer: FederateId, reason: String) {
        if self.is_live(peer) && !self.topology.is_transient(peer) {
            self.broken_links.insert(peer, (now.plus(self.explanation), Some(reason)));
        }
    }

    /// Fails if a direct link is broken, and the RTI has not reported in time that its federate has ended.
    pub(super) fn fail_on_broken_link(&mut self, now: PhysicalTime) {
        let due = |(_, (until, _)): &(_, &(PhysicalTime, _))| *until <= now;
        let Some((peer, (_, reason))) = self.broken_links.iter().find(due) else { return };
        let name = self.topology.name(*peer);
        let message = match reason {
            None => format!("the link to federate {name} is broken, although it has not ended"),
            Some(reason) => format!("federate {name} has not ended, but is not reachable {reason}"),
        };
        self.give_up(message);
    }

    fn give_up(&mut self, message: String) {
        self.fail(message.clone(), 1);
        self.end(End::Failed { federate: self.me, message, code: 1 });
    }

    /// Nothing more comes from a peer.
    pub(super) fn closed(&mut self, peer: FederateId) {
        self.outputs.push_back(Output::OwnerGone(peer));
        if let Coordinator::Decentralized(machine) = &mut self.coordinator {
            machine.closed(peer);
        }
        if let Some(showing) = self.showing.as_mut().filter(|_| self.topology.is_transient(peer)) {
            showing.boards.has_read_all_of(&self.topology, peer);
            showing.elsewhere.tell_all();
        }
    }

    /// Ends in order; `last_frame` is the last frame to the RTI.
    pub(super) fn resign(&mut self, last_frame: Frame) {
        self.post_end();
        let peers: BTreeSet<_> = self.startup.linked().chain(self.meeting.linking()).collect();
        for to in peers {
            self.outputs.push_back(Output::ToPeer { to, frame: Frame::Resign });
        }
        if let Coordinator::Decentralized(machine) = &mut self.coordinator
            && let Some((next, counts)) = machine.last_report()
        {
            self.outputs.push_back(Output::ToRti(Frame::Progress { next, counts }));
        }
        self.outputs.push_back(Output::ToRti(last_frame));
        self.ended = true;
    }

    pub(super) fn fail(&mut self, mut message: String, code: i32) {
        let cut = (0..=MESSAGE.min(message.len())).rev().find(|at| message.is_char_boundary(*at));
        message.truncate(cut.unwrap_or(0));
        let frame = Frame::Failed { federate: self.me, message, code };
        self.outputs.push_back(Output::ToRti(frame));
        self.ended = true;
    }

    pub(super) fn end(&mut self, reason: End) {
        self.outputs.push_back(Output::Ended { reason });
        self.ended = true;
    }
}
