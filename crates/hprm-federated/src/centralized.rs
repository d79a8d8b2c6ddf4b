//! A federate under centralized coordination: it tells the RTI what it will do next, and does not
//! advance beyond what the RTI has granted.
//!
//! It reports no more than somebody needs: a federate that nobody depends on is silent while it is
//! within its grant, and one without neighbours says nothing at all. The RTI may also say through
//! which tag nobody waits for it. Then it is quiet until there is something beyond, or it sends a
//! message, or it waits itself.

use std::collections::BTreeSet;

use hprm_core::{FederateId, Nanos, PhysicalTime, Tag};

use crate::{Frame, Permission, Step, Topology};

/// How often a federate that a clock may wake at any moment tells others how far its clock is.
const CLOCK_REPORT: Nanos = 10_000_000;

/// See the module.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(crate) struct Centralized {
    has_upstream: bool,
    has_downstream: bool,
    /// By how much, at least, the tags of events that a clock causes exceed it; if there are any.
    by_clock: Option<Nanos>,
    granted: Step,
    /// What the RTI takes to be the next event here.
    told: Step,
    /// Whether it goes through tags level by level, because a message may come back to it at the
    /// same tag.
    stepwise: bool,
    /// The RTI wants to know when nothing is left to do before this tag.
    rest: Option<Tag>,
    /// How many messages have come.
    received: u64,
    /// How many of them the RTI knows to have come.
    acknowledged: u64,
    /// When it was last told how far the clock is.
    told_at: PhysicalTime,
    /// Nobody needs to know what happens here up to this tag.
    quiet: Tag,
    /// How many messages have been sent.
    sent: u64,
    /// The tags of messages that have come, and that the RTI does not know to be processed.
    unconfirmed: BTreeSet<Tag>,
}

impl Centralized {
    pub(crate) fn new(topology: &Topology, me: FederateId) -> Self {
        Self {
            has_upstream: !topology.upstream(me).is_empty(),
            has_downstream: !topology.downstream(me).is_empty(),
            by_clock: topology.by_clock(me),
            granted: Step::NEVER,
            told: Step::NEVER,
            stepwise: topology.is_stepwise(me),
            rest: topology.starves().then(|| topology.timeout()),
            received: 0,
            acknowledged: 0,
            told_at: PhysicalTime(i64::MIN),
            quiet: Tag::NEVER,
            sent: 0,
            unconfirmed: BTreeSet::new(),
        }
    }

    /// Whether the RTI lets it process a step.
    pub(crate) fn permission(&self, step: Step) -> Permission {
        if !self.has_upstream || step <= self.granted {
            Permission::Granted
        } else {
            Permission::Wait
        }
    }

    pub(crate) fn is_stepwise(&self) -> bool {
        self.stepwise
    }

    pub(crate) fn grant(&mut self, through: Step) {
        self.granted = self.granted.max(through);
    }

    /// A message has come; the RTI, which has forwarded it, knows what it causes here.
    pub(crate) fn arrived(&mut self, tag: Tag) {
        self.received += 1;
        self.told = self.told.min(Step::begin(tag));
        if self.has_downstream {
            self.unconfirmed.insert(tag);
        }
    }

    /// A message leaves. Somebody waits for what comes after it.
    pub(crate) fn sent(&mut self) {
        self.sent += 1;
        self.quiet = Tag::NEVER;
    }

    /// The RTI, which knew of so many messages from here, says how long nobody needs reports.
    pub(crate) fn quieten(&mut self, through: Tag, sent: u64) {
        if sent < self.sent {
            return;
        }
        if through < self.quiet {
            self.told_at = PhysicalTime(i64::MIN);
        }
        self.quiet = through;
    }

    /// A message has come that means nothing here; the RTI counts it.
    pub(crate) fn discarded(&mut self) {
        self.received += 1;
    }

    /// The program ends at `tag`. Grants beyond it were given without knowing that.
    pub(crate) fn stop_at(&mut self, tag: Tag) {
        self.granted = self.granted.min(Step::end(tag.pred()));
        self.quiet = Tag::NEVER;
    }

    /// A tag is complete. Returns whether the RTI wants to know; then it forgets what it was told
    /// before. It wants to know of messages that it has forwarded, always.
    pub(crate) fn completed(&mut self, tag: Tag) -> bool {
        self.told = Step::NEVER;
        let processed = self.unconfirmed.first().is_some_and(|message| *message <= tag);
        if tag < self.quiet && !processed {
            return false;
        }
        while self.unconfirmed.first().is_some_and(|message| *message <= tag) {
            self.unconfirmed.pop_first();
        }
        self.has_upstream || self.has_downstream
    }

    /// The next event to report, if that is of use. `next` is the scheduler's; what a clock causes
    /// comes after the `current` tag.
    pub(crate) fn report(
        &mut self,
        now: PhysicalTime,
        start: PhysicalTime,
        current: Tag,
        next: Step,
    ) -> Option<Frame> {
        let clock = self.clock(now, start).map(|clock| Step::begin(clock.max(current.succ())));
        let certain = clock.map_or(next, |clock| next.min(clock));
        let asks = self.has_upstream && !self.has(certain);
        let rests = self.rest.is_some_and(|rest| certain.tag >= rest);
        // What takes back a report is always needed.
        let needed = self.has_downstream && (certain.tag > self.quiet || certain < self.told);
        if !(needed || asks || rests) {
            return None;
        }
        if certain < next {
            if now < self.told_at.plus(CLOCK_REPORT) {
                return None;
            }
            self.told_at = now;
        }
        if certain == self.told && !(self.stepwise && self.acknowledged < self.received) {
            return None;
        }
        self.told = certain;
        if certain.tag > self.quiet {
            self.quiet = Tag::NEVER;
        }
        self.acknowledged = self.received;
        Some(match self.stepwise {
            true => Frame::NextEventLevel { step: certain, received: self.received },
            false => Frame::NextEventTag { tag: certain.tag },
        })
    }

    /// Whether the grant covers what has to be known for the next event to happen.
    fn has(&self, next: Step) -> bool {
        let needed = if self.stepwise { next } else { Step::end(next.tag) };
        needed <= self.granted
    }

    /// When to report again how far the clock is.
    pub(crate) fn next_wakeup(&self, start: PhysicalTime, next: Step) -> Option<PhysicalTime> {
        let delay = self.by_clock.filter(|_| self.has_downstream && self.told < next)?;
        // Nobody may need to know, but what it waits for itself may depend on it.
        let asks = self.has_upstream && !self.has(next);
        if next.tag <= self.quiet && !asks {
            return None;
        }
        // Until the clock is beyond that, there is nothing to ask for either.
        let granted = if self.stepwise { self.granted.tag } else { self.granted.whole() };
        let through = if asks { self.quiet.min(granted) } else { self.quiet };
        let needed = match through {
            Tag::NEVER => PhysicalTime(i64::MIN),
            quiet => quiet.due(start).plus(1).plus(delay.saturating_neg()),
        };
        Some(self.told_at.plus(CLOCK_REPORT).max(needed))
    }

    /// The earliest tag that a clock can still cause, if others depend on it.
    fn clock(&self, now: PhysicalTime, start: PhysicalTime) -> Option<Tag> {
        let delay = self.by_clock.filter(|_| self.has_downstream)?;
        Some(Tag::new(now.since(start).max(0).saturating_add(delay), 0))
    }
}
