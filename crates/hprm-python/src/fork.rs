//! Processes that a body forks: no part of the program, and end when they come back from the body. One that was
//! forked elsewhere may run programs of its own.
//!
//! What such a process gets of the store's memory is decided there (`hprm_store`). What the program does
//! in it afterwards is not known here.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use hprm::{Kind, Report};
use hprm_store::StoreAllocator;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

use crate::stalls;

/// What of itself a forked process calls.
const WHAT: &str = "a process that a body has forked";

/// The forked process that runs a program of its own, by its id; or zero.
static RUNS_ITS_OWN: AtomicU32 = AtomicU32::new(0);

/// Whether this is a process that a body has forked.
pub(crate) fn is_child() -> bool {
    hprm_store::is_forked() && RUNS_ITS_OWN.load(Ordering::Relaxed) != std::process::id()
}

/// Notes that this thread, which runs no bodies, begins to run a program. If the process was forked, then not by a body
/// that must not come back.
pub(crate) fn begin_program() {
    if is_child() {
        RUNS_ITS_OWN.store(std::process::id(), Ordering::Relaxed);
        stalls::start_again();
    }
}

/// Has processes that are forked from now on get copies of what is in the store.
///
/// # Errors
///
/// If the system does not tell of forks.
pub(crate) fn watch(allocator: &Arc<StoreAllocator>) -> std::io::Result<()> {
    allocator.watch_forks(|| {
        let message = format!(
            "{WHAT} ends, because it could change what others receive: the system gives it no \
             memory of its own"
        );
        crate::console::show(&Report::new(Kind::Memory, message).hint("free memory on this host"));
    })
}

/// Refuses what would have an effect on the program, which such a process is no part of.
///
/// # Errors
///
/// `RuntimeError`, if this is one.
pub(crate) fn refuse_in_child() -> PyResult<()> {
    if !is_child() {
        return Ok(());
    }
    Err(PyRuntimeError::new_err(
        "this needs the runtime of the program, and the process was forked by a body: ports, actions \
         and the stop are set where reactions run, so send the result there, through a queue",
    ))
}

/// If this is a process that a body has forked, and that has come back from the program's code with
/// this outcome: ends it, as Python ends a process. Only the first process is part of the program, and speaks
/// to the other federates.
///
/// # Errors
///
/// The outcome, or what went wrong.
pub(crate) fn leave_if_child<T>(py: Python<'_>, outcome: PyResult<T>) -> PyResult<T> {
    if !is_child() {
        return outcome;
    }
    let raised = outcome.err().map(|error| error.into_value(py));
    py.import("hprm._ending")?.call_method1("leave_child", (raised,))?;
    // That does not return, unless the package is broken.
    Err(PyRuntimeError::new_err(format!("{WHAT} does not end")))
}
