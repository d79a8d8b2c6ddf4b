//! Processes that a body forks: they keep their hands off the memory that others read, and what they
//! read stays as it is.
//!
//! The memory of the store is shared, so without this a write in the new process would be seen by
//! the receivers of this one. The new process gets copies of its own instead, as of any other memory.
//! What it has received is held until it ends.
//! What the program does there afterwards is not known here.

use std::os::fd::OwnedFd;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use hprm_store::Yard;
use pyo3::exceptions::PyRuntimeError;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::pipe::{PipeFlags, pipe_with};

/// The longest that a process waits until one that it has forked has its copies. That takes
/// milliseconds, and is told by the end of a pipe, so this is for what cannot be foreseen.
const PATIENCE: Timespec = Timespec { tv_sec: 10, tv_nsec: 0 };

/// Whether this is a process that a body has forked.
static FORKED: AtomicBool = AtomicBool::new(false);

/// From now on, this is a process that a body has forked.
pub(crate) fn note_child() {
    FORKED.store(true, Ordering::Relaxed);
}

/// Whether this is a process that a body has forked.
pub(crate) fn is_child() -> bool {
    FORKED.load(Ordering::Relaxed)
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

/// What Python calls when the process forks.
#[pyclass(frozen, module = "hprm._hprm")]
pub(crate) struct Forking {
    yard: Arc<Yard>,
    /// The ends of a pipe of which the new process closes the second one.
    pipe: Mutex<Option<(OwnedFd, OwnedFd)>>,
}

impl Forking {
    /// Has Python call it from now on.
    ///
    /// # Errors
    ///
    /// What Python raises.
    pub(crate) fn register(py: Python<'_>, yard: &Arc<Yard>) -> PyResult<()> {
        let this = Bound::new(py, Self { yard: Arc::clone(yard), pipe: Mutex::default() })?;
        let calls = PyDict::new(py);
        calls.set_item(intern!(py, "before"), this.getattr("_before")?)?;
        calls.set_item(intern!(py, "after_in_parent"), this.getattr("_in_parent")?)?;
        calls.set_item(intern!(py, "after_in_child"), this.getattr("_in_child")?)?;
        py.import(intern!(py, "os"))?.call_method("register_at_fork", (), Some(&calls))?;
        Ok(())
    }

    fn pipe(&self) -> MutexGuard<'_, Option<(OwnedFd, OwnedFd)>> {
        self.pipe.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[pymethods]
impl Forking {
    fn _before(&self) {
        if self.yard.before_fork() {
            // Without a descriptor nobody waits: what is being made may change for the new process.
            *self.pipe() = pipe_with(PipeFlags::CLOEXEC).ok();
        }
    }

    /// Waits until the new process has its copies, or has ended.
    fn _in_parent(&self) {
        if let Some((end, other)) = self.pipe().take() {
            drop(other);
            // Whether it was interrupted or took too long: there is nothing else to be done.
            let _ = poll(&mut [PollFd::new(&end, PollFlags::IN)], Some(&PATIENCE));
        }
        self.yard.after_fork_in_parent();
    }

    fn _in_child(&self) {
        if !self.yard.after_fork_in_child() {
            crate::console::say(
                "error: a process that a body has forked ends, because it could change what others \
                 receive: the system gives it no memory of its own; free memory on this host",
            );
            std::process::abort();
        }
        *self.pipe() = None;
    }
}
