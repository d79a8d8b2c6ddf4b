//! Going through a tag level by level, for a federate whose messages come back to it at the same tag.
//!
//! Such a federate cannot wait until all messages for a tag are there before it begins it, nor send
//! its own only when the tag is complete. It goes on level by level: what a reaction of some level
//! reads has been written at lower levels, here or elsewhere.

use super::{Scheduler, Send};
use crate::{Channel, ChannelId, PortId};

impl<V: Clone> Scheduler<V> {
    /// The next level at which something happens at this tag, unless a message arrives: a reaction
    /// runs, or what a port holds cannot change any more and leaves on undelayed channels.
    #[must_use]
    pub fn next_level(&self) -> Option<u32> {
        let runs = self.ready_level();
        let unsent = self.present_ports.iter().filter(|root| !self.sent.contains(root));
        let leaves = unsent.filter_map(|root| self.last_writer(*root)).min();
        runs.into_iter().chain(leaves).min()
    }

    /// The level of the next reaction at this tag.
    #[must_use]
    pub fn ready_level(&self) -> Option<u32> {
        let reaction = self.ready.first().map(|position| self.wiring.order.reaction(position));
        reaction.map(|reaction| self.program.reactions[reaction].level)
    }

    /// Notes that all reactions of `level` and below have run, and sends what cannot change any
    /// more.
    pub fn pass(&mut self, level: u32) {
        self.level = Some(level.saturating_add(1));
        let is_final = |root: &PortId| {
            self.last_writer(*root).is_some_and(|last| last <= level) && !self.sent.contains(root)
        };
        let mut leaving: Vec<PortId> =
            self.present_ports.iter().copied().filter(is_final).collect();
        leaving.sort_unstable();
        for root in leaving {
            self.sent.push(root);
            let wiring = std::sync::Arc::clone(&self.wiring);
            for channel in &wiring.outgoing[root] {
                let Channel { connection, .. } = self.program.channels[*channel];
                if self.is_direct(*channel)
                    && let Some(value) = self.ports[root].clone()
                {
                    let tag = self.assign(connection, self.tag);
                    let physical = self.is_port_marked(root);
                    self.sends.push_back(Send { channel: *channel, tag, value, physical });
                }
            }
        }
    }

    /// Whether a message for the current tag comes before anything that reads it.
    pub(super) fn is_in_time(&self, channel: ChannelId) -> bool {
        self.level.is_some_and(|level| level <= self.program.channels[channel].first_reader)
    }

    fn is_direct(&self, channel: ChannelId) -> bool {
        self.program.channels[channel].is_direct()
    }

    /// The highest level at which the port may be set, if it leads to an undelayed channel.
    fn last_writer(&self, root: PortId) -> Option<u32> {
        let direct = self.wiring.outgoing[root].iter().filter(|id| self.is_direct(**id));
        direct.map(|id| self.program.channels[*id].last_writer).max()
    }
}
