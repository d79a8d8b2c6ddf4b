//! Modes at run time: which are active, what waits in those that are not, and the change from one
//! to the next, which takes effect between two tags.
//!
//! Time stands still in a mode that is not active. The events of its timers, actions and delayed
//! connections are put aside with the time that they still had to wait; see [`Scheduler::end`] for
//! when that happens.

use super::Scheduler;
use crate::order::Batch;
use crate::queue::Event;
use crate::wiring::{ModeWiring, Wiring};
use crate::{
    Delay, ModeId, Nanos, Program, ReactionId, ReactorId, Table, Tag, TimerId, Transition,
};

/// The modes of a running program.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(super) struct Modes<V> {
    /// Which mode its reactor is in, whether or not the reactor itself is active.
    current: Table<ModeId, bool>,
    /// Current, and so are all modes around it.
    active: Table<ModeId, bool>,
    /// Those that have ever been active.
    visited: Table<ModeId, bool>,
    /// What the reactions of this tag have asked for, by index of the reactor; the last one wins.
    requested: Vec<Option<(ModeId, Transition)>>,
    /// Whether any has.
    changing: bool,
    suspended: Vec<Suspended<V>>,
    /// Reactions to the start or to a reset, whose modes are not active yet.
    waiting: Vec<ReactionId>,
    /// Those that run at the next microstep.
    due: Vec<ReactionId>,
}

/// An event that waits for its mode.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
struct Suspended<V> {
    event: Event<V>,
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

    /// Whether what lies in `mode`, or in none, can happen.
    pub(super) fn is_active(&self, mode: Option<ModeId>) -> bool {
        mode.is_none_or(|mode| self.active[mode])
    }

    /// Whether there are no modes at all, which spares the rest of the questions.
    pub(super) fn all_active(&self) -> bool {
        self.requested.is_empty()
    }

    /// Those of some reactions that lie in active modes.
    #[inline(never)]
    pub(super) fn active_of(&self, wiring: &Wiring, mut batch: Batch) -> Batch {
        for position in batch.positions() {
            if !self.is_active(wiring.modes.of_reaction[wiring.order.reaction(position)]) {
                batch.bits &= !position.bit();
            }
        }
        batch
    }

    /// Whether what lies in `mode` has ever been active.
    pub(super) fn was_active(&self, mode: Option<ModeId>) -> bool {
        mode.is_none_or(|mode| self.visited[mode])
    }

    /// Whether the next microstep has something to do.
    pub(super) fn has_due(&self) -> bool {
        !self.due.is_empty()
    }

    /// Lets a reaction run as soon as its mode is active.
    pub(super) fn await_activity(&mut self, reaction: ReactionId) {
        if !self.waiting.contains(&reaction) {
            self.waiting.push(reaction);
        }
    }

    /// Forgets what reactors have asked for and what waits in them.
    pub(super) fn forget(
        &mut self,
        wiring: &ModeWiring,
        gone: impl Fn(ReactorId) -> bool,
        gone_reaction: impl Fn(ReactionId) -> bool,
        gone_event: impl Fn(&Event<V>) -> bool,
    ) {
        for (modal, requested) in wiring.reactors.iter().zip(&mut self.requested) {
            if gone(modal.reactor) {
                *requested = None;
            }
        }
        self.suspended.retain(|suspended| !gone_event(&suspended.event));
        self.waiting.retain(|reaction| !gone_reaction(*reaction));
    }

    /// Puts an event aside.
    pub(super) fn suspend(&mut self, event: Event<V>, mode: ModeId, remaining: Nanos) {
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
    /// those of them that their reactor has not been in: a reset of a mode sends the reactors inside
    /// to their initial modes.
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
                // One whose surroundings are new has not been in any of its modes.
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
    /// Makes the reactor of `mode` change to it when this tag is done. The last request of a tag
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

    /// Whether a mode is active: its reactor is in it, and so on outwards.
    #[must_use]
    pub fn is_active(&self, mode: ModeId) -> bool {
        self.modes.active[mode]
    }

    /// Queues the reactions to the start, or keeps them for the first activity of their mode.
    pub(super) fn queue_startup(&mut self) {
        let wiring = std::sync::Arc::clone(&self.wiring);
        for reaction in &wiring.startup {
            if self.modes.is_active(wiring.modes.of_reaction[*reaction]) {
                self.ready.push(wiring.order.position(*reaction));
            } else {
                self.modes.await_activity(*reaction);
            }
        }
    }

    /// Queues the reactions to the end, of what ends: also those of modes that are not active, if they
    /// have been.
    pub(super) fn queue_shutdown(&mut self, ends: impl Fn(ReactionId) -> bool) {
        for reaction in self.wiring.shutdown.iter().filter(|reaction| ends(**reaction)) {
            if self.modes.was_active(self.wiring.modes.of_reaction[*reaction]) {
                self.ready.push(self.wiring.order.position(*reaction));
            }
        }
    }

    /// Queues the reactions that the change of modes before this tag has called for.
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

    /// Inserts the first event of a timer, or keeps it for the activity of its mode.
    pub(super) fn start_timer(&mut self, timer: TimerId, at: Tag) {
        let event = Event::Timer(timer);
        match self.wiring.modes.of_timer[timer] {
            Some(mode) if !self.modes.active[mode] => {
                let offset = self.program.timers[timer].offset.max(0);
                self.modes.suspend(event, mode, offset);
            }
            _ if at <= self.timeout => self.queue.insert(at, event),
            _ => {}
        }
    }

    /// Changes modes as the reactions of this tag have asked.
    pub(super) fn change_modes(&mut self) {
        if !self.modes.changing {
            return;
        }
        let wiring = std::sync::Arc::clone(&self.wiring);
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

    /// Puts the events of modes aside that are not active any more.
    fn suspend_inactive(&mut self) {
        let Self { queue, modes, wiring, tag, .. } = self;
        let mode_of = |event: &Event<V>| match event {
            Event::Timer(timer) => wiring.modes.of_timer[*timer],
            Event::Action { action, .. } => wiring.modes.of_action[*action],
            Event::Message { connection, .. } => wiring.modes.of_connection[*connection],
        };
        for (at, event) in queue.extract(|event| !modes.is_active(mode_of(event))) {
            if let Some(mode) = mode_of(&event) {
                modes.suspend(event, mode, at.time - tag.time);
            }
        }
    }

    /// Puts events back into the queue whose modes are active again. Those of a mode that is reset
    /// are forgotten.
    fn resume(&mut self, reset: &[ModeId]) {
        let mut kept = Vec::new();
        for suspended in std::mem::take(&mut self.modes.suspended) {
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
                Event::Action { action, .. } => (Some(*action), None),
                Event::Message { connection, .. } => (None, Some(*connection)),
                Event::Timer(_) => (None, None),
            };
            let at = self.queue.pile(at, event);
            if let Some(action) = action {
                self.last_scheduled[action] = self.last_scheduled[action].max(Some(at));
            }
            if let Some(connection) = connection {
                self.last_assigned[connection] = self.last_assigned[connection].max(at);
            }
        }
        self.modes.suspended = kept;
        self.queue.truncate(self.timeout);
    }

    /// Starts the timers of modes over that are reset. One whose reactor has been in the mode before
    /// goes on as it was, unless it has ended.
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
