//! A federate under centralized coordination: it tells the RTI what it will do next, and does not
//! advance beyond what the RTI has granted.
//!
//! It reports no more than somebody needs: a federate that nobody depends on is silent while it is
//! within its grant, and one without neighbours says nothing at all.

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
    }

    /// A message has come that means nothing here; the RTI counts it.
    pub(crate) fn discarded(&mut self) {
        self.received += 1;
    }

    /// The program ends at `tag`. Grants beyond it were given without knowing that.
    pub(crate) fn stop_at(&mut self, tag: Tag) {
        self.granted = self.granted.min(Step::end(tag.pred()));
    }

    /// A tag is complete. Returns whether the RTI wants to know; then it forgets what it was told
    /// before.
    pub(crate) fn completed(&mut self) -> bool {
        self.told = Step::NEVER;
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
        if certain < next {
            if now < self.told_at.plus(CLOCK_REPORT) {
                return None;
            }
            self.told_at = now;
        }
        let asks = self.has_upstream && !self.has(certain);
        let news = certain != self.told || self.stepwise && self.acknowledged < self.received;
        let rests = self.rest.is_some_and(|rest| certain.tag >= rest);
        if !news || !(self.has_downstream || asks || rests) {
            return None;
        }
        self.told = certain;
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
    pub(crate) fn next_wakeup(&self, next: Step) -> Option<PhysicalTime> {
        let reports = self.by_clock.is_some() && self.has_downstream && self.told < next;
        reports.then(|| self.told_at.plus(CLOCK_REPORT))
    }

    /// The earliest tag that a clock can still cause, if others depend on it.
    fn clock(&self, now: PhysicalTime, start: PhysicalTime) -> Option<Tag> {
        let delay = self.by_clock.filter(|_| self.has_downstream)?;
        Some(Tag::new(now.since(start).max(0).saturating_add(delay), 0))
    }
}
