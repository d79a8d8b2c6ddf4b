//! Talking to the person at the terminal, and to programs that look after this one.

use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};

use hprm::{Failure, Label, Report};
use pyo3::prelude::*;

/// Whether failures are told as JSON.
static JSON: AtomicBool = AtomicBool::new(false);

/// Has failures told as JSON from now on, one object a line.
#[pyfunction]
pub(crate) fn tell_programs() {
    JSON.store(true, Ordering::Relaxed);
}

/// Whether code of the program has run, so that it may have written the beginning of a line.
static PROGRAM_WRITES: AtomicBool = AtomicBool::new(false);

/// From now on the program may write, too.
pub(crate) fn program_writes() {
    PROGRAM_WRITES.store(true, Ordering::Relaxed);
}

/// Writes a line, or several, to the standard error, in one piece. Errors are ignored: it may be closed.
pub(crate) fn say(text: &str) {
    let _ = std::io::stderr().write_all(format!("{text}\n").as_bytes());
}

/// Tells of a failure, unless there is nothing to tell.
pub(crate) fn tell(failure: &Failure) {
    let reports = failure.reports();
    let last = reports.len().saturating_sub(1);
    for (index, report) in reports.iter().enumerate() {
        show(report);
        // Between mistakes of a program, as the front end does.
        if index != last && !JSON.load(Ordering::Relaxed) {
            say("");
        }
    }
}

/// Shows a report.
pub(crate) fn show(report: &Report) {
    say(&match JSON.load(Ordering::Relaxed) {
        // On a line of its own, at the cost of an empty one.
        true if PROGRAM_WRITES.load(Ordering::Relaxed) => format!("\n{}", report.json()),
        true => report.json(),
        false => report.text(Label::Error, false),
    });
}
