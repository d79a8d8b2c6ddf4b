//! A federate under decentralized coordination: it decides for itself when it has waited enough.
//!
//! A channel is known through the tag of its last message, because tags on a channel increase. Two
//! waits count from the time at which a tag is due. A tag begins once every input is known through the
//! tag before, or `maxwait` is over; so no message for an earlier tag is missed. A level of its reactions
//! is passed once every input that it reads is known through the tag itself, or `maxwait` and the
//! `absent_after` of that connection are over. So a reaction waits for what it reads, and for nothing
//! else.
//!
//! A federate goes through tags level by level if that makes a difference. Where all waits end at one
//! moment, or never, it waits for whole tags, which takes fewer steps. On a cycle without a delay it
//! also tells the other federates of the cycle when nothing comes on a channel at a tag.
//!
//! Where the program says "for ever", two federates could wait for one another although neither
//! will send. So in such a federation every federate reports from time to time what it will do next
//! and what it has sent and received, and the RTI answers through which tag nothing more can come.

use hprm_core::{Channel, ChannelId, FederateId, Nanos, PhysicalTime, Program, SortedMap, Tag};

use crate::{Blocker, Count, Permission, Step, Topology};

/// The least time between two reports of one federate.
const REPORT: Nanos = 10_000_000;

#[derive(Clone, PartialEq, Eq, Hash, Debug)]
struct Incoming {
    from: FederateId,
    known: Tag,
    absent_after: Nanos,
    received: u64,
    /// The tag of the latest message, while a transient sender is joining.
    latest: Tag,
    /// The level at which it is read first.
    level: u32,
    /// Through which level of a tag the RTI must vouch for it.
    vouched: u32,
}

/// Which reports the RTI needs.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
enum Reports {
    /// None: no federate waits for ever, and the program does not end by itself.
    None,
    /// That this federate is idle until this tag.
    Idle(Tag),
    /// All.
    All,
}

/// Channels, sorted: few, and mostly the same ones again.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Default)]
struct Unreported(Vec<ChannelId>);

impl Unreported {
    fn insert(&mut self, channel: ChannelId) {
        if let Err(at) = self.0.binary_search(&channel) {
            self.0.insert(at, channel);
        }
    }

    fn remove(&mut self, channel: ChannelId) {
        self.0.retain(|it| *it != channel);
    }
}

/// An undelayed channel between federates that go through tags level by level.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
struct CyclicChannel {
    to: FederateId,
    last_writer: u32,
    /// The latest tag of which the receiver knows whether there is a message.
    settled: Tag,
}

/// See the module.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(crate) struct Decentralized {
    maxwait: Nanos,
    incoming: SortedMap<ChannelId, Incoming>,
    /// Messages sent, by channel.
    sent: SortedMap<ChannelId, u64>,
    cyclic: SortedMap<ChannelId, CyclicChannel>,
    /// Whether the federate is on a cycle without a delay.
    on_cycle: bool,
    /// Whether the program states an `absent_after` for some input.
    uneven: bool,
    /// The RTI says that every input is known through this step.
    safe: Step,
    by_clock: Option<Nanos>,
    reports: Reports,
    /// Channels whose counts have changed since the last report.
    unreported: Unreported,
    reported: Step,
    reported_at: PhysicalTime,
}

impl Decentralized {
    pub(crate) fn new(program: &Program, topology: &Topology, me: FederateId) -> Self {
        let absent_after = |channel: &Channel| program.connections[channel.connection].absent_after;
        let reports = if topology.is_patient() { Some(Reports::All) } else { None };
        Self::waiting(topology, me, program.federates[me].maxwait, absent_after, reports)
    }

    /// A federate that waits for ever, because boards tell it what its messages do not. The RTI needs to know
    /// nothing but whether it is idle.
    pub(crate) fn on_boards(topology: &Topology, me: FederateId) -> Self {
        Self::waiting(topology, me, Nanos::MAX, |_| 0, None)
    }

