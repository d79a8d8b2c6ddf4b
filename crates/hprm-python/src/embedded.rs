//! A run inside a process that goes on afterwards, such as a notebook: what it changes for all threads of the
//! process is restored when it has ended. Signals are the business of [`interrupt`](crate::interrupt).

use std::sync::{Mutex, MutexGuard, PoisonError};

use pyo3::intern;
use pyo3::prelude::*;

use crate::fork;
use crate::thread;

/// The runs that are not over, in several threads perhaps.
struct Runs {
    count: usize,
    /// `threading.excepthook`, as it was before the first of them.
    hook: Option<Py<PyAny>>,
}

static RUNS: Mutex<Runs> = Mutex::new(Runs { count: 0, hook: None });

/// Calls `run`, and restores what it changes.
pub(crate) fn run<R>(py: Python<'_>, run: impl FnOnce() -> R) -> R {
    begin(py);
    let paused = PausedLoop::pause(py).ok().flatten();
    let ran_bodies = thread::runs_bodies();
    if !ran_bodies {
        fork::begin_program();
    }
    let outcome = run();
    if !ran_bodies {
        thread::run_no_bodies();
    }
    // What fails here does so only while the interpreter itself comes to its end.
    let _ = paused.map(|paused| paused.resume(py));
    let _ = end(py);
    outcome
}

/// The event loop of `asyncio` that runs on this thread, as in a notebook: it runs nothing until the caller returns.
/// Bodies that are coroutines need one of their own meanwhile, and a thread has one that runs at a time.
struct PausedLoop {
    running: Py<PyAny>,
    /// The task that has called, which Python 3.12 keeps for each thread.
    task: Option<Py<PyAny>>,
}

impl PausedLoop {
    /// Has Python take the thread for one without an event loop; none if it is one.
    fn pause(py: Python<'_>) -> PyResult<Option<Self>> {
        let modules = py.import(intern!(py, "sys"))?.getattr(intern!(py, "modules"))?;
        let events = modules.call_method1(intern!(py, "get"), ("asyncio.events",))?;
        if events.is_none() {
            return Ok(None);
        }
        let running = events.call_method0(intern!(py, "_get_running_loop"))?;
        if running.is_none() {
            return Ok(None);
        }
        let task = swap_task(&running, &py.None().into_bound(py))?;
        events.call_method1(intern!(py, "_set_running_loop"), (py.None(),))?;
        Ok(Some(Self { running: running.unbind(), task: task.map(Bound::unbind) }))
    }

    fn resume(self, py: Python<'_>) -> PyResult<()> {
        let events = py.import(intern!(py, "asyncio.events"))?;
        events.call_method1(intern!(py, "_set_running_loop"), (&self.running,))?;
        if let Some(task) = self.task {
            swap_task(self.running.bind(py), task.bind(py))?;
        }
        Ok(())
    }
}

/// Has `task` be the one that a loop runs. Returns the one before; none if Python keeps it for each loop.
fn swap_task<'py>(
    running: &Bound<'py, PyAny>,
    task: &Bound<'py, PyAny>,
) -> PyResult<Option<Bound<'py, PyAny>>> {
    let tasks = running.py().import(intern!(running.py(), "asyncio.tasks"))?;
    let swap = tasks.getattr_opt(intern!(running.py(), "_swap_current_task"))?;
    swap.map(|swap| swap.call1((running, task))).transpose()
}

fn begin(py: Python<'_>) {
    let hook = py.import(intern!(py, "threading")).and_then(|it| it.getattr("excepthook"));
    let hook = hook.ok().map(Bound::unbind);
    let mut runs = runs();
    runs.count += 1;
    if runs.count == 1 {
        runs.hook = hook;
    }
}

fn end(py: Python<'_>) -> PyResult<()> {
    let hook = {
        let mut runs = runs();
        runs.count -= 1;
        if runs.count > 0 {
            return Ok(());
        }
        runs.hook.take()
    };
    let failures = py.import(intern!(py, "hprm._thread_failures"))?;
    failures.getattr(intern!(py, "_programs"))?.call_method0(intern!(py, "clear"))?;
    let threading = py.import(intern!(py, "threading"))?;
    let current = threading.getattr(intern!(py, "excepthook"))?;
    // Unless the program has set one of its own.
    if current.is(failures.getattr(intern!(py, "_end_program"))?)
        && let Some(hook) = hook
    {
        threading.setattr(intern!(py, "excepthook"), hook)?;
    }
    Ok(())
}

fn runs() -> MutexGuard<'static, Runs> {
    RUNS.lock().unwrap_or_else(PoisonError::into_inner)
}
