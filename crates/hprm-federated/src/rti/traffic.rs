//! Which reports of decentralized federates go together.
//!
//! Decentralized federates send one another messages directly, so a report of what a federate will
//! do next is worth something only if it knows of every message that was sent to it before the
//! reports of its senders. Each end of a channel counts. Where the receiver has counted at least
//! as many messages as the sender, every further message was sent after the sender's report; by
//! induction over what causes what, it has no earlier tag than the reports allow.

use std::collections::BTreeSet;

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

    /// The channels whose receiver has not reported all that the sender has.
    pub(super) fn lagging(&self) -> impl Iterator<Item = ChannelId> {
        let pairs = self.pairs.iter().filter(|(_, pair)| pair.sent > pair.received);
        pairs.map(|(channel, _)| channel).take(self.lagging)
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

    /// A federate knows of another one that joins: both count their channels from zero. As long as the
    /// joining federate has not started, it reports nothing, and the RTI does not wait for what it
    /// receives.
    pub(super) fn meet(&mut self, topology: &Topology, one: FederateId, joining: FederateId) {
        for (id, channel) in topology.channels().iter() {
            if (channel.from, channel.to) == (one, joining) {
                self.update(id, |pair| *pair = Pair { sent: 0, received: u64::MAX });
            } else if (channel.from, channel.to) == (joining, one) {
                self.update(id, |pair| *pair = Pair::default());
            }
        }
    }

    /// A federate that joins starts, and reports what it receives from those that have `met` it. What
    /// others have sent to its predecessor does not count.
    pub(super) fn start(
        &mut self,
        topology: &Topology,
        federate: FederateId,
        met: &BTreeSet<FederateId>,
    ) {
        for (id, channel) in topology.channels().iter() {
            if channel.to == federate && channel.from != federate {
                let sent = |pair: &Pair| if met.contains(&channel.from) { pair.sent } else { 0 };
                self.update(id, |pair| *pair = Pair { sent: sent(pair), received: 0 });
            }
        }
    }

    /// A federate has ended: messages to it do not count any more. If it has not ended in order, it may
    /// have sent more than it has reported, until its receivers report that nothing more comes.
    pub(super) fn end(&mut self, topology: &Topology, federate: FederateId, in_order: bool) {
        for (id, channel) in topology.channels().iter() {
            if channel.to == federate {
                self.update(id, |pair| pair.received = u64::MAX);
            } else if channel.from == federate && !channel.physical && !in_order {
                self.update(id, |pair| pair.sent = u64::MAX);
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