    /// `reports` are those that the RTI needs, if it needs more than whether the federate is idle.
    fn waiting(
        topology: &Topology,
        me: FederateId,
        maxwait: Nanos,
        absent_after: impl Fn(&Channel) -> Nanos,
        reports: Option<Reports>,
    ) -> Self {
        let on_cycle = topology.is_stepwise(me);
        let logical = || topology.channels().iter().filter(|(_, channel)| !channel.physical);
        let incoming = logical().filter(|(_, channel)| channel.to == me).map(|(id, channel)| {
            let incoming = Incoming {
                from: channel.from,
                known: channel.delay.shift(Tag::START).pred(),
                absent_after: absent_after(channel),
                received: 0,
                latest: Tag::NEVER,
                level: channel.first_reader,
                vouched: if channel.is_direct() { channel.first_reader } else { 0 },
            };
            (id, incoming)
        });
        let cyclic = logical()
            .filter(|(_, c)| {
                c.from == me && c.is_direct() && on_cycle && topology.is_stepwise(c.to)
            })
            .map(|(id, channel)| {
                let Channel { to, last_writer, .. } = *channel;
                (id, CyclicChannel { to, last_writer, settled: Tag::NEVER })
            });
        let sent = logical().filter(|(_, channel)| channel.from == me).map(|(id, _)| (id, 0));
        let incoming: SortedMap<_, Incoming> = incoming.collect();
        let uneven = incoming.values().any(|incoming| incoming.absent_after > 0);
        Self {
            maxwait,
            uneven,
            incoming,
            sent: sent.collect(),
            cyclic: cyclic.collect(),
            on_cycle,
            safe: Step::NEVER,
            by_clock: topology.by_clock(me),
            reports: reports.unwrap_or(match topology.starves() {
                true => Reports::Idle(topology.timeout()),
                false => Reports::None,
            }),
            unreported: Unreported::default(),
            reported: Step::NEVER,
            reported_at: PhysicalTime(0),
        }
    }

    /// Whether the federate goes through tags level by level. Without a limit to `maxwait`, and with one
    /// of zero, it waits for all inputs until one moment, unless the program states an `absent_after`.
    pub(crate) fn is_stepwise(&self) -> bool {
        let waits = self.maxwait > 0 && self.maxwait < Nanos::MAX;
        self.on_cycle || !self.incoming.is_empty() && (self.uneven || waits)
    }

    /// Whether a tag may begin: every input is known through the tag before, or the wait for it is over.
    /// If the federate does not go level by level, all that it reads must be known.
    pub(crate) fn may_begin(&self, tag: Tag, now: PhysicalTime, start: PhysicalTime) -> Permission {
        if !self.is_stepwise() {
            return self.permission(Step::end(tag), now, start);
        }
        let before = Step::end(tag.pred());
        let unknown = self.incoming.values().any(|incoming| !self.knows(incoming, before));
        until(unknown.then_some(self.maxwait), tag, now, start)
    }

    /// Whether the federate may process the step: every input that it reads up to there is known, or the
    /// wait for it is over.
    pub(crate) fn permission(
        &self,
        step: Step,
        now: PhysicalTime,
        start: PhysicalTime,
    ) -> Permission {
        if step <= self.safe {
            return Permission::Granted;
        }
        let wait_for = |incoming: &Incoming| {
            let (needed, wait) = self.needed(incoming, step);
            (!self.knows(incoming, needed)).then_some(wait)
        };
        until(self.incoming.values().filter_map(wait_for).max(), step.tag, now, start)
    }

    /// Through which step an input must be known before another step is processed, and how long to wait for that.
    fn needed(&self, incoming: &Incoming, step: Step) -> (Step, Nanos) {
        match incoming.level <= step.level {
            true => {
                let wait = self.maxwait.saturating_add(incoming.absent_after);
                (Step { tag: step.tag, level: incoming.vouched }, wait)
            }
            // An input that is read at a later level must not bring a message for an earlier tag.
            false => (Step::end(step.tag.pred()), self.maxwait),
        }
    }

    /// The inputs for which the beginning of a tag waits.
    pub(crate) fn begin_blockers(
        &self,
        tag: Tag,
        now: PhysicalTime,
        start: PhysicalTime,
    ) -> Vec<Blocker> {
        let before = Step::end(tag.pred());
        match self.is_stepwise() {
            true => self.unknown((tag, now, start), |_| (before, self.maxwait)),
            false => self.blockers(Step::end(tag), now, start),
        }
    }

    /// The inputs for which a step waits.
    pub(crate) fn blockers(
        &self,
        step: Step,
        now: PhysicalTime,
        start: PhysicalTime,
    ) -> Vec<Blocker> {
        if step <= self.safe {
            return Vec::new();
        }
        self.unknown((step.tag, now, start), |incoming| self.needed(incoming, step))
    }

    /// The inputs that are not known as far as is needed, and for which the wait is not over.
    fn unknown(
        &self,
        (tag, now, start): (Tag, PhysicalTime, PhysicalTime),
        needed: impl Fn(&Incoming) -> (Step, Nanos),
    ) -> Vec<Blocker> {
        let blocker = |(channel, incoming): (&ChannelId, &Incoming)| {
            let (needed, wait) = needed(incoming);
            let unknown = (!self.knows(incoming, needed)).then_some(wait);
            let until = match until(unknown, tag, now, start) {
                Permission::Granted => return None,
                Permission::WaitUntil(until) => Some(until),
                Permission::Wait => None,
            };
            let (channel, from, through) = (*channel, incoming.from, needed.tag);
            Some(Blocker::Message { channel, from, through, until })
        };
        self.incoming.iter().filter_map(blocker).collect()
    }

