//! What a body sees of the running program, and what it can do.

use std::time::Duration;

use hprm_core::{ActionId, Effects, PhysicalTime, PortId, ReactionId, Scheduler, Tag};

use super::bodies::Site;
use super::handle::Readable;
use crate::Clock;
use crate::nanoseconds;

/// The program, as the reaction that is running sees it.
///
/// A reaction touches only what it declares; whatever else it tries is a mistake in the program
/// and panics, because the order of reactions follows from what they declare.
pub struct Context<'a, V> {
    pub(super) access: Access<'a, V>,
    pub(super) reaction: ReactionId,
    pub(super) site: &'a Site,
}

/// How a reaction reaches the scheduler.
pub(super) enum Access<'a, V> {
    /// It runs alone.
    Alone(&'a mut Scheduler<V>),
    /// It runs at the same time as other reactions.
    Shared(&'a Scheduler<V>, &'a mut Effects<V>),
}

impl<V: Clone> Context<'_, V> {
    /// The value at a port or of an action. None if it is absent, or an action without a value.
    ///
    /// # Panics
    ///
    /// If the reaction does not declare it.
    #[inline]
    pub fn get(&self, readable: impl Into<Readable>) -> Option<&V> {
        match self.readable(readable.into()) {
            Readable::Port(port) => self.port(port),
            Readable::Action(action) => self.scheduler().action(action).flatten(),
        }
    }

    /// Whether a port or an action is present at this tag.
    ///
    /// # Panics
    ///
    /// If the reaction does not declare it.
    pub fn is_present(&self, readable: impl Into<Readable>) -> bool {
        match self.readable(readable.into()) {
            Readable::Port(port) => self.port(port).is_some(),
            Readable::Action(action) => self.scheduler().action(action).is_some(),
        }
    }

    /// Sets a port at this tag. The last value that is set wins.
    ///
    /// # Panics
    ///
    /// If the port is no effect of the reaction.
    #[inline]
    pub fn set(&mut self, port: impl Into<PortId>, value: V) {
        let port = port.into();
        if !self.site.affects(Readable::Port(port)) {
            self.undeclared("set", Readable::Port(port), "sets");
        }
        match &mut self.access {
            Access::Alone(scheduler) => _ = scheduler.set(port, value),
            Access::Shared(_, effects) => effects.set(port, value),
        }
    }

    /// Schedules an action: a logical one `extra` after the current tag and its minimum delay, a
    /// physical one by the clock. `value` may be a value or `None`.
    ///
    /// # Panics
    ///
    /// If the action is no effect of the reaction.
    #[inline]
    pub fn schedule(
        &mut self,
        action: impl Into<ActionId>,
        extra: Duration,
        value: impl Into<Option<V>>,
    ) {
        let action = action.into();
        if !self.site.affects(Readable::Action(action)) {
            self.undeclared("schedule", Readable::Action(action), "schedules");
        }
        let (extra, value) = (nanoseconds(extra), value.into());
        match &mut self.access {
            Access::Alone(scheduler) => _ = scheduler.schedule(action, extra, value, Clock::now),
            Access::Shared(scheduler, effects) => {
                effects.schedule(scheduler, action, extra, value, Clock::now);
            }
        }
    }

    /// Ends the program at the next microstep.
    pub fn request_stop(&mut self) {
        match &mut self.access {
            Access::Alone(scheduler) => scheduler.request_stop(),
            Access::Shared(_, effects) => effects.request_stop(),
        }
    }

    /// The current tag.
    #[must_use]
    pub fn tag(&self) -> Tag {
        self.scheduler().tag()
    }

    /// Logical time since the start.
    #[must_use]
    pub fn elapsed(&self) -> Duration {
        Duration::from_nanos(self.tag().time.unsigned_abs())
    }

    /// Logical time since the Unix epoch.
    #[must_use]
    pub fn logical_time(&self) -> PhysicalTime {
        self.tag().due(self.scheduler().start_time())
    }

    /// How far the clock is ahead of logical time; zero if it is not.
    #[must_use]
    pub fn lag(&self) -> Duration {
        let lag = Clock::now().since(self.logical_time());
        Duration::from_nanos(u64::try_from(lag).unwrap_or(0))
    }

    /// Whether the deadline of the reaction has passed by now.
    #[must_use]
    pub fn misses_deadline(&self) -> bool {
        let (reaction, now) = (self.reaction, Clock::now());
        match &self.access {
            Access::Alone(scheduler) => scheduler.misses_deadline(reaction, now),
            Access::Shared(scheduler, effects) => effects.misses_deadline(scheduler, reaction, now),
        }
    }

    /// Changes the deadline of the reaction from now on.
    pub fn set_deadline(&mut self, deadline: Duration) {
        match &mut self.access {
            Access::Alone(scheduler) => {
                scheduler.set_deadline(self.reaction, nanoseconds(deadline));
            }
            Access::Shared(_, effects) => effects.set_deadline(nanoseconds(deadline)),
        }
    }

    #[inline]
    fn scheduler(&self) -> &Scheduler<V> {
        match &self.access {
            Access::Alone(scheduler) => scheduler,
            Access::Shared(scheduler, _) => scheduler,
        }
    }

    #[inline]
    fn port(&self, port: PortId) -> Option<&V> {
        match &self.access {
            Access::Alone(scheduler) => scheduler.port(port),
            Access::Shared(scheduler, effects) if self.site.affects(Readable::Port(port)) => {
                effects.port(scheduler, port)
            }
            Access::Shared(scheduler, _) => scheduler.port(port),
        }
    }

    #[inline]
    #[track_caller]
    fn readable(&self, readable: Readable) -> Readable {
        if !self.site.reads(readable) {
            self.undeclared("read", readable, "reads");
        }
        readable
    }

    #[cold]
    #[track_caller]
    fn undeclared(&self, verb: &str, readable: Readable, method: &str) -> ! {
        let program = self.scheduler().program();
        let reaction = program.reaction_name(self.reaction);
        let name = match readable {
            Readable::Port(port) => program.port_name(port),
            Readable::Action(action) => program.actions[action].name.clone(),
        };
        panic!(
            "reaction {reaction} cannot {verb} {name}, which it does not declare; add \
             `.{method}(...)` to the reaction"
        )
    }
}
