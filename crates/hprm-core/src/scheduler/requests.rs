//! The requests of a running reaction besides setting ports: actions, deadlines, the end.

use super::{ScheduleRequest, Scheduled, Scheduler};
use crate::queue::QueuedEvent;
use crate::{
    ActionId, Delay, Nanos, Origin, PhysicalTime, Policy, ReactionId, Reading, Scope, Tag,
};

impl<V: Clone> Scheduler<V> {
    /// Schedules a logical action `extra` nanoseconds after its minimum delay, or a physical one by
    /// the clock (handbook, "actions"). A negative `extra` counts as zero.
    pub fn schedule(
        &mut self,
        action: ActionId,
        extra: Nanos,
        value: Option<V>,
        now: impl Reading,
    ) -> Scheduled {
        let recorded = self.recorder.is_some().then(|| value.clone());
        let outcome = self.insert_action(action, extra, value, now);
        if let Some(value) = recorded {
            self.record_action(ScheduleRequest { action, value, outcome });
        }
        if let Some(log) = &mut self.schedule_log {
            log.push((action, outcome));
        }
        outcome
    }

    /// Notes from now on what is scheduled, for [`Self::take_scheduled`].
    pub fn log_schedules(&mut self) {
        self.schedule_log.get_or_insert_default();
    }

    /// What was scheduled since the last call, in the order of the calls; nothing unless that is noted.
    pub fn take_scheduled(&mut self) -> impl Iterator<Item = (ActionId, Scheduled)> + '_ {
        self.schedule_log.iter_mut().flat_map(|log| log.drain(..))
    }

    fn insert_action(
        &mut self,
        action: ActionId,
        extra: Nanos,
        value: Option<V>,
        now: impl Reading,
    ) -> Scheduled {
        let physical = self.marks_action(action);
        let spec = &self.program.actions[action];
        let delay = spec.min_delay.saturating_add(extra.max(0));
        if let Some(mode) = self.wiring.modes.of_action[action]
            && !self.is_active(mode)
        {
            self.modes.suspend(QueuedEvent::Action { action, value, physical }, mode, delay);
            return Scheduled::Suspended;
        }
        let mut tag = match spec.origin {
            Origin::Logical => Delay::after(delay).shift(self.tag),
            Origin::Physical => self.tag_by_clock(delay, now.read()),
        };
        if let (Some(spacing), Some(last)) = (spec.spacing, self.last_scheduled[action])
            && !spacing.allows(last, tag)
        {
            let waits = self.queue.holds(last, action);
            match spacing.policy {
                Policy::Drop => return Scheduled::Dropped,
                Policy::Replace if waits => {
                    self.displaced = self.queue.replace(last, action, (value, physical));
                    return Scheduled::At(last);
                }
                Policy::Update if waits => self.displaced = self.queue.remove(last, action),
                Policy::Update => {}
                // A spacing of zero may name the current tag or one before it.
                Policy::Replace | Policy::Defer => {
                    tag = spacing.earliest(last).max(self.tag.succ());
                }
            }
        }
        // The last possible time has no next microstep for a second event, and no program reaches it.
        let last = self.last_of(spec.reactor);
        if tag > last || tag.time == Nanos::MAX {
            return Scheduled::AfterStop;
        }
        let at = self.queue.insert_action(tag, action, value, physical);
        if at > self.timeout {
            self.queue.truncate(self.timeout);
            return Scheduled::AfterStop;
        }
        self.last_scheduled[action] = Some(at);
        Scheduled::At(at)
    }

    /// The value of the event that the latest call to [`Self::schedule`] replaced or removed, for a driver
    /// that must not drop it there.
    pub fn take_displaced(&mut self) -> Option<V> {
        self.displaced.take()
    }

    /// Changes the deadline of a reaction from now on. A reaction that declares none has no handler:
    /// its body runs at any time, and may call [`Self::misses_deadline`].
    pub fn set_deadline(&mut self, reaction: ReactionId, deadline: Nanos) {
        self.deadlines[reaction] = Some(deadline);
    }

    /// Ends the program at the next microstep. The scheduler of one federate only reports the request: see
    /// [`Self::take_stop_request`].
    pub fn request_stop(&mut self) {
        self.record_stop();
        match self.scope {
            Scope::Whole => self.set_stop(self.tag.succ()),
            Scope::Federate(_) => self.stop_requested |= self.stop > self.tag.succ(),
        }
    }

    /// `delay` after the reading of the clock, but never at or before the current tag, nor before the
    /// first one: a federate that starts late may receive messages before its first tag.
    pub(super) fn tag_by_clock(&self, delay: Nanos, now: PhysicalTime) -> Tag {
        let time = now.since(self.start).max(0).saturating_add(delay);
        Tag::new(time, 0).max(self.tag.succ()).max(self.first)
    }
}
