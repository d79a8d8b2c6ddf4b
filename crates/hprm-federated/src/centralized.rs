//! A federate under centralized coordination: it tells the RTI what it will do next, and does not
//! advance beyond what the RTI has granted.
//!
//! It reports no more than somebody needs: a federate that nobody depends on is silent while it is
//! within its grant, and one without neighbours says nothing at all.

use hprm_core::{FederateId, Nanos, PhysicalTime, Tag};

use crate::{Permission, Topology};

/// How often a federate that a clock may wake at any moment tells others how far its clock is.
const CLOCK_REPORT: Nanos = 10_000_000;

/// See the module.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(crate) struct Centralized {
    has_upstream: bool,
    has_downstream: bool,
    /// By how much, at least, the tags of events that a clock causes exceed it; if there are any.
    by_clock: Option<Nanos>,
    granted: Tag,
    /// What the RTI takes to be the next event here.
    told: Tag,
    /// When it was last told how far the clock is.
    told_at: PhysicalTime,
}

impl Centralized {
    pub(crate) fn new(topology: &Topology, me: FederateId) -> Self {
        Self {
            has_upstream: !topology.upstream(me).is_empty(),
            has_downstream: !topology.downstream(me).is_empty(),
            by_clock: topology.by_clock(me),
            granted: Tag::NEVER,
            told: Tag::NEVER,
            told_at: PhysicalTime(i64::MIN),
        }
    }

    pub(crate) fn permission(&self, tag: Tag) -> Permission {
        if !self.has_upstream || tag <= self.granted {
            Permission::Granted
        } else {
            Permission::Wait
        }
    }

    pub(crate) fn grant(&mut self, tag: Tag) {
        self.granted = self.granted.max(tag);
    }

    /// A message has come; the RTI, which has forwarded it, knows what it causes here.
    pub(crate) fn arrived(&mut self, tag: Tag) {
        self.told = self.told.min(tag);
    }

    /// The program ends at `tag`. Grants beyond it were given without knowing that.
    pub(crate) fn stop_at(&mut self, tag: Tag) {
        self.granted = self.granted.min(tag.pred());
    }

    /// A tag is complete. Returns whether the RTI wants to know; then it forgets what it was told
    /// before.
    pub(crate) fn completed(&mut self) -> bool {
        self.told = Tag::NEVER;
        self.has_upstream || self.has_downstream
    }

    /// The next event to report, if that is of use. `next` is the scheduler's.
    pub(crate) fn report(
        &mut self,
        now: PhysicalTime,
        start: PhysicalTime,
        next: Tag,
    ) -> Option<Tag> {
        let clock = self.clock(now, start);
        let certain = clock.map_or(next, |clock| next.min(clock));
        if certain < next {
            if now < self.told_at.plus(CLOCK_REPORT) {
                return None;
            }
            self.told_at = now;
        }
        let asks = self.has_upstream && certain > self.granted;
        if certain == self.told || !(self.has_downstream || asks) {
            return None;
        }
        self.told = certain;
        Some(certain)
    }

    /// When to report again how far the clock is.
    pub(crate) fn next_wakeup(&self, next: Tag) -> Option<PhysicalTime> {
        let reports = self.by_clock.is_some() && self.has_downstream && self.told < next;
        reports.then(|| self.told_at.plus(CLOCK_REPORT))
    }

    /// The earliest tag that a clock can still cause, if others depend on it.
    fn clock(&self, now: PhysicalTime, start: PhysicalTime) -> Option<Tag> {
        let delay = self.by_clock.filter(|_| self.has_downstream)?;
        Some(Tag::new(now.since(start).max(0).saturating_add(delay), 0))
    }
}