    /// Through which step the inputs must be known that a tag needs to begin and that are not; `NEVER` if there is none.
    pub(crate) fn needs_to_begin(&self, tag: Tag) -> Step {
        match self.is_stepwise() {
            true => self.furthest(|_| Step::end(tag.pred())),
            false => self.needs(Step::end(tag)),
        }
    }

    /// The same for a step within a tag.
    pub(crate) fn needs(&self, step: Step) -> Step {
        match step <= self.safe {
            true => Step::NEVER,
            false => self.furthest(|incoming| self.needed(incoming, step).0),
        }
    }

    fn furthest(&self, needed: impl Fn(&Incoming) -> Step) -> Step {
        let unknown = self.incoming.values().map(|incoming| (incoming, needed(incoming)));
        let unknown = unknown.filter(|(incoming, needed)| !self.knows(incoming, *needed));
        unknown.map(|(_, needed)| needed).max().unwrap_or(Step::NEVER)
    }

    /// Whether no message can come on an input any more for a tag, or an earlier one. The RTI vouches
    /// for that through a level of it.
    fn knows(&self, incoming: &Incoming, Step { tag, level }: Step) -> bool {
        incoming.known >= tag || Step { tag, level } <= self.safe
    }

    /// All levels of `next`'s tag before its own are done. Returns the channels on which no message comes at that
    /// tag, as their receivers must learn, and the last level at which one of them could be written: every writer of
    /// such a channel has run, or will not run because nothing may trigger it any more.
    pub(crate) fn absent_channels(
        &mut self,
        next: Step,
        now: PhysicalTime,
        start: PhysicalTime,
    ) -> (Vec<(FederateId, ChannelId)>, Option<u32>) {
        let tag = next.tag;
        let open = self.cyclic.iter();
        let open = open.filter(|(_, c)| c.settled < tag && c.last_writer < next.level);
        let done = open.filter(|(_, cyclic)| {
            let level = cyclic.last_writer;
            self.permission(Step { tag, level }, now, start) == Permission::Granted
        });
        let done: Vec<_> = done.map(|(id, cyclic)| (cyclic.to, *id)).collect();
        let mut last = None;
        for (_, id) in &done {
            if let Some(cyclic) = self.cyclic.get_mut(id) {
                cyclic.settled = tag;
                last = last.max(Some(cyclic.last_writer));
            }
        }
        (done, last)
    }

    /// No message comes on a channel up to `tag`.
    pub(crate) fn absent(&mut self, channel: ChannelId, tag: Tag) {
        if let Some(incoming) = self.incoming.get_mut(&channel) {
            incoming.known = incoming.known.max(tag);
        }
    }

    pub(crate) fn sent(&mut self, channel: ChannelId, tag: Tag) {
        if let Some(cyclic) = self.cyclic.get_mut(&channel) {
            cyclic.settled = cyclic.settled.max(tag);
        }
        if let Some(sent) = self.sent.get_mut(&channel) {
            *sent += 1;
            self.unreported.insert(channel);
        }
    }

    pub(crate) fn received(&mut self, channel: ChannelId, tag: Tag) {
        if let Some(incoming) = self.incoming.get_mut(&channel) {
            incoming.received = incoming.received.saturating_add(1);
            incoming.latest = incoming.latest.max(tag);
            incoming.known = incoming.known.max(tag);
            self.unreported.insert(channel);
        }
    }

    /// The program has changed how long to wait.
    pub(crate) fn set_maxwait(&mut self, maxwait: Nanos) {
        self.maxwait = maxwait;
    }

    /// Nothing more comes from a peer. Messages of the peer that have not arrived are lost with it, as
    /// may happen if it is transient and dies: this federate does not wait for them, so they count as
    /// received.
    pub(crate) fn closed(&mut self, peer: FederateId) {
        for (id, incoming) in self.incoming.iter_mut() {
            if incoming.from == peer {
                incoming.known = Tag::FOREVER;
                incoming.received = u64::MAX;
                self.unreported.insert(*id);
            }
        }
    }

    /// The RTI knows that every message that is read up to there has arrived.
    pub(crate) fn safe(&mut self, through: Step) {
        self.safe = self.safe.max(through);
    }

    /// Through which step every message has arrived that is read there, by what is known besides messages.
    pub(crate) fn safe_through(&self) -> Step {
        self.safe
    }

