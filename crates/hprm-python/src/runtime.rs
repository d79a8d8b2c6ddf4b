//! The running program, as the objects that Python code holds reach it.
//!
//! While a reaction runs, the loop leaves its scheduler here, and ports and actions find it; the rest
//! of the time nothing can be read or set. The lock is never held while Python code may run: values
//! are cloned out and dropped after it is released.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, ThreadId};

use crate::host::Arguments;
use crate::value::Value;
use hprm::{Clock, Inbox};
use hprm_core::{
    ActionId, Effect, ModeId, Nanos, PhysicalTime, PortId, Program, ReactionId, Scheduler, Scope,
    Tag, Transition, Trigger,
};
use hprm_store::StoreStats;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

/// What the Python objects of a program share.
pub(crate) struct Runtime {
    program: Arc<Program>,
    scope: Scope,
    inbox: Inbox<Value>,
    /// The thread that runs reactions.
    thread: ThreadId,
    cell: Mutex<Cell>,
}

struct Cell {
    /// The loop's scheduler while a reaction runs; otherwise a placeholder.
    scheduler: Scheduler<Value>,
    running: Option<Running>,
    /// The tag of the latest reaction, and the time of the start.
    latest: Option<(Tag, PhysicalTime)>,
    stats: StoreStats,
    /// How long the federate waits for its inputs, once that was changed.
    maxwait: Option<Nanos>,
    /// Whether the loop has yet to hear of it.
    maxwait_is_news: bool,
}

/// The reaction that runs.
struct Running {
    reaction: ReactionId,
    late: Option<Late>,
    /// Whether it has asked the program to stop. Granted when it returns, because that drops
    /// events, and with them Python objects.
    stops: bool,
}

/// The deadline handler of a reaction, and its arguments.
pub(crate) struct Late {
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
    /// For the loop that runs on this thread.
    pub(crate) fn new(program: Arc<Program>, scope: Scope, inbox: Inbox<Value>) -> Self {
        let cell = Cell {
            scheduler: Scheduler::new(Arc::clone(&program), scope),
            running: None,
            latest: None,
            stats: StoreStats::default(),
            maxwait: None,
            maxwait_is_news: false,
        };
        let thread = thread::current().id();
        Self { program, scope, inbox, thread, cell: Mutex::new(cell) }
    }

    // For the host.

    /// Leaves the scheduler here while `reaction` runs.
    pub(crate) fn enter(
        &self,
        scheduler: &mut Scheduler<Value>,
        reaction: ReactionId,
        late: Option<Late>,
    ) {
        let mut cell = self.cell();
        cell.latest = Some((scheduler.tag(), scheduler.start_time()));
        std::mem::swap(scheduler, &mut cell.scheduler);
        cell.running = Some(Running { reaction, late, stops: false });
    }

    /// Takes the scheduler back.
    pub(crate) fn leave(&self, scheduler: &mut Scheduler<Value>) {
        let mut cell = self.cell();
        std::mem::swap(scheduler, &mut cell.scheduler);
        let running = cell.running.take();
        drop(cell);
        if running.is_some_and(|running| running.stops) {
            scheduler.request_stop();
        }
    }

    /// Notes what the store has done.
    pub(crate) fn note(&self, stats: StoreStats) {
        self.cell().stats = stats;
    }

    /// How long the federate is to wait for its inputs, if the loop has not heard of it yet.
    pub(crate) fn take_maxwait(&self) -> Option<Nanos> {
        let mut cell = self.cell();
        let news = std::mem::take(&mut cell.maxwait_is_news);
        cell.maxwait.filter(|_| news)
    }

    // For ports and actions.

    /// The value at a port; of a persistent one that is absent, the last.
    pub(crate) fn read(&self, reaction: ReactionId, port: PortId) -> PyResult<Option<Value>> {
        let cell = self.during(reaction, port, Access::Read)?;
        Ok(cell.scheduler.latest(port).cloned())
    }

    /// Makes a port persistent, with a first value.
    pub(crate) fn remember(
        &self,
        reaction: ReactionId,
        port: PortId,
        value: Value,
    ) -> PyResult<()> {
        let mut cell = self.during(reaction, port, Access::Remember)?;
        let earlier = cell.scheduler.keep(port, value);
        drop(cell);
        drop(earlier);
        Ok(())
    }

    /// Whether a port has a value.
    pub(crate) fn is_present(&self, reaction: ReactionId, port: PortId) -> PyResult<bool> {
        let cell = self.during(reaction, port, Access::Read)?;
        Ok(cell.scheduler.port(port).is_some())
    }

    /// The tag that the value at a port was meant for.
    pub(crate) fn intended_tag(&self, reaction: ReactionId, port: PortId) -> PyResult<Tag> {
        let cell = self.during(reaction, port, Access::Read)?;
        Ok(cell.scheduler.intended_tag(port).unwrap_or(cell.scheduler.tag()))
    }

    /// Sets a port.
    pub(crate) fn set(&self, reaction: ReactionId, port: PortId, value: Value) -> PyResult<()> {
        let mut cell = self.during(reaction, port, Access::Write)?;
        let earlier = cell.scheduler.set(port, value);
        drop(cell);
        drop(earlier);
        Ok(())
    }

    /// Whether an action is present, and its value.
    pub(crate) fn action(&self, action: ActionId) -> PyResult<Option<Option<Value>>> {
        let cell = self.cell();
        if cell.running.is_none() {
            return Err(self.outside(&self.program.actions[action].name));
        }
        Ok(cell.scheduler.action(action).map(|value| value.cloned()))
    }

