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
    let ran_bodies = thread::runs_bodies();
    if !ran_bodies {
        fork::begin_program();
    }
    let outcome = run();
    if !ran_bodies {
        thread::run_no_bodies();
    }
    // What fails here does so only while the interpreter itself comes to its end.
    let _ = end(py);
    outcome
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
