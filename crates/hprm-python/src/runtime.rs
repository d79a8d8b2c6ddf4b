//! The state of the running program that its Python objects share: ports, actions and the module `lf`.
//!
//! While a reaction runs, this state has the scheduler that the reaction reads, and the effects that it
//! asks for; outside of reactions no port can be read or set. Several reactions run at the same time if
//! the program has several workers. No thread holds the lock while Python code may run: a read clones
//! the value, and the loop drops it.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, ThreadId};

use hprm::{Clock, Failure, Inbox};
use hprm_core::{
    ActionId, Effects, ModeId, Nanos, PhysicalTime, PortId, Program, ReactionId, Scheduler, Scope,
    Tag, Transition,
};
use hprm_store::StoreStats;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

use crate::backlog::Backlog;
use crate::bodies::Arguments;
use crate::fork;
use crate::value::Value;

/// What the Python objects of a program share.
pub(crate) struct Runtime {
    program: Arc<Program>,
    scope: Scope,
    inbox: Inbox<Value>,
    /// What other threads have scheduled.
    backlog: Backlog,
    state: Mutex<State>,
}

struct State {
    /// The reactions that run now, one for each thread.
    running: Vec<Running>,
    /// How many reactions have begun.
    begun: u64,
    /// The tag of the latest reaction, and the time of the start.
    latest: Option<(Tag, PhysicalTime)>,
    /// The tag at which the reactors of this program or federate started.
    first: Tag,
    /// Whether the program has asked this federate to stop alone, since the loop last took that request.
    leave_requested: bool,
    stats: StoreStats,
    /// How long the federate waits for its inputs, if the program has changed that.
    maxwait: Option<Nanos>,
    /// Whether the program has changed `maxwait` since the loop last took it.
    maxwait_changed: bool,
}

/// A reaction that runs.
struct Running {
    reaction: ReactionId,
    /// How many reactions had begun before this one.
    number: u64,
    /// Python's identifier of the thread that runs it.
    ident: u64,
    thread: ThreadId,
    scheduler: Arc<Scheduler<Value>>,
    effects: Effects<Value>,
    /// What runs if the reaction misses its deadline.
    deadline_handler: Option<DeadlineHandler>,
}

/// A reaction that runs at the moment of a sample.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SampledRun {
    pub(crate) reaction: ReactionId,
    /// Different for each run.
    pub(crate) number: u64,
    pub(crate) tag: Tag,
    /// Python's identifier of the thread that runs it.
    pub(crate) thread: u64,
}

/// The deadline handler of a reaction, and its arguments.
pub(crate) struct DeadlineHandler {
    pub(crate) handler: Py<PyAny>,
    pub(crate) arguments: Arguments,
}

/// What a reaction may do with a port.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Access {
    /// Read it.
    Read,
    /// Read it, and give it a first value to remember: an input of the reactor itself.
    Remember,
    /// Set it, and read what was set.
    Write,
}

impl Runtime {
    /// The state of a program of which nothing runs yet.
    pub(crate) fn new(
        program: Arc<Program>,
        scope: Scope,
        inbox: Inbox<Value>,
        backlog: Backlog,
    ) -> Self {
        let state = State {
            running: Vec::new(),
            begun: 0,
            latest: None,
            first: Tag::START,
            leave_requested: false,
            stats: StoreStats::default(),
            maxwait: None,
            maxwait_changed: false,
        };
        Self { program, scope, inbox, backlog, state: Mutex::new(state) }
    }

    // For the host.

    /// Notes that `reaction` runs on this thread from now on. `ident` is Python's identifier of the thread. The
    /// reaction reads `scheduler`, and what it asks for is added to `effects`.
    pub(crate) fn begin_reaction(
        &self,
        scheduler: &Arc<Scheduler<Value>>,
        (reaction, ident): (ReactionId, u64),
        effects: Effects<Value>,
        deadline_handler: Option<DeadlineHandler>,
    ) {
        let mut state = self.state();
        state.latest = Some((scheduler.tag(), scheduler.start_time()));
        state.first = scheduler.first_tag();
        let (thread, scheduler) = (thread::current().id(), Arc::clone(scheduler));
        let number = state.begun;
        state.begun += 1;
        state.running.push(Running {
            reaction,
            number,
            ident,
            thread,
            scheduler,
            effects,
            deadline_handler,
        });
    }

