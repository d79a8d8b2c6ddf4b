//! Values and frames about objects, and the links on which a federate sends and receives them.

use hprm_core::{Channel, ChannelId, FederateId, Nanos, Payload, Tag};

use super::{Activity, Coordinator, Federate};
use crate::startup::EarlyMessage;
use crate::{Fault, Frame, Input, Output, codec};

/// The most serial numbers in one frame.
const RELEASES: usize = 4096;

impl Federate {
    /// A message on a direct link.
    #[inline]
    pub(super) fn peer_message(
        &mut self,
        from: FederateId,
        (channel, tag): (ChannelId, Tag),
        payload: Payload,
    ) -> Result<(), Fault> {
        if !self.startup.is_linked(from) {
            return Err(Fault::UnknownLink);
        }
        if self.topology.channel(channel, Some(from), Some(self.me))?.physical {
            return Err(Fault::Unexpected { frame: "Message" });
        }
        self.deliver((channel, tag), payload);
        Ok(())
    }

    /// A message for the scheduler, once there is a start.
    #[inline]
    pub(super) fn deliver(&mut self, (channel, tag): (ChannelId, Tag), payload: Payload) {
        if self.startup.start().is_none() {
            self.startup.keep(EarlyMessage { channel, tag, payload });
            return;
        }
        let from = self.topology.channels().get(channel).map(|channel| channel.from);
        if from.is_some_and(|from| self.is_not_met(from)) {
            self.outputs.push_back(Output::Discard { payload });
            return;
        }
        self.flow.arrived(channel, tag, &payload);
        if tag < self.first {
            self.discard(channel, tag, payload);
            return;
        }
        match &mut self.coordinator {
            Coordinator::Centralized(machine) => machine.arrived(tag),
            Coordinator::Decentralized(machine) => machine.received(channel, tag),
        }
        if let Some(showing) = &mut self.showing {
            showing.boards.received(channel, tag);
        }
        self.expect(tag);
        if tag < self.current {
            // The message is tardy, so its own tag has been processed. Its sender may be behind, and this
            // federate may wait for that sender within the current tag.
            self.reached(self.current);
        }
        self.outputs.push_back(Output::Deliver { channel, tag, payload });
    }

    /// With boards: whether a federate has ended before this one has got to know it. What it has sent is of tags before this one
    /// has joined, and the others see on this one's board that it counts none of that.
    pub(super) fn is_not_met(&self, federate: FederateId) -> bool {
        let joins_late = self.reads_boards() && self.topology.is_transient(self.me);
        joins_late && self.startup.life(federate).is_none()
    }

    /// A message that gets its tag here, so long after the start.
    pub(super) fn deliver_physical(&mut self, elapsed: Nanos, message: EarlyMessage) {
        let EarlyMessage { channel, tag, payload } = message;
        self.flow.arrived(channel, tag, &payload);
        // This federate may wait for the sender within a tag, when it reports nothing else.
        self.reached(Tag::START);
        self.expect(Tag::new(elapsed.max(0), 0));
        self.outputs.push_back(Output::DeliverPhysical { channel, tag, payload });
    }

    /// A message for a tag before this federate has joined. Its sender has counted it, so it counts here,
    /// too: the RTI lets no federate advance while a message seems to be in transit.
    fn discard(&mut self, channel: ChannelId, tag: Tag, payload: Payload) {
        match &mut self.coordinator {
            Coordinator::Centralized(machine) => machine.discarded(),
            Coordinator::Decentralized(machine) => machine.received(channel, tag),
        }
        if let Some(showing) = &mut self.showing {
            showing.boards.received(channel, tag);
        }
        // No reaction processes it, so its sender need not wait for that. This federate may wait for the
        // sender.
        self.reached(self.first);
        self.outputs.push_back(Output::Discard { payload });
    }

