//! A federate under decentralized coordination: it decides for itself when it has waited enough.
//!
//! A channel is known through the tag of its last message, because tags on a channel increase. A
//! tag may begin once every input is known through it, or has been waited for as long as the
//! program says: `maxwait`, and `absent_after` of the connection.
//!
//! Where the program says "for ever", two federates could wait for one another although neither
//! will send. So in such a federation everybody reports from time to time what it will do next and
//! what it has sent and received, and the RTI answers through which tag nothing more can come.

use std::collections::{BTreeMap, BTreeSet};

use hprm_core::{ChannelId, FederateId, Nanos, PhysicalTime, Program, Tag};

use crate::{Count, Permission, Topology};

/// The least time between two reports of one federate.
const REPORT: Nanos = 10_000_000;

#[derive(Clone, PartialEq, Eq, Hash, Debug)]
struct Incoming {
    from: FederateId,
    known: Tag,
    absent_after: Nanos,
    received: u64,
}

/// See the module.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(crate) struct Decentralized {
    maxwait: Nanos,
    incoming: BTreeMap<ChannelId, Incoming>,
    /// Messages sent, by channel.
    sent: BTreeMap<ChannelId, u64>,
    /// The RTI says that every input is known through this tag.
    safe: Tag,
    by_clock: Option<Nanos>,
    /// Whether reports are of use at all.
    reports: bool,
    /// Channels whose counts have changed since the last report.
    unreported: BTreeSet<ChannelId>,
    reported: Tag,
    reported_at: PhysicalTime,
}

impl Decentralized {
    pub(crate) fn new(program: &Program, topology: &Topology, me: FederateId) -> Self {
        let logical = || topology.channels().iter().filter(|(_, channel)| !channel.physical);
        let incoming = logical().filter(|(_, channel)| channel.to == me).map(|(id, channel)| {
            let incoming = Incoming {
                from: channel.from,
                known: channel.delay.shift(Tag::START).pred(),
                absent_after: program.connections[channel.connection].absent_after,
                received: 0,
            };
            (id, incoming)
        });
        let sent = logical().filter(|(_, channel)| channel.from == me).map(|(id, _)| (id, 0));
        Self {
            maxwait: program.federates[me].maxwait,
            incoming: incoming.collect(),
            sent: sent.collect(),
            safe: Tag::NEVER,
            by_clock: topology.by_clock(me),
            reports: topology.is_patient(),
            unreported: BTreeSet::new(),
            reported: Tag::NEVER,
            reported_at: PhysicalTime(0),
        }
    }

    pub(crate) fn permission(
        &self,
        tag: Tag,
        now: PhysicalTime,
        start: PhysicalTime,
    ) -> Permission {
        if tag <= self.safe {
            return Permission::Granted;
        }
        let unknown = self.incoming.values().filter(|incoming| incoming.known < tag);
        let Some(absent_after) = unknown.map(|incoming| incoming.absent_after).max() else {
            return Permission::Granted;
        };
        match tag.due(start).plus(self.maxwait).plus(absent_after) {
            PhysicalTime::FOREVER => Permission::Wait,
            until if now >= until => Permission::Granted,
            until => Permission::WaitUntil(until),
        }
    }

    pub(crate) fn sent(&mut self, channel: ChannelId) {
        if let Some(sent) = self.sent.get_mut(&channel) {
            *sent += 1;
            self.unreported.insert(channel);
        }
    }

    pub(crate) fn received(&mut self, channel: ChannelId, tag: Tag) {
        if let Some(incoming) = self.incoming.get_mut(&channel) {
            incoming.received += 1;
            incoming.known = incoming.known.max(tag);
            self.unreported.insert(channel);
        }
    }

    /// Nothing more comes from a peer.
    pub(crate) fn closed(&mut self, peer: FederateId) {
        for incoming in self.incoming.values_mut().filter(|incoming| incoming.from == peer) {
            incoming.known = Tag::FOREVER;
        }
    }

    /// The RTI knows of every message up to `tag` that it has arrived.
    pub(crate) fn safe(&mut self, tag: Tag) {
        self.safe = self.safe.max(tag);
    }

    /// The program ends at `tag`. What the RTI has said beyond that was said without knowing it.
    pub(crate) fn stop_at(&mut self, tag: Tag) {
        self.safe = self.safe.min(tag.pred());
    }

    pub(crate) fn begin(&mut self, start: PhysicalTime) {
        self.reported_at = start;
    }

    /// What to report, if something is new and the last report is old enough.
    pub(crate) fn report(
        &mut self,
        now: PhysicalTime,
        start: PhysicalTime,
        next: Tag,
    ) -> Option<(Tag, Vec<Count>)> {
        let next = self.certain(now, start, next);
        if !self.has_news(next) || now < self.reported_at.plus(REPORT) {
            return None;
        }
        self.reported_at = now;
        Some((next, self.counts(next)))
    }

    /// What to report before resigning, if anything.
    pub(crate) fn last_report(&mut self) -> Option<(Tag, Vec<Count>)> {
        self.reports.then(|| (Tag::FOREVER, self.counts(Tag::FOREVER)))
    }

    /// When to report again.
    pub(crate) fn next_wakeup(&self, next: Tag) -> Option<PhysicalTime> {
        self.has_news(next).then(|| self.reported_at.plus(REPORT))
    }

    /// The next event, or the earliest that a clock can still cause.
    fn certain(&self, now: PhysicalTime, start: PhysicalTime, next: Tag) -> Tag {
        let clock = |delay| Tag::new(now.since(start).max(0).saturating_add(delay), 0);
        self.by_clock.map_or(next, |delay| next.min(clock(delay)))
    }

    fn has_news(&self, next: Tag) -> bool {
        self.reports && (next != self.reported || !self.unreported.is_empty())
    }

    fn counts(&mut self, next: Tag) -> Vec<Count> {
        self.reported = next;
        let count = |channel| {
            let received = || self.incoming.get(&channel).map(|incoming| incoming.received);
            let messages = self.sent.get(&channel).copied().or_else(received);
            messages.map(|messages| Count { channel, messages })
        };
        std::mem::take(&mut self.unreported).into_iter().filter_map(count).collect()
    }
}
