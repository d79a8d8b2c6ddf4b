//! Processing a tag level by level, for a federate in a cycle without delay.
//!
//! Such a federate cannot wait for all messages of a tag before it begins it, nor send its own messages
//! only when the tag is complete. It proceeds level by level: the values that a reaction of some level
//! reads have been written at lower levels, here or in other federates.

use super::{OutboundMessage, Scheduler};
use crate::{Channel, ChannelId, PortId};
use alloc::vec::Vec;

impl<V: Clone> Scheduler<V> {
    /// The next level at which this federate has something to do at this tag, unless a message arrives: a
    /// reaction runs, or the value of a port cannot change any more and is sent on undelayed channels.
    #[must_use]
    pub fn next_level(&self) -> Option<u32> {
        let runs = self.ready_level();
        let unsent = self.current.present_ports.iter();
        let unsent = unsent.filter(|root| !self.current.sent_ports.contains(root));
        let sends = unsent.filter_map(|root| self.last_writer(*root)).min();
        runs.into_iter().chain(sends).min()
    }

    /// The level of the next reaction at this tag.
    #[must_use]
    pub fn ready_level(&self) -> Option<u32> {
        let reaction = self.ready.first().map(|position| self.wiring.order.reaction(position));
        reaction.map(|reaction| self.program.reactions[reaction].level)
    }

    /// Notes that all reactions of `level` and below have run, and sends the values that cannot change any
    /// more. A message that is read there for the first time is tardy from now on.
    pub fn pass(&mut self, level: u32) {
        self.current.level = self.current.level.max(Some(level.saturating_add(1)));
        let is_final = |root: &PortId| {
            self.last_writer(*root).is_some_and(|last| last <= level)
                && !self.current.sent_ports.contains(root)
        };
        let mut final_ports: Vec<PortId> =
            self.current.present_ports.iter().copied().filter(is_final).collect();
        final_ports.sort_unstable();
        for root in final_ports {
            self.current.sent_ports.push(root);
            let wiring = alloc::sync::Arc::clone(&self.wiring);
            for channel in &wiring.outgoing[root] {
                let Channel { connection, .. } = self.program.channels[*channel];
                if self.is_direct(*channel)
                    && let Some(value) = self.current.ports[root].clone()
                {
                    let tag = self.assign(connection, self.tag);
                    let physical = self.is_port_marked(root);
                    let message = OutboundMessage { channel: *channel, tag, value, physical };
                    self.outbound.push_back(message);
                }
            }
        }
    }

    /// Whether a message for the current tag arrives before the first reaction that may read it.
    pub(super) fn is_in_time(&self, channel: ChannelId) -> bool {
        self.current.level.is_some_and(|level| level <= self.program.channels[channel].first_reader)
    }

    fn is_direct(&self, channel: ChannelId) -> bool {
        self.program.channels[channel].is_direct()
    }

    /// The highest level at which the port may be set, if it is sent on an undelayed channel.
    fn last_writer(&self, root: PortId) -> Option<u32> {
        let direct = self.wiring.outgoing[root].iter().filter(|id| self.is_direct(**id));
        direct.map(|id| self.program.channels[*id].last_writer).max()
    }
}
