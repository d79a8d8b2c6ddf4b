//! Modes at run time: which are active, the suspended events of those that are not, and the transition from
//! one to the next, which takes effect between two tags.
//!
//! Time does not pass in a mode that is not active. The events of its timers, actions and delayed
//! connections are suspended with the time that they still have to wait. That happens in
//! [`Scheduler::end`].

use super::Scheduler;
use crate::order::Batch;
use crate::queue::QueuedEvent;
use crate::wiring::{ModeWiring, Wiring};
use crate::{
    Delay, ModeId, Nanos, Program, ReactionId, ReactorId, Table, Tag, TimerId, Transition,
};
use alloc::vec;
use alloc::vec::Vec;

/// The modes of a running program.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(super) struct Modes<V> {
    /// Which mode its reactor is in, whether or not the reactor itself is active.
    current: Table<ModeId, bool>,
    /// Current, and so are all modes around it.
    active: Table<ModeId, bool>,
    /// Modes that have ever been active.
    visited: Table<ModeId, bool>,
    /// The transitions that reactions have requested at this tag, by index of the reactor; the last one
    /// wins.
    requested: Vec<Option<(ModeId, Transition)>>,
    /// Whether there is such a request.
    changing: bool,
    suspended: Vec<Suspended<V>>,
    /// Startup and reset reactions whose modes are not active yet.
    waiting: Vec<ReactionId>,
    /// Startup and reset reactions that run at the next microstep.
    due: Vec<ReactionId>,
}

/// An event that waits for its mode.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
struct Suspended<V> {
    event: QueuedEvent<V>,
    mode: ModeId,
    /// How long it has to wait once the mode is active.
    remaining: Nanos,
}

impl<V> Modes<V> {
    /// Every reactor in its initial mode.
    pub(super) fn new(program: &Program, wiring: &Wiring) -> Self {
        let count = program.modes.len();
        let mut modes = Self {
            current: program.modes.values().map(|mode| mode.initial).collect(),
            active: Table::filled(count, false),
            visited: Table::filled(count, false),
            requested: vec![None; wiring.modes.reactors.len()],
            changing: false,
            suspended: Vec::new(),
            waiting: Vec::new(),
            due: Vec::new(),
        };
        modes.find_active(&wiring.modes);
        modes
    }

    /// Whether elements of `mode`, or of no mode, are active.
    pub(super) fn is_active(&self, mode: Option<ModeId>) -> bool {
        mode.is_none_or(|mode| self.active[mode])
    }

    /// Whether there are no modes at all: then no other check is needed.
    pub(super) fn all_active(&self) -> bool {
        self.requested.is_empty()
    }

    /// The reactions of a batch that are in active modes.
    #[inline(never)]
    pub(super) fn active_of(&self, wiring: &Wiring, mut batch: Batch) -> Batch {
        for position in batch.positions() {
            if !self.is_active(wiring.modes.of_reaction[wiring.order.reaction(position)]) {
                batch.bits &= !position.bit();
            }
        }
        batch
    }

    /// Whether elements of `mode`, or of no mode, have ever been active.
    pub(super) fn was_active(&self, mode: Option<ModeId>) -> bool {
        mode.is_none_or(|mode| self.visited[mode])
    }

    /// Whether a startup or reset reaction runs at the next microstep.
    pub(super) fn has_due(&self) -> bool {
        !self.due.is_empty()
    }

    /// Lets a reaction run as soon as its mode is active.
    pub(super) fn await_activity(&mut self, reaction: ReactionId) {
        if !self.waiting.contains(&reaction) {
            self.waiting.push(reaction);
        }
    }

    /// Removes the requests and suspended events of reactors that have left.
    pub(super) fn forget(
        &mut self,
        wiring: &ModeWiring,
        gone: impl Fn(ReactorId) -> bool,
        gone_reaction: impl Fn(ReactionId) -> bool,
        gone_event: impl Fn(&QueuedEvent<V>) -> bool,
    ) {
        for (modal, requested) in wiring.reactors.iter().zip(&mut self.requested) {
            if gone(modal.reactor) {
                *requested = None;
            }
        }
        self.suspended.retain(|suspended| !gone_event(&suspended.event));
        self.waiting.retain(|reaction| !gone_reaction(*reaction));
    }