    /// Notes that the reaction has ended. Returns what it has asked for.
    pub(crate) fn end_reaction(&self, reaction: ReactionId) -> Effects<Value> {
        let mut state = self.state();
        let at = state.running.iter().position(|running| running.reaction == reaction);
        let running = at.map(|at| state.running.swap_remove(at));
        drop(state);
        running.map(|running| running.effects).unwrap_or_default()
    }

    /// The reactions that run now. Any thread may call this, without the interpreter's lock.
    pub(crate) fn sample(&self) -> Vec<SampledRun> {
        let state = self.state();
        let sampled = state.running.iter().map(|running| {
            let Running { reaction, number, ident, ref scheduler, .. } = *running;
            SampledRun { reaction, number, tag: scheduler.tag(), thread: ident }
        });
        sampled.collect()
    }

    /// Keeps the statistics of the store for the program.
    pub(crate) fn note_store_stats(&self, stats: StoreStats) {
        self.state().stats = stats;
    }

    /// The new maxwait of the federate, if the program has changed it since the last call.
    pub(crate) fn take_maxwait(&self) -> Option<Nanos> {
        let mut state = self.state();
        let has_changed = std::mem::take(&mut state.maxwait_changed);
        state.maxwait.filter(|_| has_changed)
    }

    /// Whether the program has asked this federate to stop alone, since the last call.
    pub(crate) fn take_departure(&self) -> bool {
        std::mem::take(&mut self.state().leave_requested)
    }

    // For ports and actions.

    /// The value at a port; if the port is persistent and absent, the last value.
    pub(crate) fn read(
        &self,
        (owner, access): (ReactionId, Access),
        port: PortId,
    ) -> PyResult<Option<Value>> {
        self.with_owner(owner, port, |running| running.latest(port, access).cloned())
    }

    /// Makes a port persistent, with a first value.
    pub(crate) fn remember(&self, owner: ReactionId, port: PortId, value: Value) -> PyResult<()> {
        fork::refuse_in_child()?;
        self.with_owner(owner, port, |running| running.effects.keep(port, value))
    }

    /// Whether a port has a value.
    pub(crate) fn is_present(
        &self,
        (owner, access): (ReactionId, Access),
        port: PortId,
    ) -> PyResult<bool> {
        self.with_owner(owner, port, |running| running.port(port, access).is_some())
    }

    /// The tag that the value at a port was meant for.
    pub(crate) fn intended_tag(&self, owner: ReactionId, port: PortId) -> PyResult<Tag> {
        self.with_owner(owner, port, |Running { scheduler, .. }| {
            scheduler.intended_tag(port).unwrap_or(scheduler.tag())
        })
    }

    /// Sets a port.
    pub(crate) fn set(&self, owner: ReactionId, port: PortId, value: Value) -> PyResult<()> {
        fork::refuse_in_child()?;
        self.with_owner(owner, port, |running| running.effects.set(port, value))
    }

    /// Whether an action is present, and its value.
    pub(crate) fn action(&self, action: ActionId) -> PyResult<Option<Option<Value>>> {
        // All reactions that run at the same time have the same tag, so any of them knows the action.
        match self.state().running.first() {
            Some(running) => Ok(running.scheduler.action(action).map(|value| value.cloned())),
            None => Err(self.outside_error(&self.program.actions[action].name)),
        }
    }

