//! Talking to the person at the terminal, and to programs that look after this one.

use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Sender;
use std::sync::{Mutex, PoisonError};

use hprm::console::unwritable;
use hprm::supervisor::{Observation, Signal};
use hprm::{Failure, Label, Report};
use pyo3::prelude::*;
use rustix::io::Errno;

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

/// Writes a line, or several, to what the process takes for its standard error: in a notebook, for example, that is
/// `sys.stderr` only. Errors are ignored.
pub(crate) fn say_to_caller(py: Python<'_>, text: &str) {
    match replaced_stderr(py) {
        None => say(text),
        Some(stream) => {
            // Whatever is wrong with the stream, the program has ended as it has.
            let _ = stream.call_method1("write", (format!("{text}\n"),));
            let _ = stream.call_method0("flush");
        }
    }
}

/// What the program, or what it runs in, has put in place of the standard error.
pub(crate) fn replaced_stderr(py: Python<'_>) -> Option<Bound<'_, PyAny>> {
    let sys = py.import("sys").ok()?;
    let [stream, original] = ["stderr", "__stderr__"].map(|name| sys.getattr(name).ok());
    stream.filter(|it| !it.is_none() && !original.is_some_and(|original| original.is(it)))
}

/// Tells the code that has called HPRM of a failure, unless there is nothing to tell.
pub(crate) fn tell_caller(py: Python<'_>, failure: &Failure) {
    if replaced_stderr(py).is_none() || JSON.load(Ordering::Relaxed) {
        return tell(failure);
    }
    let reports = failure.reports();
    let mut texts: Vec<_> = reports.iter().map(|it| it.text(Label::Error, false)).collect();
    texts.extend(offer(&reports));
    if !texts.is_empty() {
        say_to_caller(py, &texts.join("\n\n"));
    }
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
    if let Some(offer) = offer(&reports).filter(|_| !JSON.load(Ordering::Relaxed)) {
        say(&format!("\n{offer}"));
    }
}

/// How to read more about the codes of reports.
fn offer(reports: &[Report]) -> Option<String> {
    hprm_model::explanation::offer(reports.iter().filter_map(|it| it.diagnostic.as_deref()))
}

/// Reports to the supervisor of federates that are threads, while there is one.
static SUPERVISOR: Mutex<Option<Sender<Observation>>> = Mutex::new(None);

/// Reports to the supervisor, through `events`, that the standard output cannot be written, from now on.
pub(crate) fn report_output_to(events: Option<Sender<Observation>>) {
    *SUPERVISOR.lock().unwrap_or_else(PoisonError::into_inner) = events;
}

/// The standard output cannot be written: an error with this number. Tells of it, unless its reader has gone,
/// of which no command complains. Returns the exit code that follows.
#[pyfunction]
pub(crate) fn output_failed(number: i32) -> i32 {
    let is_closed = number == Errno::PIPE.raw_os_error();
    let error = std::io::Error::from_raw_os_error(number);
    let report = unwritable(&error).report();
    let supervisor = SUPERVISOR.lock().unwrap_or_else(PoisonError::into_inner);
    let observed = match is_closed {
        true => Observation::Signal(Signal::BROKEN_PIPE),
        false => Observation::Unwritable(Box::new(report.clone())),
    };
    let is_told = supervisor.as_ref().is_some_and(|events| events.send(observed).is_ok());
    if is_closed {
        return Signal::BROKEN_PIPE.exit_code();
    }
    if !is_told {
        show(&report);
    }
    1
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
