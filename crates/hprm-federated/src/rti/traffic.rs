//! Which reports of decentralized federates go together.
//!
//! Decentralized federates send one another messages directly, so a report of what a federate will
//! do next is worth something only if it knows of every message that was sent to it before the
//! reports of its senders. Each end of a channel counts. Where the receiver has counted at least
//! as many messages as the sender, every further message was sent after the sender's report; by
//! induction over what causes what, it has no earlier tag than the reports allow.

use hprm_core::{Channel, ChannelId, FederateId, Table};

use crate::{Count, Fault, Topology};

#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Default)]
struct Pair {
    sent: u64,
    received: u64,
}

/// See the module.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(super) struct Traffic {
    pairs: Table<ChannelId, Pair>,
    /// Channels whose receiver has not reported all that the sender has.
    lagging: usize,
}

impl Traffic {
    pub(super) fn new(topology: &Topology) -> Self {
        let channels = topology.channels().len();
        Self { pairs: Table::filled(channels, Pair::default()), lagging: 0 }
    }

    /// Whether some report is missing a message.
    pub(super) fn lags(&self) -> bool {
        self.lagging > 0
    }

    /// Takes the counts of a federate; all of them, or none if one is about a foreign channel.
    pub(super) fn count(
        &mut self,
        topology: &Topology,
        from: FederateId,
        counts: &[Count],
    ) -> Result<(), Fault> {
        for count in counts {
            let Channel { from: sender, to, physical, .. } =
                topology.channel(count.channel, None, None)?;
            if physical || (sender != from && to != from) {
                return Err(Fault::UnknownChannel(count.channel));
            }
        }
        for count in counts {
            let sent = topology.channels()[count.channel].from == from;
            self.update(count.channel, |pair| {
                let counter = if sent { &mut pair.sent } else { &mut pair.received };
                *counter = (*counter).max(count.messages);
            });
        }
        Ok(())
    }

    /// A federate knows of another one that joins: what it counts of their channels starts anew.
    pub(super) fn meet(&mut self, topology: &Topology, one: FederateId, other: FederateId) {
        for (id, channel) in topology.channels().iter() {
            if (channel.from, channel.to) == (one, other)
                || (channel.from, channel.to) == (other, one)
            {
                self.update(id, |pair| *pair = Pair::default());
            }
        }
    }

    /// A federate has ended: what is sent to it does not matter any more.
    pub(super) fn end(&mut self, topology: &Topology, federate: FederateId) {
        for (id, channel) in topology.channels().iter() {
            if channel.to == federate {
                self.update(id, |pair| pair.received = u64::MAX);
            }
        }
    }

    fn update(&mut self, channel: ChannelId, change: impl FnOnce(&mut Pair)) {
        let pair = &mut self.pairs[channel];
        let lagged = pair.sent > pair.received;
        change(pair);
        let lags = pair.sent > pair.received;
        self.lagging = self.lagging + usize::from(lags) - usize::from(lagged);
    }
}
