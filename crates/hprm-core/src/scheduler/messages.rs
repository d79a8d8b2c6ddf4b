//! Messages: along delayed and physical connections, to other federates and from them.

use std::sync::Arc;

use super::{Scheduler, Send};
use crate::queue::Event;
use crate::{
    Channel, ChannelId, Connection, ConnectionId, Delay, FederateId, PhysicalTime, PortId, Reading,
    Tag,
};

impl<V: Clone> Scheduler<V> {
    /// A value that leaves for another federate, in the order in which they were set.
    pub fn poll_send(&mut self) -> Option<Send<V>> {
        self.sends.pop_front()
    }

    /// Inserts a message from another federate. Returns the tag at which it will be present: its
    /// own, or a later one if it is tardy; none if that is after the program's timeout. A message for the tag
    /// that is being processed is in time if no reaction that could read it has had its turn.
    /// `physical` is what the sender's scheduler said of it.
    pub fn deliver(
        &mut self,
        channel: ChannelId,
        tag: Tag,
        value: V,
        physical: bool,
    ) -> Option<Tag> {
        let connection = self.program.channels[channel].connection;
        // One that came too late may have taken the place of this one.
        let is_next = tag > self.last_assigned[connection];
        if tag == self.tag && is_next && self.is_in_time(channel) {
            let outlet = self.wiring.outlets[self.program.connections[connection].to];
            self.last_assigned[connection] = tag;
            self.make_present(outlet, value, None, physical);
            return Some(tag);
        }
        // A tardy message must neither overtake nor displace another one of its connection.
        let taken = self.tag.max(self.last_assigned[connection]);
        let earliest = taken.succ().max(self.first);
        if tag >= earliest {
            self.insert_message(connection, tag, (value, None, physical))
        } else {
            self.insert_message(connection, earliest, (value, Some(tag), physical))
        }
    }

    /// Inserts a message of a physical connection, tagged with the time of its arrival.
    pub fn deliver_physical(
        &mut self,
        channel: ChannelId,
        now: PhysicalTime,
        value: V,
    ) -> Option<Tag> {
        let connection = self.program.channels[channel].connection;
        let tag = self.assign(connection, self.physical_tag(connection, now));
        self.insert_message(connection, tag, (value, None, true))
    }

    /// Sends what is present along delayed connections and to other federates, and makes it absent.
    pub(super) fn send_present(&mut self, now: impl Reading) {
        if !self.departing.is_empty() {
            let mut ports = std::mem::take(&mut self.departing);
            // Not in the order of setting: where a message stands in the queue is part of the state.
            ports.sort_unstable();
            let now = now.read();
            for root in ports.drain(..) {
                if let Some(value) = self.ports[root].take() {
                    self.forward(root, &value, now);
                }
            }
            self.departing = ports;
        }
        for root in &self.present_ports {
            self.ports[*root] = None;
        }
        self.present_ports.clear();
    }

    /// Sends the value at a root along what leaves from there.
    fn forward(&mut self, root: PortId, value: &V, now: PhysicalTime) {
        let wiring = Arc::clone(&self.wiring);
        let marked = self.is_port_marked(root);
        for connection in &wiring.delayed[root] {
            if !self.modes.is_active(wiring.modes.of_connection[*connection]) {
                continue;
            }
            let Connection { physical, delay, .. } = self.program.connections[*connection];
            let computed =
                if physical { self.physical_tag(*connection, now) } else { delay.shift(self.tag) };
            let tag = self.assign(*connection, computed);
            self.insert_message(*connection, tag, (value.clone(), None, marked || physical));
        }
        let sent = self.sent.contains(&root);
        for channel in &wiring.outgoing[root] {
            let Channel { connection, delay, physical, .. } = self.program.channels[*channel];
            if sent && self.program.channels[*channel].is_direct() {
                continue;
            }
            let tag = self.assign(connection, delay.shift(self.tag));
            if physical || tag <= self.program_end {
                let value = value.clone();
                self.sends.push_back(Send { channel: *channel, tag, value, physical: marked });
            }
        }
        let sender = self.program.reactors[self.program.ports[root].reactor].federate;
        self.pass_unread(root, self.tag, (sender, now));
    }

    /// Notes when messages arrive that leave a root at `tag` and that no reaction reads.
    fn pass_unread(
        &mut self,
        root: PortId,
        tag: Tag,
        (sender, now): (Option<FederateId>, PhysicalTime),
    ) {
        let wiring = Arc::clone(&self.wiring);
        for connection in &wiring.unread[root] {
            let Connection { to, physical, delay, .. } = self.program.connections[*connection];
            let computed = match physical {
                true => self.physical_tag(*connection, now).max(tag.succ()),
                false => delay.shift(tag),
            };
            let at = self.assign(*connection, computed);
            if at <= self.timeout {
                let last = self.unread.entry(sender).or_insert(at);
                *last = at.max(*last);
                self.record_unread(physical);
                // A circle of connections has no reaction in it, and so nothing ever gets there.
                self.pass_unread(wiring.root(to), at, (sender, now));
            }
        }
    }

    /// The tag of the next message of a connection: as computed, but after the one before it.
    /// Messages with different tags at the sender never merge into one (handbook, "after").
    pub(super) fn assign(&mut self, connection: ConnectionId, computed: Tag) -> Tag {
        let last = &mut self.last_assigned[connection];
        *last = if computed > *last { computed } else { last.succ() };
        *last
    }

    fn insert_message(
        &mut self,
        connection: ConnectionId,
        at: Tag,
        (value, intended, physical): (V, Option<Tag>, bool),
    ) -> Option<Tag> {
        if at > self.timeout {
            return None;
        }
        if at <= self.stop {
            self.last_assigned[connection] = at;
        }
        self.queue.insert(at, Event::Message { connection, value, intended, physical });
        Some(at)
    }

    /// The tag that the clock gives to a message of a physical connection.
    fn physical_tag(&self, connection: ConnectionId, now: PhysicalTime) -> Tag {
        let delay = match self.program.connections[connection].delay {
            Delay::Time(delay) => delay,
            Delay::None | Delay::Microstep => 0,
        };
        self.tag_by_clock(delay, now)
    }
}
