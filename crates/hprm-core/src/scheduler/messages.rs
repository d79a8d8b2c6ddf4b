//! Messages: along delayed and physical connections, to other federates and from them.

use super::{OutboundMessage, Scheduler};
use crate::bound::Admission;
use crate::queue::QueuedEvent;
use crate::{
    Channel, ChannelId, Connection, ConnectionId, Delay, FederateId, PhysicalTime, PortId, Reading,
    Tag,
};

/// What a clock shows at the end of a tag: it is read once, if anything depends on it.
enum ReadOnce<R> {
    Unread(Option<R>),
    Read(PhysicalTime),
}

impl<R: Reading> ReadOnce<R> {
    fn read(&mut self) -> PhysicalTime {
        if let Self::Unread(clock) = self
            && let Some(clock) = clock.take()
        {
            *self = Self::Read(clock.read());
        }
        match self {
            Self::Read(time) => *time,
            Self::Unread(_) => unreachable!("a clock that is taken is read"),
        }
    }
}

impl<V: Clone> Scheduler<V> {
    /// The next message to another federate, in the order in which they are to be sent.
    pub fn poll_outbound(&mut self) -> Option<OutboundMessage<V>> {
        self.outbound.pop_front()
    }

    /// Inserts a message from another federate. Returns the tag at which it will be present: its
    /// own, or a later one if it is tardy; none if that is after the program's timeout. A message for the tag
    /// that is being processed is in time if no reaction that could read it has run.
    /// `physical` comes from the sender's [`OutboundMessage`].
    pub fn deliver(
        &mut self,
        channel: ChannelId,
        tag: Tag,
        value: V,
        physical: bool,
    ) -> Option<Tag> {
        let connection = self.program.channels[channel].connection;
        // A tardy message may have taken the tag of this one.
        let is_next = tag > self.last_assigned[connection];
        if tag == self.tag && is_next && self.is_in_time(channel) {
            let route = self.wiring.routes[self.program.connections[connection].to];
            self.last_assigned[connection] = tag;
            self.make_present(route, value, None, physical);
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
        self.insert_by_clock(connection, now, value)
    }

    /// The physical connections of which messages were dropped, and how many.
    pub fn dropped_messages(&self) -> impl Iterator<Item = (ConnectionId, u64)> {
        let dropped =
            self.bounded.iter().map(|(connection, waiting)| (*connection, waiting.dropped()));
        dropped.filter(|(_, dropped)| *dropped > 0)
    }

    /// Inserts a message of a physical connection, unless too many wait already.
    fn insert_by_clock(
        &mut self,
        connection: ConnectionId,
        now: PhysicalTime,
        value: V,
    ) -> Option<Tag> {
        let bound = self.program.connections[connection].bound;
        if let Some(bound) = bound {
            let waiting = self.bounded.entry(connection).or_default();
            waiting.processed(self.tag);
            match waiting.admit(bound) {
                Admission::Insert => {}
                Admission::Drop => return None,
                Admission::Displace(oldest) => self.queue.remove_message(oldest, connection),
            }
        }
        let tag = self.assign(connection, self.physical_tag(connection, now));
        let inserted = self.insert_message(connection, tag, (value, None, true));
        if let (Some(tag), Some(waiting)) = (inserted, self.bounded.get_mut(&connection)) {
            waiting.inserted(tag);
        }
        if bound.is_none() {
            let Self { backlog_watch, queue, .. } = self;
            backlog_watch.added(connection, queue.tags(), || queue.count_messages(connection));
        }
        inserted
    }

    /// A physical connection without a bound for which many messages wait or have waited, if there is one.
    #[inline]
    pub fn connection_with_backlog(&self) -> Option<ConnectionId> {
        self.backlog_watch.found()
    }

    /// Sends the values of present ports along delayed connections and to other federates.
    pub(super) fn send_present(&mut self, now: impl Reading) {
        if self.current.outbound_ports.is_empty() {
            return;
        }
        let mut ports = core::mem::take(&mut self.current.outbound_ports);
        // Not in the order of setting: the order of messages in the queue is part of the state.
        ports.sort_unstable();
        let mut now = ReadOnce::Unread(Some(now));
        for root in ports.drain(..) {
            if let Some(value) = self.current.ports[root].take() {
                self.send_value(root, value, &mut now);
            }
        }
        // Its memory is used at later tags.
        self.current.outbound_ports = ports;
    }

    /// Sends the value at a root along the delayed connections and channels that start there.
    // By numbers: to share the wiring for each value would cost more than to look each connection up.
    fn send_value(&mut self, root: PortId, value: V, now: &mut ReadOnce<impl Reading>) {
        let marked = self.is_port_marked(root);
        for at in 0..self.wiring.delayed[root].len() {
            let connection = self.wiring.delayed[root][at];
            if !self.modes.is_active(self.wiring.modes.of_connection[connection]) {
                continue;
            }
            let Connection { physical, delay, .. } = self.program.connections[connection];
            if physical {
                self.insert_by_clock(connection, now.read(), value.clone());
                continue;
            }
            let tag = self.assign(connection, delay.shift(self.tag));
            self.insert_message(connection, tag, (value.clone(), None, marked));
        }
        let sent = self.current.sent_ports.contains(&root);
        let channels = self.wiring.outgoing[root].len();
        let mut value = Some(value);
        for at in 0..channels {
            let channel = self.wiring.outgoing[root][at];
            let Channel { connection, delay, physical, .. } = self.program.channels[channel];
            if sent && self.program.channels[channel].is_direct() {
                continue;
            }
            let tag = self.assign(connection, delay.shift(self.tag));
            if physical || tag <= self.program_end {
                // The last receiver gets the value itself.
                let value = if at + 1 == channels { value.take() } else { value.clone() };
                let message = |value| OutboundMessage { channel, tag, value, physical: marked };
                self.outbound.extend(value.map(message));
            }
        }
        let sender = self.program.reactors[self.program.ports[root].reactor].federate;
        self.note_unread(root, self.tag, (sender, now));
    }

    /// Notes when messages arrive that are sent from a root at `tag` and that no reaction reads.
    fn note_unread(
        &mut self,
        root: PortId,
        tag: Tag,
        (sender, now): (Option<FederateId>, &mut ReadOnce<impl Reading>),
    ) {
        for at in 0..self.wiring.unread[root].len() {
            let connection = self.wiring.unread[root][at];
            let Connection { to, physical, delay, .. } = self.program.connections[connection];
            let computed = match physical {
                true => self.physical_tag(connection, now.read()).max(tag.succ()),
                false => delay.shift(tag),
            };
            let arrives = self.assign(connection, computed);
            if arrives <= self.timeout {
                let last = self.unread.entry(sender).or_insert(arrives);
                *last = arrives.max(*last);
                self.record_unread(physical);
                // Terminates: a cycle of connections has no reaction, so it never has a value.
                self.note_unread(self.wiring.root(to), arrives, (sender, now));
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
        let value = Some(value);
        self.queue.insert(at, QueuedEvent::Message { connection, value, intended, physical });
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