    /// Schedules an action. Any thread may schedule a physical action at any time.
    pub(crate) fn schedule(
        &self,
        action: ActionId,
        extra: Nanos,
        value: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        fork::refuse_in_child()?;
        let object = value.map(Value::new);
        if let Some(Running { scheduler, effects, .. }) = self.state().running_here() {
            effects.schedule(scheduler, action, extra, object, Clock::now);
            return Ok(());
        }
        let spec = &self.program.actions[action];
        if spec.origin == hprm_core::Origin::Logical {
            return Err(PyRuntimeError::new_err(format!(
                "logical action {} can be scheduled only inside a reaction; declare it as a \
                 physical action to schedule it from elsewhere",
                spec.name
            )));
        }
        let scheduled =
            |value| Ok::<_, PyErr>(Value::scheduled(value, self.backlog.admit(&spec.name, value)?));
        let value = value.map(scheduled).transpose()?;
        // The inbox refuses the action if the program has ended. The thread need not know: it ends soon too.
        let _ = self.inbox.schedule(action, extra, value);
        Ok(())
    }

    /// Enters a mode when the tag of the running reaction is done.
    pub(crate) fn change_mode(
        &self,
        owner: ReactionId,
        mode: ModeId,
        transition: Transition,
    ) -> PyResult<()> {
        fork::refuse_in_child()?;
        let name = &self.program.modes[mode].name;
        let mut state = self.state();
        match state.running_here() {
            Some(running) if running.reaction == owner => {
                running.effects.enter(mode, transition);
                Ok(())
            }
            Some(running) => Err(PyRuntimeError::new_err(format!(
                "reaction {} cannot enter mode {name}, which is not an effect of it",
                self.program.reaction_name(running.reaction),
            ))),
            None => Err(self.outside_error(&format!("the mode {name}"))),
        }
    }

    // For the module `lf`.

    /// Ends the program at its next tag.
    pub(crate) fn request_stop(&self) -> PyResult<()> {
        fork::refuse_in_child()?;
        match self.state().running_here() {
            Some(running) => running.effects.request_stop(),
            None => self.inbox.request_stop(),
        }
        Ok(())
    }

    /// Ends the program with a failure of one of its threads. Returns false if the program has already ended.
    pub(crate) fn fail(&self, failure: Failure) -> bool {
        self.inbox.fail(failure)
    }

    /// Ends this federate at its next tag; the other federates continue.
    pub(crate) fn depart(&self) -> PyResult<()> {
        fork::refuse_in_child()?;
        let mut state = self.state();
        if let Some(running) = state.running_here() {
            running.effects.leave();
        } else if matches!(self.scope(), Scope::Whole) {
            // The whole program runs in one scheduler, so a thread belongs to no federate.
            self.inbox.request_stop();
        } else {
            state.leave_requested = true;
            self.inbox.notify();
        }
        Ok(())
    }

    /// The tag at which the reactors here started, and the time of tag zero.
    pub(crate) fn first_tag(&self) -> PyResult<(Tag, PhysicalTime)> {
        let (_, start) = self.tag()?;
        Ok((self.state().first, start))
    }

    /// The current tag and the time of the start; outside of reactions, as of the latest.
    pub(crate) fn tag(&self) -> PyResult<(Tag, PhysicalTime)> {
        self.state().latest.ok_or_else(|| {
            PyRuntimeError::new_err("there is no logical time before the program starts")
        })
    }

    /// Whether the running reaction has missed its deadline, and the handler for that.
    pub(crate) fn deadline_missed(
        &self,
        py: Python<'_>,
    ) -> PyResult<Option<Option<DeadlineHandler>>> {
        let mut state = self.state();
        let Some(running) = state.running_here() else {
            return Err(self.outside_error("a deadline"));
        };
        let Running { reaction, scheduler, effects, deadline_handler, .. } = running;
        effects.mark_physical();
        let missed = effects.misses_deadline(scheduler, *reaction, Clock::now());
        let deadline_handler = deadline_handler.as_ref().map(|it| DeadlineHandler {
            handler: it.handler.clone_ref(py),
            arguments: it.arguments.clone_ref(py),
        });
        Ok(missed.then_some(deadline_handler))
    }

    /// Changes the deadline of the running reaction, from now on.
    pub(crate) fn set_deadline(&self, deadline: Nanos) -> PyResult<()> {
        fork::refuse_in_child()?;
        let mut state = self.state();
        let running = state.running_here().ok_or_else(|| self.outside_error("a deadline"))?;
        running.effects.set_deadline(deadline);
        Ok(())
    }