    /// A message that the RTI forwards before the start, as it does to a federate that joins late.
    pub(super) fn early(&mut self, channel: Channel, message: EarlyMessage) -> Result<(), Fault> {
        if !self.topology.is_transient(self.me) {
            return Err(Fault::Unexpected { frame: "Message" });
        }
        if channel.physical {
            self.flow.arrived(message.channel, message.tag, &message.payload);
            self.flow.assign_tag(message.channel, None);
            self.outputs.push_back(Output::Discard { payload: message.payload });
        } else {
            self.startup.keep(message);
        }
        Ok(())
    }

    /// This federate has processed everything before `tag`, and read every physical message. Senders may
    /// wait for that.
    pub(super) fn reached(&mut self, tag: Tag) {
        for (sender, report) in self.flow.reached(tag) {
            self.route(sender, report);
        }
    }

    /// An input has come that the scheduler will process at `tag`, or as soon as it can. It may take a
    /// while until the scheduler reports that itself.
    pub(super) fn expect(&mut self, tag: Tag) {
        match &mut self.activity {
            Activity::Idle(next) => *next = (*next).min(tag.max(self.current.succ())),
            Activity::Within(_) if tag <= self.current => self.activity = Activity::Processing,
            Activity::Unknown | Activity::Processing | Activity::Within(_) => {}
        }
    }

    pub(super) fn send(&mut self, id: ChannelId, tag: Tag, payload: Payload) -> Result<(), Fault> {
        let channel = self.topology.channel(id, Some(self.me), None)?;
        if !codec::fits(&payload) {
            let (parts, limit) = (payload.parts.len(), codec::PARTS_LIMIT);
            return Err(Fault::TooManyParts { parts, limit });
        }
        let is_direct =
            matches!(self.coordinator, Coordinator::Decentralized(_)) && !channel.physical;
        let is_ready =
            || self.startup.is_linked(channel.to) && !self.meeting.withholds_from(channel.to);
        let leaves = if is_direct { is_ready() } else { true };
        if leaves && self.is_live(channel.to) {
            let counts_at = if channel.physical { self.current } else { tag };
            self.flow.sent(channel.to, id, counts_at, &payload);
        }
        let frame = Frame::Message { channel: id, tag, payload };
        match &mut self.coordinator {
            Coordinator::Decentralized(machine) if !channel.physical => {
                if leaves {
                    machine.sent(id, tag);
                    if let Some(showing) = &mut self.showing {
                        showing.boards.sent(id, tag);
                        showing.elsewhere.sent(channel.to, tag);
                    }
                    self.outputs.push_back(Output::ToPeer { to: channel.to, frame });
                }
            }
            coordinator => {
                if let Coordinator::Centralized(machine) = coordinator
                    && !channel.physical
                {
                    machine.sent();
                }
                self.outputs.push_back(Output::ToRti(frame));
            }
        }
        Ok(())
    }

    /// Tells a reader about segments of this federate's store.
    pub(super) fn tell_reader(&mut self, input: Input) {
        match input {
            Input::Segment { reader, segment, len } => {
                let frame = Frame::Segment { owner: self.me, reader, segment, len };
                self.route(reader, frame);
            }
            Input::Retired { reader, segments } => {
                let frame = Frame::Retired { owner: self.me, reader, segments };
                self.route(reader, frame);
            }
            _ => {}
        }
    }

    pub(super) fn release(&mut self, owner: FederateId, serials: &[u64]) {
        for serials in serials.chunks(RELEASES) {
            let serials = serials.to_vec();
            self.route(owner, Frame::Release { owner, reader: self.me, serials });
        }
    }

    /// Sends a frame the shortest way, unless its receiver has ended.
    pub(super) fn route(&mut self, to: FederateId, frame: Frame) {
        if self.startup.is_linked(to) {
            self.outputs.push_back(Output::ToPeer { to, frame });
        } else if self.is_live(to) {
            self.outputs.push_back(Output::ToRti(frame));
        }
    }
}