    /// Every message that is read up to there has arrived. What was known before may not be true any more: another
    /// federate may do something earlier than it had said, and knows that this one has not relied on it.
    pub(crate) fn only_safe(&mut self, through: Step) {
        self.safe = through;
    }

    /// The program ends at `tag`. The RTI did not know that when it vouched for later tags.
    pub(crate) fn stop_at(&mut self, tag: Tag) {
        self.safe = self.safe.min(Step::end(tag.pred()));
    }

    pub(crate) fn begin(&mut self, start: PhysicalTime, first: Tag) {
        self.reported_at = start;
        for incoming in self.incoming.values_mut() {
            incoming.known = incoming.known.max(first.pred());
        }
    }

    /// A peer is about to join: both ends count from zero. The RTI relies on no earlier report from now on, because
    /// none may have counted all messages of the peer's predecessor, so this federate reports again.
    pub(crate) fn meets(&mut self, topology: &Topology, peer: FederateId) {
        self.reported = Step::NEVER;
        for (id, channel) in topology.channels().iter() {
            if channel.from == peer
                && let Some(incoming) = self.incoming.get_mut(&id)
            {
                (incoming.received, incoming.latest) = (0, Tag::NEVER);
                self.unreported.remove(id);
            }
            if channel.to == peer
                && let Some(sent) = self.sent.get_mut(&id)
            {
                *sent = 0;
                self.unreported.remove(id);
            }
        }
    }

    /// A peer has joined, and does nothing before `first`.
    pub(crate) fn joined(&mut self, topology: &Topology, peer: FederateId, first: Tag) {
        for (id, channel) in topology.channels().iter() {
            if channel.from == peer
                && let Some(incoming) = self.incoming.get_mut(&id)
            {
                // A message of the peer may have been faster than the frame of the RTI.
                incoming.known = channel.delay.shift(first).pred().max(incoming.latest);
            }
        }
    }

    /// What to report, if something is new and the last report is old enough. What a clock causes
    /// comes after the `current` tag.
    pub(crate) fn report(
        &mut self,
        now: PhysicalTime,
        start: PhysicalTime,
        current: Tag,
        next: Step,
    ) -> Option<(Step, Vec<Count>)> {
        if self.reports == Reports::None {
            return None;
        }
        let next = self.certain(now, start, current, next);
        // Within a tag, the other federates of the cycle wait as well.
        let urgent = next.tag == current && next != self.reported;
        if !self.has_news(next) || now < self.reported_at.plus(REPORT) && !urgent {
            return None;
        }
        self.reported_at = now;
        Some((next, self.counts(next)))
    }

    /// What to report before resigning, if anything.
    pub(crate) fn last_report(&mut self) -> Option<(Step, Vec<Count>)> {
        (self.reports != Reports::None).then(|| (Step::FOREVER, self.counts(Step::FOREVER)))
    }

    /// When to report again.
    pub(crate) fn next_wakeup(&self, next: Step) -> Option<PhysicalTime> {
        self.has_news(next).then(|| self.reported_at.plus(REPORT))
    }

    /// The next event, or the earliest that a clock can still cause.
    pub(crate) fn certain(
        &self,
        now: PhysicalTime,
        start: PhysicalTime,
        current: Tag,
        next: Step,
    ) -> Step {
        let clock = |delay| Tag::new(now.since(start).max(0).saturating_add(delay), 0);
        let clock = self.by_clock.map(|delay| Step::begin(clock(delay).max(current.succ())));
        clock.map_or(next, |clock| next.min(clock))
    }

    fn has_news(&self, next: Step) -> bool {
        let is_new = next != self.reported || !self.unreported.0.is_empty();
        match self.reports {
            Reports::None => false,
            Reports::Idle(until) => is_new && next.tag >= until,
            Reports::All => is_new,
        }
    }

    fn counts(&mut self, next: Step) -> Vec<Count> {
        self.reported = next;
        let count = |channel| {
            let received = || self.incoming.get(&channel).map(|incoming| incoming.received);
            let messages = self.sent.get(&channel).copied().or_else(received);
            messages.map(|messages| Count { channel, messages })
        };
        std::mem::take(&mut self.unreported).0.into_iter().filter_map(count).collect()
    }
}

/// The answer, if a tag waits for so long after it is due, or for nothing.
fn until(wait: Option<Nanos>, tag: Tag, now: PhysicalTime, start: PhysicalTime) -> Permission {
    match wait.map(|wait| tag.due(start).plus(wait)) {
        None => Permission::Granted,
        Some(PhysicalTime::FOREVER) => Permission::Wait,
        Some(until) if now >= until => Permission::Granted,
        Some(until) => Permission::WaitUntil(until),
    }
}
