//! All runs of a small federation: a breadth-first search through all that may happen next.
//!
//! In each state any link may deliver its oldest frame, any federate may advance as far as it may,
//! physical time may pass until the next wake-up, and each of a few happenings may happen. The machines
//! are those that ship; `state` has what surrounds them, `check` what must be true. A violation comes
//! with the shortest path to it.
//!
//! States are compared by a hash of everything in which they can differ; see `digest`. What a machine does in one
//! of its states is computed once, however many states of the federation have it; see `moves`.

mod check;
mod digest;
mod links;
mod moves;
mod state;

use std::collections::VecDeque;
use std::fmt;
use std::sync::Arc;

use hprm_core::{FederateId, Nanos, PhysicalTime, Program};
use hprm_federated::{DnetMode, Fault};

use self::check::Judge;
use self::digest::Digests;
use self::state::State;
pub use self::state::{Action, Happening};
use crate::node::Turn;

/// What the search has visited.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Explored {
    /// States, all different.
    pub states: usize,
    /// Transitions from one state to another.
    pub transitions: usize,
    /// States after which nothing happens.
    pub ends: usize,
    /// The longest of the shortest paths to a state.
    pub depth: usize,
    /// The most messages that had arrived when nothing happened any more.
    pub messages: usize,
}

/// A state that violates a rule, and the steps that lead to it.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Violation {
    /// What is wrong.
    pub what: String,
    /// The steps that lead to it.
    pub schedule: Vec<Action>,
    /// What the search had visited before it found the violation.
    pub explored: Explored,
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}, in state {}, after", self.what, self.explored.states)?;
        self.schedule.iter().try_for_each(|action| writeln!(f, "  {action:?}"))
    }
}

/// Where the search begins, and the settings of the federation.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct Setting {
    /// What may happen from outside.
    pub happenings: Vec<Happening>,
    /// From the readiness of the last federate to tag zero. If it is negative enough, everything is
    /// due at once, and federates wait only for messages.
    pub start_delay: Nanos,
    /// For how long after the launch, in nanoseconds, physical time may pass while something else may
    /// happen as well. After that it passes only if nothing else may: a federate that reports its clock
    /// again and again would otherwise do so for ever while a message is in transit.
    pub horizon: Nanos,
    /// Whether to begin with processes that have just been launched, rather than with a federation
    /// in which all federates have joined and none knows yet when it starts.
    pub from_launch: bool,
    /// How many bytes may be in transit to a receiver when a tag begins, if not as many as usual.
    pub flow_limit: Option<u64>,
    /// When the RTI sends downstream next event tags.
    pub dnet: DnetMode,
    /// Whether federates coordinate themselves by boards.
    pub boards: bool,
    /// Federates that share no memory with the others, each on a machine of its own.
    pub elsewhere: Vec<FederateId>,
}

/// Visits every state that can be reached.
///
/// # Errors
///
/// If one of them violates a rule.
pub fn explore(program: &Arc<Program>, setting: &Setting) -> Result<Explored, Violation> {
    let mut state = State::new(program, setting);
    if !setting.from_launch {
        assemble(&mut state);
    }
    let mut search = Search {
        horizon: state.now.plus(setting.horizon),
        judge: Judge::new(program),
        known: Digests::from_iter([state.digest()]),
        origins: vec![None],
        frontier: VecDeque::from([(0, 0, state)]),
        explored: Explored { states: 1, ..Explored::default() },
    };
    while let Some((origin, depth, state)) = search.frontier.pop_front() {
        search.explored.depth = depth;
        search.expand(origin, depth, &state)?;
    }
    Ok(search.explored)
}

/// Lets all federates join, in the order of their numbers.
fn assemble(state: &mut State) {
    while !state.is_about_to_start() {
        let next = state.deliveries().find(|action| !state.is_start(*action));
        let Some(Action::Deliver(from, to)) = next else {
            unreachable!("federates join if nothing hinders them");
        };
        state.deliver(from, to).expect("federates that join break no rule");
    }
}

struct Search {
    horizon: PhysicalTime,
    judge: Judge,
    known: Digests,
    /// From which state, and by what, each state was reached first.
    origins: Vec<Option<(usize, Action)>>,
    frontier: VecDeque<(usize, usize, State)>,
    explored: Explored,
}

impl Search {
    /// Takes each step that is possible in a state.
    fn expand(&mut self, origin: usize, depth: usize, state: &State) -> Result<(), Violation> {
        let mut actions: Vec<_> = state.deliveries().collect();
        let mut advanced = Vec::new();
        let mut time: Option<PhysicalTime> = None;
        let may_act = |me: &FederateId| {
            let node = &state.seats[*me].get().node;
            node.is_running() || node.wakeup().is_some()
        };
        for me in state.seats.ids().filter(may_act) {
            let mut next = state.clone();
            let turn = next.advance(me);
            let still = next.seats[me].digest() == state.seats[me].digest();
            match turn {
                Ok(Turn::Waits(until)) if still => {
                    let until = until.filter(|until| *until > state.now);
                    time = time.into_iter().chain(until).min();
                }
                turn => advanced.push((Action::Advance(me), next, turn.map(|_| ()))),
            }
        }
        match state.rti_wakeup() {
            Some(until) if until <= state.now => actions.push(Action::Wake),
            until => time = time.into_iter().chain(until).min(),
        }
        let may_go_on = !actions.is_empty() || !advanced.is_empty();
        let time = time.filter(|time| *time <= self.horizon || !may_go_on);
        actions.extend(time.map(Action::Time));
        if time.is_none() && !may_go_on {
            self.explored.ends += 1;
            self.explored.messages = self.explored.messages.max(state.messages());
            if let Some(what) = self.judge.end(state) {
                return Err(self.violation(what, origin, None));
            }
        }
        actions.extend(state.events());
        // Whether a federate can advance is known only once it has.
        for (action, next, done) in advanced {
            self.arrive((origin, depth), action, next, done)?;
        }
        for action in actions {
            self.go((origin, depth), state, action)?;
        }
        Ok(())
    }

    /// Takes one step from a state.
    fn go(&mut self, from: (usize, usize), state: &State, action: Action) -> Result<(), Violation> {
        let mut next = state.clone();
        let done = match action {
            Action::Deliver(from, to) => next.deliver(from, to),
            Action::Advance(me) => next.advance(me).map(|_| ()),
            Action::Time(time) => {
                next.now = time;
                Ok(())
            }
            Action::Wake => next.wake_rti(),
            Action::Happens(happening) => next.happen(happening),
        };
        self.arrive(from, action, next, done)
    }

    /// A step has led to this state.
    fn arrive(
        &mut self,
        (origin, depth): (usize, usize),
        action: Action,
        next: State,
        done: Result<(), Fault>,
    ) -> Result<(), Violation> {
        self.explored.transitions += 1;
        let wrong = done.err().map(|fault| fault.to_string());
        if let Some(what) = wrong.or_else(|| self.judge.state(&next)) {
            return Err(self.violation(what, origin, Some(action)));
        }
        if self.known.insert(next.digest()) {
            self.explored.states += 1;
            self.origins.push(Some((origin, action)));
            self.frontier.push_back((self.origins.len() - 1, depth + 1, next));
        }
        Ok(())
    }

    fn violation(&self, what: String, origin: usize, action: Option<Action>) -> Violation {
        let mut schedule: Vec<_> = action.into_iter().collect();
        let mut at = origin;
        while let Some((before, action)) = self.origins[at] {
            schedule.push(action);
            at = before;
        }
        schedule.reverse();
        Violation { what, schedule, explored: self.explored }
    }
}