    /// Schedules an action. One that is physical may be scheduled from everywhere.
    pub(crate) fn schedule(
        &self,
        action: ActionId,
        extra: Nanos,
        value: Option<Value>,
    ) -> PyResult<()> {
        // Dropped after the lock, if the scheduler refuses the event.
        let _kept = value.clone();
        if let Some(mut cell) = self.reacting() {
            cell.scheduler.schedule(action, extra, value, Clock::now);
            let displaced = cell.scheduler.take_displaced();
            drop(cell);
            drop(displaced);
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
        // Refused if the program has ended: the thread will soon notice.
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
        let name = &self.program.modes[mode].name;
        let mut cell = self.reacting().ok_or_else(|| self.outside(&format!("the mode {name}")))?;
        match cell.running.as_ref().map(|running| running.reaction) {
            Some(running) if running != owner => Err(PyRuntimeError::new_err(format!(
                "reaction {} cannot enter mode {name}, which is not an effect of it",
                self.program.reaction_name(running),
            ))),
            _ => {
                cell.scheduler.enter(mode, transition);
                Ok(())
            }
        }
    }

    // For the module `lf`.

    /// Ends the program at its next tag.
    pub(crate) fn request_stop(&self) {
        if let Some(running) = self.reacting().as_mut().and_then(|cell| cell.running.as_mut()) {
            running.stops = true;
        } else {
            self.inbox.request_stop();
        }
    }

    /// The current tag and the time of the start; outside of reactions, as of the latest.
    pub(crate) fn tag(&self) -> PyResult<(Tag, PhysicalTime)> {
        self.cell().latest.ok_or_else(|| {
            PyRuntimeError::new_err("there is no logical time before the program starts")
        })
    }

    /// Whether the running reaction has missed its deadline, and the handler for that.
    pub(crate) fn deadline_missed(&self, py: Python<'_>) -> PyResult<Option<Option<Late>>> {
        let cell = self.cell();
        let Some(Running { reaction, late, .. }) = &cell.running else {
            return Err(self.outside("a deadline"));
        };
        let missed = cell.scheduler.misses_deadline(*reaction, Clock::now());
        let late = late.as_ref().map(|late| Late {
            handler: late.handler.clone_ref(py),
            arguments: late.arguments.clone_ref(py),
        });
        Ok(missed.then_some(late))
    }

    /// Changes the deadline of the running reaction, from now on.
    pub(crate) fn set_deadline(&self, deadline: Nanos) -> PyResult<()> {
        let mut cell = self.reacting().ok_or_else(|| self.outside("a deadline"))?;
        if let Some(Running { reaction, .. }) = cell.running {
            cell.scheduler.set_deadline(reaction, deadline);
        }
        Ok(())
    }

    /// How long the federate waits for its inputs, if that was changed.
    pub(crate) fn maxwait(&self) -> Option<Nanos> {
        self.cell().maxwait
    }

    /// Changes how long the federate waits for its inputs.
    pub(crate) fn set_maxwait(&self, maxwait: Nanos) {
        let mut cell = self.cell();
        cell.maxwait = Some(maxwait);
        cell.maxwait_is_news = true;
    }

    /// What the store had done when a value was last encoded.
    pub(crate) fn stats(&self) -> StoreStats {
        self.cell().stats
    }

    /// The program.
    pub(crate) fn program(&self) -> &Arc<Program> {
        &self.program
    }

    /// The share of it that runs here.
    pub(crate) fn scope(&self) -> Scope {
        self.scope
    }

    // Inside.

    /// The cell, if this is the loop's thread and a reaction runs.
    fn reacting(&self) -> Option<MutexGuard<'_, Cell>> {
        let cell = self.cell();
        (cell.running.is_some() && thread::current().id() == self.thread).then_some(cell)
    }

    /// The cell, if a reaction runs that may use the port. `owner` is the one that was given it,
    /// which needs no search.
    fn during(
        &self,
        owner: ReactionId,
        port: PortId,
        access: Access,
    ) -> PyResult<MutexGuard<'_, Cell>> {
        let cell = self.cell();
        match &cell.running {
            Some(running) if running.reaction == owner => Ok(cell),
            Some(running) if self.declares(running.reaction, port, access) => Ok(cell),
            Some(running) => Err(self.undeclared(running.reaction, port, access)),
            None => Err(self.outside(&self.program.port_name(port))),
        }
    }

    fn declares(&self, reaction: ReactionId, port: PortId, access: Access) -> bool {
        let spec = &self.program.reactions[reaction];
        let writes = spec.effects.contains(&Effect::Port(port));
        let reads = || spec.triggers.contains(&Trigger::Port(port)) || spec.sources.contains(&port);
        match access {
            Access::Read => writes || reads(),
            // Reactions name inputs of contained reactors as effects only, so it is the reactor's.
            Access::Remember => spec.sources.contains(&port),
            Access::Write => writes,
        }
    }

    fn undeclared(&self, reaction: ReactionId, port: PortId, access: Access) -> PyErr {
        let (verb, role) = match access {
            Access::Read => ("read", "a trigger, source or effect"),
            Access::Remember => ("set", "a source"),
            Access::Write => ("set", "an effect"),
        };
        PyRuntimeError::new_err(format!(
            "reaction {} cannot {verb} port {}, which is not {role} of it",
            self.program.reaction_name(reaction),
            self.program.port_name(port)
        ))
    }

    fn outside(&self, what: &str) -> PyErr {
        PyRuntimeError::new_err(format!(
            "{what} can be used only inside a reaction, and none is running"
        ))
    }

    fn cell(&self) -> MutexGuard<'_, Cell> {
        self.cell.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
