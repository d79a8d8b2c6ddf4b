//! Reactions that run at the same time: which those are, and the effects of each of them, kept apart until
//! all have returned.
//!
//! The driver that runs them lets each read the scheduler, which does not change meanwhile, and write its
//! own [`Effects`]. Committed in the order of the turns, these leave the scheduler in the same state as if
//! the reactions had run one after the other, however many threads there were.

use super::{Body, Scheduler};
use crate::{
    ActionId, ModeId, Nanos, Origin, PhysicalTime, PortId, ReactionId, Reading, Tag, Transition,
};
use alloc::vec::Vec;

/// A reaction whose turn it is.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub struct Turn {
    /// The reaction.
    pub reaction: ReactionId,
    /// Which of its bodies runs.
    pub body: Body,
    /// The tag that a tardy input of it was meant for, if it has no handler for that.
    pub unhandled_tardy: Option<Tag>,
}

/// The requests of a reaction, while other reactions run.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub struct Effects<V> {
    commands: Vec<Command<V>>,
}

#[derive(Clone, PartialEq, Eq, Hash, Debug)]
enum Command<V> {
    Set {
        port: PortId,
        value: V,
    },
    Schedule {
        action: ActionId,
        extra: Nanos,
        value: Option<V>,
        /// The clock at the call, if it matters.
        at: PhysicalTime,
    },
    Keep {
        port: PortId,
        value: V,
    },
    Enter(ModeId, Transition),
    SetDeadline(Nanos),
    RequestStop,
    Leave,
    MarkPhysical,
}

impl<V> Default for Effects<V> {
    fn default() -> Self {
        Self { commands: Vec::new() }
    }
}

impl<V: Clone> Effects<V> {
    /// The value at a port as the reaction sees it, which may have set it.
    pub fn port<'a>(&'a self, scheduler: &'a Scheduler<V>, port: PortId) -> Option<&'a V> {
        let root = scheduler.wiring.root(port);
        let own = self.commands.iter().rev().find_map(|command| match command {
            Command::Set { port: set, value } if scheduler.wiring.root(*set) == root => Some(value),
            _ => None,
        });
        own.or_else(|| scheduler.port(port))
    }

    /// The value at a port as the reaction sees it; while it is absent, the one that it remembers.
    pub fn latest<'a>(&'a self, scheduler: &'a Scheduler<V>, port: PortId) -> Option<&'a V> {
        let kept = self.commands.iter().rev().find_map(|command| match command {
            Command::Keep { port: kept, value } if *kept == port => Some(value),
            _ => None,
        });
        self.port(scheduler, port).or(kept).or_else(|| scheduler.latest(port))
    }

    /// Has a port remember a value; see [`Scheduler::keep`].
    pub fn keep(&mut self, port: PortId, value: V) {
        self.commands.push(Command::Keep { port, value });
    }

    /// Sets a port; see [`Scheduler::set`].
    pub fn set(&mut self, port: PortId, value: V) {
        self.commands.push(Command::Set { port, value });
    }

    /// Schedules an action; see [`Scheduler::schedule`].
    pub fn schedule(
        &mut self,
        scheduler: &Scheduler<V>,
        action: ActionId,
        extra: Nanos,
        value: Option<V>,
        now: impl Reading,
    ) {
        let at = match scheduler.program.actions[action].origin {
            Origin::Logical => scheduler.start,
            Origin::Physical => now.read(),
        };
        self.commands.push(Command::Schedule { action, extra, value, at });
    }

    /// Enters a mode; see [`Scheduler::enter`].
    pub fn enter(&mut self, mode: ModeId, transition: Transition) {
        self.commands.push(Command::Enter(mode, transition));
    }

    /// Changes the deadline of the reaction; see [`Scheduler::set_deadline`].
    pub fn set_deadline(&mut self, deadline: Nanos) {
        self.commands.push(Command::SetDeadline(deadline));
    }

    /// Whether the deadline of `reaction`, whose effects these are, has passed.
    pub fn misses_deadline(
        &self,
        scheduler: &Scheduler<V>,
        reaction: ReactionId,
        now: PhysicalTime,
    ) -> bool {
        let own = self.commands.iter().rev().find_map(|command| match command {
            Command::SetDeadline(deadline) => Some(*deadline),
            _ => None,
        });
        let deadline = own.or(scheduler.deadlines[reaction]);
        deadline.is_some_and(|deadline| scheduler.is_late(deadline, now))
    }

    /// Notes that the reaction has read from the physical world; see
    /// [`Scheduler::mark_physical`].
    pub fn mark_physical(&mut self) {
        self.commands.push(Command::MarkPhysical);
    }

    /// Ends the program; see [`Scheduler::request_stop`].
    pub fn request_stop(&mut self) {
        self.commands.push(Command::RequestStop);
    }

    /// Ends the reaction's federate; see [`Scheduler::leave`].
    pub fn leave(&mut self) {
        self.commands.push(Command::Leave);
    }
}

impl<V: Clone> Scheduler<V> {
    /// The reactions whose turn it is, in their order: those of the lowest rank that waits, which do
    /// not depend on one another. None once the tag is complete.
    ///
    /// Each is to be taken with [`Self::take_turn`] or committed with [`Self::commit`], in order.
    pub fn next_turns(&mut self, now: impl Reading + Copy, turns: &mut Vec<Turn>) {
        assert!(self.running.is_none(), "a reaction is still running");
        turns.clear();
        let Some(first) = self.ready.pop() else { return };
        let end = self.wiring.order.end_of_rank(first);
        turns.push(self.turn(first, now));
        while let Some(next) = self.ready.pop_before(end) {
            turns.push(self.turn(next, now));
        }
    }

    /// Begins a turn alone, as [`Self::next_reaction`] does.
    pub fn take_turn(&mut self, turn: &Turn) {
        assert!(self.running.is_none(), "one reaction at a time");
        self.running = Some(turn.reaction);
        self.tardy = turn.unhandled_tardy;
        self.record_start(turn.reaction, turn.body);
    }

    /// Applies the effects of a reaction, as if it ran now. Empties `effects`.
    pub fn commit(&mut self, turn: &Turn, effects: &mut Effects<V>) {
        self.take_turn(turn);
        self.apply(effects);
        self.finish(turn.reaction);
    }

    /// Applies effects of the running reaction. Empties `effects`.
    ///
    /// # Panics
    ///
    /// If no reaction is running.
    pub fn apply(&mut self, effects: &mut Effects<V>) {
        let Some(reaction) = self.running else { panic!("effects of no reaction") };
        for command in effects.commands.drain(..) {
            match command {
                Command::Set { port, value } => _ = self.set(port, value),
                Command::Schedule { action, extra, value, at } => {
                    self.schedule(action, extra, value, at);
                    self.displaced = None;
                }
                Command::Keep { port, value } => _ = self.keep(port, value),
                Command::Enter(mode, transition) => self.enter(mode, transition),
                Command::SetDeadline(deadline) => self.set_deadline(reaction, deadline),
                Command::RequestStop => self.request_stop(),
                Command::Leave => self.leave(),
                Command::MarkPhysical => self.mark_physical(),
            }
        }
    }
}
