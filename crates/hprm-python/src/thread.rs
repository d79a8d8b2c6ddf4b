//! The threads of this process: their numbers, and to which federate each belongs, where several run in one process.
//!
//! Python asks, for what a process has once and each federate expects for itself: the module
//! `__main__`, and the name in front of a line of output. It also asks whether a thread that it has
//! not started runs bodies, for the threads that those start.

use std::cell::Cell;
use std::sync::atomic::{AtomicU64, Ordering};

use hprm_core::FederateId;
use pyo3::prelude::*;

thread_local! {
    static FEDERATE: Cell<Option<FederateId>> = const { Cell::new(None) };
    static RUNS_BODIES: Cell<bool> = const { Cell::new(false) };
    static IDENT: Cell<u64> = const { Cell::new(0) };
    static NUMBER: Cell<u64> = const { Cell::new(0) };
}

/// How many threads have a number.
static NUMBERED: AtomicU64 = AtomicU64::new(0);

/// From now on, this thread runs bodies of `federate`.
pub(crate) fn belong_to(federate: FederateId) {
    FEDERATE.set(Some(federate));
    run_bodies();
}

/// From now on, this thread runs bodies.
pub(crate) fn run_bodies() {
    RUNS_BODIES.set(true);
}

/// From now on, this thread runs no bodies.
pub(crate) fn run_no_bodies() {
    RUNS_BODIES.set(false);
}

/// A number that no other thread of the process has had. Each use of a port asks for it, and a `ThreadId` of the standard
/// library takes several times as long.
#[inline]
pub(crate) fn number() -> u64 {
    match NUMBER.get() {
        0 => take_number(),
        number => number,
    }
}

#[cold]
fn take_number() -> u64 {
    let number = NUMBERED.fetch_add(1, Ordering::Relaxed) + 1;
    NUMBER.set(number);
    number
}

/// The number of this thread, as Python counts threads; zero if Python does not say.
#[inline]
pub(crate) fn ident(py: Python<'_>) -> u64 {
    match IDENT.get() {
        0 => ask_ident(py),
        ident => ident,
    }
}

#[cold]
fn ask_ident(py: Python<'_>) -> u64 {
    let threading = py.import("threading").and_then(|it| it.call_method0("get_ident"));
    let ident = threading.and_then(|ident| ident.extract()).unwrap_or_default();
    IDENT.set(ident);
    ident
}

/// Whether this thread runs bodies: the main thread, a worker's or a federate's.
#[pyfunction]
pub(crate) fn runs_bodies() -> bool {
    RUNS_BODIES.get()
}

/// The same, for a thread that a body of the federate of that number has started.
#[pyfunction]
pub(crate) fn belong_to_federate(number: u16) {
    FEDERATE.set(Some(FederateId(number)));
}

/// The number of the federate to which this thread belongs. None of one that native code has started,
/// and where each federate has a process.
#[pyfunction]
pub(crate) fn current_federate() -> Option<u16> {
    FEDERATE.get().map(|federate| federate.0)
}
