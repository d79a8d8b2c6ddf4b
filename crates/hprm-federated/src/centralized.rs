//! A federate under centralized coordination: it reports to the RTI what it will do next, and does not
//! advance beyond its grant.
//!
//! It reports no more than others need: a federate on which no other one depends sends no reports while
//! it is within its grant, and a federate without neighbours sends none at all. The RTI may also send a
//! downstream next event tag (DNET), through which no other federate waits for this one. Then the
//! federate skips its reports until it has an event beyond that tag, or sends a message, or waits for a
//! grant itself.

use std::collections::BTreeSet;

use hprm_core::{FederateId, Nanos, PhysicalTime, Tag};

use crate::{Blocker, Frame, Permission, Step, Topology};

/// How often a federate that a clock may wake at any moment reports how far its clock is.
const CLOCK_REPORT: Nanos = 10_000_000;

/// See the module.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(crate) struct Centralized {
    has_upstream: bool,
    has_downstream: bool,
    /// By how much, at least, the tags of events that a clock causes exceed it; if there are any.
    by_clock: Option<Nanos>,
    granted: Step,
    /// What the RTI believes the next event of this federate to be.
    reported: Step,
    /// Whether the federate goes through tags level by level, because a message may come back to it at
    /// the same tag.
    stepwise: bool,
    /// The RTI wants to know when this federate is idle until this tag.
    idle_until: Option<Tag>,
    /// How many messages have arrived.
    received: u64,
    /// How many of them the RTI knows to have arrived.
    acknowledged: u64,
    /// When this federate last reported how far its clock is.
    clock_reported_at: PhysicalTime,
    /// The tag of the DNET that is in force: the federate skips its reports through that tag. `NEVER` if
    /// there is none.
    skips_through: Tag,
    /// How many messages this federate has sent.
    sent: u64,
    /// The tags of messages that have arrived, and that the RTI does not know to be processed.
    unconfirmed: BTreeSet<Tag>,
}

impl Centralized {
    pub(crate) fn new(topology: &Topology, me: FederateId) -> Self {
        Self {
            has_upstream: !topology.upstream(me).is_empty(),
            has_downstream: !topology.downstream(me).is_empty(),
            by_clock: topology.by_clock(me),
            granted: Step::NEVER,
            reported: Step::NEVER,
            stepwise: topology.is_stepwise(me),
            idle_until: topology.starves().then(|| topology.timeout()),
            received: 0,
            acknowledged: 0,
            clock_reported_at: PhysicalTime(i64::MIN),
            skips_through: Tag::NEVER,
            sent: 0,
            unconfirmed: BTreeSet::new(),
        }
    }

    /// Whether the grant covers a step.
    pub(crate) fn permission(&self, step: Step) -> Permission {
        if !self.has_upstream || step <= self.granted {
            Permission::Granted
        } else {
            Permission::Wait
        }
    }

    /// Says so, if the grant does not cover a step.
    pub(crate) fn blocker(&self, through: Step) -> Option<Blocker> {
        let waits = self.permission(through) != Permission::Granted;
        waits.then_some(Blocker::Grant { through })
    }

    pub(crate) fn is_stepwise(&self) -> bool {
        self.stepwise
    }

    pub(crate) fn grant(&mut self, through: Step) {
        self.granted = self.granted.max(through);
    }

    /// A message has arrived. The RTI has forwarded it, so it knows what that causes here.
    pub(crate) fn arrived(&mut self, tag: Tag) {
        self.received += 1;
        self.reported = self.reported.min(Step::begin(tag));
        if self.has_downstream {
            self.unconfirmed.insert(tag);
        }
    }

    /// This federate sends a message. Its receiver waits for what comes after it.
    pub(crate) fn sent(&mut self) {
        self.sent += 1;
        self.skips_through = Tag::NEVER;
    }

    /// A DNET has arrived: no other federate needs reports through that tag. The RTI knew of the first
    /// `sent` messages of this federate; if there are more, the DNET is void.
    pub(crate) fn skip_reports(&mut self, through: Tag, sent: u64) {
        if sent < self.sent {
            return;
        }
        if through < self.skips_through {
            self.clock_reported_at = PhysicalTime(i64::MIN);
        }
        self.skips_through = through;
    }

    /// A message has arrived that this federate discards; the RTI counts it.
    pub(crate) fn discarded(&mut self) {
        self.received += 1;
    }

    /// The program ends at `tag`. The RTI made grants beyond it without knowing that.
    pub(crate) fn stop_at(&mut self, tag: Tag) {
        self.granted = self.granted.min(Step::end(tag.pred()));
        self.skips_through = Tag::NEVER;
    }

    /// A tag is complete. Returns whether to report that to the RTI, which then discards the report from
    /// before. The RTI always needs to know when a message that it has forwarded is processed.
    pub(crate) fn completed(&mut self, tag: Tag) -> bool {
        self.reported = Step::NEVER;
        let processed = self.unconfirmed.first().is_some_and(|message| *message <= tag);
        if tag < self.skips_through && !processed {
            return false;
        }
        while self.unconfirmed.first().is_some_and(|message| *message <= tag) {
            self.unconfirmed.pop_first();
        }
        self.has_upstream || self.has_downstream
    }

    /// The report of the next event, if it is useful. `next` is the scheduler's; what a clock causes
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
        let idle = self.idle_until.is_some_and(|until| certain.tag >= until);
        // A report of an earlier event than the last one is always needed.
        let needed =
            self.has_downstream && (certain.tag > self.skips_through || certain < self.reported);
        if !(needed || asks || idle) {
            return None;
        }
        if certain < next {
            if now < self.clock_reported_at.plus(CLOCK_REPORT) {
                return None;
            }
            self.clock_reported_at = now;
        }
        if certain == self.reported && !(self.stepwise && self.acknowledged < self.received) {
            return None;
        }
        self.reported = certain;
        if certain.tag > self.skips_through {
            self.skips_through = Tag::NEVER;
        }
        self.acknowledged = self.received;
        Some(match self.stepwise {
            true => Frame::NextEventLevel { step: certain, received: self.received },
            false => Frame::NextEventTag { tag: certain.tag },
        })
    }

    /// Whether the grant covers the next event.
    fn has(&self, next: Step) -> bool {
        let needed = if self.stepwise { next } else { Step::end(next.tag) };
        needed <= self.granted
    }

    /// When to report the clock again.
    pub(crate) fn next_wakeup(&self, start: PhysicalTime, next: Step) -> Option<PhysicalTime> {
        let delay = self.by_clock.filter(|_| self.has_downstream && self.reported < next)?;
        // Even if no other federate needs the report, the grant of this one may depend on it.
        let asks = self.has_upstream && !self.has(next);
        if next.tag <= self.skips_through && !asks {
            return None;
        }
        // Until the clock is beyond the grant, this federate asks for nothing either.
        let granted = if self.stepwise { self.granted.tag } else { self.granted.whole() };
        let through = if asks { self.skips_through.min(granted) } else { self.skips_through };
        let needed = match through {
            Tag::NEVER => PhysicalTime(i64::MIN),
            through => through.due(start).plus(1).plus(delay.saturating_neg()),
        };
        Some(self.clock_reported_at.plus(CLOCK_REPORT).max(needed))
    }

    /// The earliest tag that a clock can still cause, if others depend on it.
    fn clock(&self, now: PhysicalTime, start: PhysicalTime) -> Option<Tag> {
        let delay = self.by_clock.filter(|_| self.has_downstream)?;
        Some(Tag::new(now.since(start).max(0).saturating_add(delay), 0))
    }
}