    /// How long the federate waits for its inputs, if that was changed.
    pub(crate) fn maxwait(&self) -> Option<Nanos> {
        self.state().maxwait
    }

    /// Changes how long the federate waits for its inputs.
    pub(crate) fn set_maxwait(&self, maxwait: Nanos) -> PyResult<()> {
        fork::refuse_in_child()?;
        let mut state = self.state();
        state.maxwait = Some(maxwait);
        state.maxwait_changed = true;
        Ok(())
    }

    /// Notes for the trace that the running reaction reads the clock.
    pub(crate) fn note_physical(&self) {
        if let Some(running) = self.state().running_here() {
            running.effects.mark_physical();
        }
    }

    /// What the store had done when a value was last encoded.
    pub(crate) fn stats(&self) -> StoreStats {
        self.state().stats
    }

    /// The program.
    pub(crate) fn program(&self) -> &Arc<Program> {
        &self.program
    }

    /// The name of the federate that runs here; none where the whole program does.
    pub(crate) fn federate_name(&self) -> Option<&str> {
        match self.scope {
            Scope::Whole => None,
            Scope::Federate(federate) => Some(&self.program.federates[federate].name),
        }
    }

    /// The part of the program that runs here.
    pub(crate) fn scope(&self) -> Scope {
        self.scope
    }

    // Inside.

    /// Calls `access` with the reaction `owner`, of which `port` is an argument. This thread must run that
    /// reaction: the body of a later reaction cannot use a port that the program has stored.
    fn with_owner<R>(
        &self,
        owner: ReactionId,
        port: PortId,
        access: impl FnOnce(&mut Running) -> R,
    ) -> PyResult<R> {
        let mut state = self.state();
        let runs = state.running.iter().any(|running| running.reaction == owner);
        match state.running_here() {
            Some(running) if running.reaction == owner => Ok(access(running)),
            Some(running) => Err(self.stored_port_error(owner, running.reaction, port)),
            None if runs => Err(self.other_thread_error(owner, port)),
            None => Err(self.outside_error(&self.program.port_name(port))),
        }
    }

    fn stored_port_error(&self, owner: ReactionId, running: ReactionId, port: PortId) -> PyErr {
        let [owner, running] =
            [owner, running].map(|reaction| self.program.reaction_name(reaction));
        PyRuntimeError::new_err(format!(
            "port {} is an argument of reaction {owner}, but reaction {running} is running; use a port that \
             is an argument of this reaction, or store the value instead of the port",
            self.program.port_name(port)
        ))
    }

    fn other_thread_error(&self, owner: ReactionId, port: PortId) -> PyErr {
        PyRuntimeError::new_err(format!(
            "port {} can be used only on the thread that runs reaction {}, and this is another thread; \
             schedule a physical action instead",
            self.program.port_name(port),
            self.program.reaction_name(owner),
        ))
    }

    fn outside_error(&self, what: &str) -> PyErr {
        PyRuntimeError::new_err(format!(
            "{what} can be used only inside a reaction, and none is running"
        ))
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    /// The reaction that runs on this thread.
    fn running_here(&mut self) -> Option<&mut Running> {
        let this = thread::current().id();
        self.running.iter_mut().find(|running| running.thread == this)
    }
}

impl Running {
    /// The value at a port to which the reaction has access.
    fn port(&self, port: PortId, access: Access) -> Option<&Value> {
        match access {
            Access::Read | Access::Remember => self.scheduler.port(port),
            Access::Write => self.effects.port(&self.scheduler, port),
        }
    }

    /// As [`Self::port`]; if the port is persistent and absent, the value that it remembers.
    fn latest(&self, port: PortId, access: Access) -> Option<&Value> {
        match access {
            Access::Read => self.scheduler.latest(port),
            Access::Remember | Access::Write => self.effects.latest(&self.scheduler, port),
        }
    }
}
