//! The state of the running program that its Python objects share: ports, actions and the module `lf`.
//!
//! While a reaction runs, this state has the scheduler that the reaction reads, and the effects that it
//! asks for; outside of reactions no port can be read or set. Several reactions run at the same time if
//! the program has several workers. No thread holds the lock while Python code may run: a read clones
//! the value, and the loop drops it.

use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use hprm::recorder::Tracepoints;
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
use crate::thread;
use crate::users::{self, Access, Use, Users};
use crate::value::Value;

/// What the Python objects of a program share.
pub(crate) struct Runtime {
    program: Arc<Program>,
    scope: Scope,
    inbox: Inbox<Value>,
    /// What other threads have scheduled.
    backlog: Backlog,
    state: Mutex<State>,
    /// Set before any body runs.
    tracepoints: OnceLock<Tracepoints>,
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
    thread: u64,
    scheduler: Arc<Scheduler<Value>>,
    effects: Effects<Value>,
    /// What runs if the reaction misses its deadline.
    deadline_handler: Option<DeadlineHandler>,
    /// Its own copies of values at mutable inputs that are attributes of its reactor.
    copies: Vec<(PortId, Py<PyAny>)>,
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
        let tracepoints = OnceLock::new();
        Self { program, scope, inbox, backlog, state: Mutex::new(state), tracepoints }
    }

    /// Where bodies record tracepoints; none before the program runs.
    pub(crate) fn tracepoints(&self) -> Option<&Tracepoints> {
        self.tracepoints.get()
    }

    // For the host.

    pub(crate) fn set_tracepoints(&self, tracepoints: &Tracepoints) {
        // A runtime has one run.
        let _ = self.tracepoints.set(tracepoints.clone());
    }

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
        let (thread, scheduler) = (thread::number(), Arc::clone(scheduler));
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
            copies: Vec::new(),
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
    pub(crate) fn read(&self, users: &Users<Access>, port: PortId) -> PyResult<Option<Value>> {
        self.with_user(users, (port, Use::Read), |running, access| {
            running.latest(port, access).cloned()
        })
    }

    /// The copy that the running reaction has of the value at a port.
    pub(crate) fn copy(
        &self,
        py: Python<'_>,
        users: &Users<Access>,
        port: PortId,
    ) -> PyResult<Option<Py<PyAny>>> {
        self.with_user(users, (port, Use::Read), |running, _| {
            let copy = running.copies.iter().find(|(of, _)| *of == port);
            copy.map(|(_, copy)| copy.clone_ref(py))
        })
    }

    /// Keeps the copy that the running reaction has of the value at a port, until it returns.
    pub(crate) fn keep_copy(
        &self,
        users: &Users<Access>,
        port: PortId,
        copy: Py<PyAny>,
    ) -> PyResult<()> {
        self.with_user(users, (port, Use::Read), |running, _| running.copies.push((port, copy)))
    }

    /// Whether a port has a value.
    pub(crate) fn is_present(&self, users: &Users<Access>, port: PortId) -> PyResult<bool> {
        self.with_user(users, (port, Use::Read), |running, access| {
            running.port(port, access).is_some()
        })
    }

    /// The tag that the value at a port was meant for.
    pub(crate) fn intended_tag(&self, users: &Users<Access>, port: PortId) -> PyResult<Tag> {
        self.with_user(users, (port, Use::Read), |Running { scheduler, .. }, _| {
            scheduler.intended_tag(port).unwrap_or(scheduler.tag())
        })
    }

    /// Sets a port, or makes it persistent, with a first value.
    pub(crate) fn set(&self, users: &Users<Access>, port: PortId, value: Value) -> PyResult<()> {
        fork::refuse_in_child()?;
        let reader = self.with_user(users, (port, Use::Set), |running, access| {
            match access {
                Access::Write => running.effects.set(port, value),
                Access::Remember => running.effects.keep(port, value),
                Access::Read => return Some(running.reaction),
            }
            None
        })?;
        reader.map_or(Ok(()), |reader| {
            Err(users::undeclared_port(&self.program, reader, port, Use::Set))
        })
    }

    /// Whether an action is present, and its value. Any reaction may ask for an action that is an argument.
    pub(crate) fn action(
        &self,
        users: Option<&Users<Access>>,
        action: ActionId,
    ) -> PyResult<Option<Option<Value>>> {
        let mut state = self.state();
        // All reactions that run at the same time have the same tag, so any of them knows the action.
        let running = match users {
            None => state.running.first_mut(),
            Some(_) => state.running_here(),
        };
        match running {
            Some(Running { reaction, .. })
                if users.is_some_and(|users| users.access(*reaction).is_none()) =>
            {
                Err(users::undeclared_action(&self.program, *reaction, action, Use::Read))
            }
            Some(running) => Ok(running.scheduler.action(action).map(|value| value.cloned())),
            None => Err(self.outside_error(&self.program.actions[action].name)),
        }
    }

    /// Schedules an action. Any thread may schedule a physical action at any time; if there are `users`, a
    /// logical one only if it is an effect of the running reaction.
    pub(crate) fn schedule(
        &self,
        users: Option<&Users<Access>>,
        (action, extra): (ActionId, Nanos),
        value: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        fork::refuse_in_child()?;
        let object = value.map(Value::new);
        let spec = &self.program.actions[action];
        let is_logical = spec.origin == hprm_core::Origin::Logical;
        if let Some(Running { reaction, scheduler, effects, .. }) = self.state().running_here() {
            let may = |users: &Users<Access>| users.access(*reaction) == Some(Access::Write);
            if is_logical && !users.is_none_or(may) {
                return Err(users::undeclared_action(&self.program, *reaction, action, Use::Set));
            }
            let clock = || match self.program.properties.fast {
                // A test in virtual time; other programs have either `fast` or physical actions.
                true => scheduler.tag().due(scheduler.start_time()),
                false => Clock::now(),
            };
            effects.schedule(scheduler, action, extra, object, clock);
            return Ok(());
        }
        if is_logical {
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

    /// Whether an event of the action that is scheduled now would be dropped: physical actions go together with
    /// `fast` only in a test in virtual time, where nothing but a reaction has a time.
    pub(crate) fn is_outside_of_virtual_time(&self, action: ActionId) -> bool {
        self.program.properties.fast
            && self.program.actions[action].origin == hprm_core::Origin::Physical
            && self.running_reaction().is_none()
    }

    /// Enters a mode when the tag of the running reaction is done.
    pub(crate) fn change_mode(&self, users: &Users<Transition>, mode: ModeId) -> PyResult<()> {
        fork::refuse_in_child()?;
        let name = &self.program.modes[mode].name;
        let mut state = self.state();
        let Some(running) = state.running_here() else {
            return Err(self.outside_error(&format!("the mode {name}")));
        };
        match (users.access(running.reaction), users) {
            (Some(transition), _) => {
                running.effects.enter(mode, transition);
                Ok(())
            }
            (None, Users::Argument(..)) => Err(PyRuntimeError::new_err(format!(
                "reaction {} cannot enter mode {name}, which is not an effect of it",
                self.program.reaction_label(running.reaction),
            ))),
            (None, Users::Declared(_)) => {
                Err(users::undeclared_mode(&self.program, running.reaction, mode))
            }
        }
    }

    /// The reaction that runs on this thread.
    pub(crate) fn running_reaction(&self) -> Option<ReactionId> {
        self.state().running_here().map(|running| running.reaction)
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

    /// Calls `access` with the reaction that runs on this thread, and what it may do with `port`. It must be one
    /// of its `users`: the body of a later reaction cannot use an argument that the program has stored.
    fn with_user<R>(
        &self,
        users: &Users<Access>,
        (port, wanted): (PortId, Use),
        access: impl FnOnce(&mut Running, Access) -> R,
    ) -> PyResult<R> {
        let mut state = self.state();
        let Some(running) = state.running_here() else {
            let user = state.running.iter().map(|running| running.reaction);
            let user = user.into_iter().find(|reaction| users.access(*reaction).is_some());
            return Err(match user {
                Some(user) => self.other_thread_error(user, port),
                None => self.outside_error(&self.program.port_name(port)),
            });
        };
        match (users.access(running.reaction), users) {
            (Some(granted), _) => Ok(access(running, granted)),
            (None, Users::Argument(owner, _)) => {
                Err(self.stored_port_error(*owner, running.reaction, port))
            }
            (None, Users::Declared(_)) => {
                Err(users::undeclared_port(&self.program, running.reaction, port, wanted))
            }
        }
    }

    fn stored_port_error(&self, owner: ReactionId, running: ReactionId, port: PortId) -> PyErr {
        let [owner, running] =
            [owner, running].map(|reaction| self.program.reaction_label(reaction));
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
            self.program.reaction_label(owner),
        ))
    }

    fn outside_error(&self, what: &str) -> PyErr {
        PyRuntimeError::new_err(format!(
            "{what} can be used only inside a reaction, and none is running; a thread or a callback schedules a \
             physical action, and a reaction to that does the rest"
        ))
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    /// The reaction that runs on this thread.
    fn running_here(&mut self) -> Option<&mut Running> {
        let this = thread::number();
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