    /// Suspends an event.
    pub(super) fn suspend(&mut self, event: QueuedEvent<V>, mode: ModeId, remaining: Nanos) {
        self.suspended.push(Suspended { event, mode, remaining });
    }

    fn find_active(&mut self, wiring: &ModeWiring) {
        for modal in &wiring.reactors {
            let reachable = self.is_active(modal.outer);
            for mode in &modal.modes {
                self.active[*mode] = reachable && self.current[*mode];
                self.visited[*mode] |= self.active[*mode];
            }
        }
    }

    /// Makes the requested modes the current ones. Returns those that are entered by a reset, and
    /// those of them in which their reactor has not been: a reset of a mode puts the reactors inside
    /// into their initial modes.
    fn enter_requested(&mut self, wiring: &ModeWiring) -> (Vec<ModeId>, Vec<ModeId>) {
        let (mut reset, mut new) = (Vec::new(), Vec::new());
        for (modal, requested) in wiring.reactors.iter().zip(&mut self.requested) {
            let mut entered = requested.take();
            if modal.outer.is_some_and(|outer| reset.contains(&outer)) {
                entered = Some((modal.initial, Transition::Reset));
            }
            let Some((mode, transition)) = entered else { continue };
            if transition == Transition::Reset {
                reset.push(mode);
                // A reactor inside of a new mode has not been in any of its modes.
                let around = modal.outer.is_some_and(|outer| new.contains(&outer));
                if around || !self.current[mode] {
                    new.push(mode);
                }
            }
            for other in &modal.modes {
                self.current[*other] = *other == mode;
            }
        }
        self.changing = false;
        self.find_active(wiring);
        (reset, new)
    }
}

impl<V: Clone> Scheduler<V> {
    /// Requests that the reactor of `mode` enters it when this tag is complete. The last request of a tag
    /// wins.
    pub fn enter(&mut self, mode: ModeId, transition: Transition) {
        self.record_mode(mode, transition);
        let reactor = self.program.modes[mode].reactor;
        let modal = self.wiring.modes.reactors.iter().position(|modal| modal.reactor == reactor);
        if let Some(index) = modal {
            self.modes.requested[index] = Some((mode, transition));
            self.modes.changing = true;
        }
    }

    /// Whether a mode is active: its reactor is in it, and all modes around it are active.
    #[must_use]
    pub fn is_active(&self, mode: ModeId) -> bool {
        self.modes.active[mode]
    }

    /// Queues the startup reactions, or keeps them until their mode is active for the first time.
    pub(super) fn queue_startup(&mut self) {
        let wiring = alloc::sync::Arc::clone(&self.wiring);
        for reaction in &wiring.startup {
            if self.modes.is_active(wiring.modes.of_reaction[*reaction]) {
                self.ready.push(wiring.order.position(*reaction));
            } else {
                self.modes.await_activity(*reaction);
            }
        }
    }

    /// Queues the shutdown reactions that `ends` selects, also those of modes that are not active, if the
    /// modes have been active.
    pub(super) fn queue_shutdown(&mut self, ends: impl Fn(ReactionId) -> bool) {
        for reaction in self.wiring.shutdown.iter().filter(|reaction| ends(**reaction)) {
            if self.modes.was_active(self.wiring.modes.of_reaction[*reaction]) {
                self.ready.push(self.wiring.order.position(*reaction));
            }
        }
    }

    /// Queues the reactions that are due because of transitions before this tag.
    #[inline]
    pub(super) fn queue_due(&mut self) {
        if self.modes.has_due() {
            self.queue_those_due();
        }
    }

    #[inline(never)]
    fn queue_those_due(&mut self) {
        for reaction in self.modes.due.drain(..) {
            self.ready.push(self.wiring.order.position(reaction));
        }
    }

    /// Inserts the first event of a timer, or suspends it until its mode is active.
    pub(super) fn start_timer(&mut self, timer: TimerId, at: Tag) {
        let event = QueuedEvent::Timer(timer);
        match self.wiring.modes.of_timer[timer] {
            Some(mode) if !self.modes.active[mode] => {
                let offset = self.program.timers[timer].offset.max(0);
                self.modes.suspend(event, mode, offset);
            }
            _ if at <= self.timeout => self.queue.insert(at, event),
            _ => {}
        }
    }

    /// Makes the transitions that reactions have requested at this tag.
    pub(super) fn change_modes(&mut self) {
        if !self.modes.changing {
            return;
        }
        let wiring = alloc::sync::Arc::clone(&self.wiring);
        let (reset, new) = self.modes.enter_requested(&wiring.modes);
        self.suspend_inactive();
        self.resume(&reset);
        self.restart_timers(&wiring.modes, &reset, &new);
        for reaction in &wiring.resets {
            if wiring.modes.of_reaction[*reaction].is_some_and(|mode| reset.contains(&mode)) {
                self.modes.await_activity(*reaction);
            }
        }
        let Modes { waiting, due, active, .. } = &mut self.modes;
        let is_due = |reaction: &mut ReactionId| {
            wiring.modes.of_reaction[*reaction].is_none_or(|mode| active[mode])
        };
        due.extend(waiting.extract_if(.., is_due));
    }

    /// Suspends the events of modes that are not active any more.
    fn suspend_inactive(&mut self) {
        let Self { queue, modes, wiring, tag, bounded, .. } = self;
        let mode_of = |event: &QueuedEvent<V>| match event {
            QueuedEvent::Timer(timer) => wiring.modes.of_timer[*timer],
            QueuedEvent::Action { action, .. } => wiring.modes.of_action[*action],
            QueuedEvent::Message { connection, .. } => wiring.modes.of_connection[*connection],
        };
        for (at, event) in queue.extract(|event| !modes.is_active(mode_of(event))) {
            if let QueuedEvent::Message { connection, .. } = &event
                && let Some(waiting) = bounded.get_mut(connection)
            {
                waiting.suspended(at);
            }
            if let Some(mode) = mode_of(&event) {
                modes.suspend(event, mode, at.time - tag.time);
            }
        }
    }

    /// Inserts suspended events into the queue whose modes are active again. Events of a mode that is reset
    /// are removed.
    fn resume(&mut self, reset: &[ModeId]) {
        let mut kept = Vec::new();
        for suspended in core::mem::take(&mut self.modes.suspended) {
            let Suspended { event, mode, remaining } = suspended;
            if reset.contains(&mode) {
                continue;
            }
            if !self.modes.active[mode] {
                kept.push(Suspended { event, mode, remaining });
                continue;
            }
            let at = Delay::after(remaining).shift(self.tag);
            let (action, connection) = match &event {
                QueuedEvent::Action { action, .. } => (Some(*action), None),
                QueuedEvent::Message { connection, .. } => (None, Some(*connection)),
                QueuedEvent::Timer(_) => (None, None),
            };
            let at = self.queue.insert_at_free_microstep(at, event);
            if let Some(action) = action {
                self.last_scheduled[action] = self.last_scheduled[action].max(Some(at));
            }
            if let Some(connection) = connection {
                self.last_assigned[connection] = self.last_assigned[connection].max(at);
                if let Some(waiting) = self.bounded.get_mut(&connection) {
                    waiting.resumed(at);
                }
            }
        }
        self.modes.suspended = kept;
        self.queue.truncate(self.timeout);
    }

    /// Starts the timers of modes that are reset again. If the reactor was in the mode already, its timers
    /// go on as they were, unless they have ended.
    fn restart_timers(&mut self, wiring: &ModeWiring, reset: &[ModeId], new: &[ModeId]) {
        for (timer, mode) in wiring.of_timer.iter() {
            let Some(mode) = mode.filter(|mode| reset.contains(mode)) else { continue };
            let spec = &self.program.timers[timer];
            let ended = || spec.period <= 0 && !self.queue.holds_timer(timer);
            if new.contains(&mode) || !self.modes.active[mode] || ended() {
                let at = Delay::after(spec.offset.max(0)).shift(self.tag);
                self.start_timer(timer, at);
            }
        }
    }
}
