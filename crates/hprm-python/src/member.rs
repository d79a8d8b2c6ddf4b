//! Federations that a process of Python makes itself: an RTI in a thread of it, and federates that run in a thread
//! beside the script that they belong to.
//!
//! Which processes there are, and what becomes of their signals and their output, is up to that Python.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use hprm::supervisor::Verdict;
use hprm::trace::Parts;
use hprm::{
    Address, Failure, HangTimeout, Kind, Label, Report, RtiEvent, RtiHandle, RtiOptions, Security,
};
use hprm_core::{Nanos, Program, Scope};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::PyList;

use crate::checked::Checked;
use crate::console::show;
use crate::embedded;
use crate::load::{Care, load};
use crate::run::{Membership, inbox, options};

/// How long federates may take to join: one that has ended before never does.
const JOINING: Duration = Duration::from_secs(60);

/// Runs one federate of the program that `declared` declares in this thread, to its end. Returns the exit code.
///
/// The process goes on, and is as it was; no signal ends the federate. What has failed is appended to `failures`, as
/// JSON.
#[pyfunction]
pub(crate) fn run_member(
    declared: &Bound<'_, PyAny>,
    federate: &str,
    membership: Membership,
    failures: &Bound<'_, PyList>,
) -> i32 {
    let py = declared.py();
    let checked = Checked::of(declared, &membership.properties);
    let outcome = checked.and_then(|Checked { compiled, declared }| {
        hprm::log_to_stderr(false)?;
        let options = options(&compiled, federate, membership)?;
        let inbox = inbox()?;
        let declared = declared.as_ref().map(|declared| &declared.object);
        let scope = Scope::Federate(options.federate);
        embedded::run(py, || {
            hprm::run_federate(&options, &inbox, || {
                load(py, (&compiled, declared), scope, &inbox, Care::Caller)
            })
        })
    });
    outcome.err().map_or(0, |failure| {
        // Only a lack of memory keeps it out of the list.
        let _ = failure.reports().iter().try_for_each(|report| failures.append(report.json()));
        failure.exit_code()
    })
}

/// An RTI, in a thread of this process.
#[pyclass(frozen, module = "hprm._hprm")]
pub(crate) struct LocalRti {
    handle: RtiHandle,
    /// Where federates reach it.
    #[pyo3(get)]
    address: String,
    /// The secret that they have to know.
    #[pyo3(get)]
    federation: String,
    ended: Mutex<Receiver<i32>>,
    program: Arc<Program>,
    /// The shares of the logical trace, until it is made.
    parts: Mutex<Option<Parts>>,
    /// How often each federate has asked for the place of its share.
    starts: Mutex<BTreeMap<String, u32>>,
}

/// Starts an RTI for the federation that `declared` declares, which listens at an address. There will be a logical trace
/// if there is a path for it.
///
/// `tell` is called, in the RTI's thread, with what becomes of a federate: what kind of event that is, the name of the
/// federate, a text for people, and for how many seconds it has been silent.
///
/// # Errors
///
/// `RuntimeError` with what is wrong with the program, the address, or the place for the trace.
#[pyfunction]
#[pyo3(signature = (declared, address, properties, tell, *, logical_trace = None))]
pub(crate) fn start_rti(
    declared: &Bound<'_, PyAny>,
    address: &str,
    properties: Vec<String>,
    tell: Py<PyAny>,
    logical_trace: Option<PathBuf>,
) -> PyResult<LocalRti> {
    start(declared, address, &properties, tell, logical_trace.as_deref()).map_err(to_python)
}

fn to_python(failure: Failure) -> PyErr {
    PyRuntimeError::new_err(failure.report().text(Label::Error, false))
}

fn start(
    declared: &Bound<'_, PyAny>,
    address: &str,
    properties: &[String],
    listener: Py<PyAny>,
    logical_trace: Option<&Path>,
) -> Result<LocalRti, Failure> {
    let parts = Mutex::new(logical_trace.map(Parts::of).transpose()?);
    let Checked { compiled, .. } = Checked::of(declared, properties)?;
    let federation = hprm::random_federation()?;
    let listen = address.parse::<Address>().map_err(|error| Failure::option(error.to_string()))?;
    let options = RtiOptions {
        program: Arc::clone(&compiled.program),
        fingerprint: Arc::new(compiled.fingerprint()),
        federation,
        listen,
        also_listen: Vec::new(),
        security: Security::default(),
        hang_timeout: HangTimeout { limit: None },
    };
    let rti = hprm::Rti::bind(&options)?.join_timeout(JOINING);
    let (handle, address) = (rti.handle(), rti.address().to_string());
    let (sender, ended) = channel();
    let (program, told) = (Arc::clone(&options.program), options.program);
    let run = move || {
        let outcome = rti.run(|event| tell(&listener, &told, event));
        // The process may have forgotten it.
        let _ = sender.send(outcome.err().map_or(0, |failure| failure.exit_code()));
    };
    let spawned = thread::Builder::new().name("rti".to_owned()).spawn(run);
    spawned.map_err(|error| Failure::system("cannot start a thread", &error))?;
    let federation = federation.to_string();
    let (ended, starts) = (Mutex::new(ended), Mutex::default());
    Ok(LocalRti { handle, address, federation, ended, program, parts, starts })
}

/// Tells Python what has become of a federate, unless that is what is to be expected.
fn tell(listener: &Py<PyAny>, program: &Program, event: RtiEvent) {
    let named = |federate| program.federates[federate].name.as_str();
    let seconds = |silence: &Nanos| *silence as f64 / 1e9;
    let (kind, name, text, silent_for) = match &event {
        RtiEvent::Withdrawn { federate, report: Some(report) }
        | RtiEvent::Dropped { federate, report }
        | RtiEvent::Failed { federate, report } => {
            let kind = if report.kind == Kind::Lost { "lost" } else { "failed" };
            let verdict = Verdict::on_federate(named(*federate), None, Some(report), None);
            (kind, named(*federate), verdict.report.text(Label::Error, false), 0.0)
        }
        RtiEvent::Silent { federate, silence } => {
            ("silent", named(*federate), String::new(), seconds(silence))
        }
        RtiEvent::Answers { federate, silence } => {
            ("answers", named(*federate), String::new(), seconds(silence))
        }
        RtiEvent::Refused { name, reason } => ("refused", name.as_str(), reason.to_string(), 0.0),
        RtiEvent::Joined { .. }
        | RtiEvent::Withdrawn { report: None, .. }
        | RtiEvent::Left(_)
        | RtiEvent::Loaded(_)
        | RtiEvent::Entered(_)
        | RtiEvent::Started(_)
        | RtiEvent::Closing => return,
    };
    Python::attach(|py| {
        if let Err(error) = listener.call1(py, (kind, name, text, silent_for)) {
            error.write_unraisable(py, None);
        }
    });
}

#[pymethods]
impl LocalRti {
    /// Asks the federation to stop in order.
    fn request_stop(&self) {
        self.handle.request_stop();
    }

    /// Where the next process of a federate writes its share of the logical trace, and what the user calls that; None if
    /// there is none.
    fn share(&self, federate: &str) -> Option<(PathBuf, PathBuf)> {
        let parts = self.parts.lock().unwrap_or_else(PoisonError::into_inner);
        let parts = parts.as_ref()?;
        let mut starts = self.starts.lock().unwrap_or_else(PoisonError::into_inner);
        let restarts = starts.entry(federate.to_owned()).and_modify(|it| *it += 1).or_default();
        let share = parts.share(federate, *restarts);
        Some((share.file, share.trace))
    }

    /// Makes the logical trace, if there is to be one, when all federates have ended; the first of them that has failed
    /// with an exit `code`. If they have been `interrupted`, they need not all have come equally far.
    ///
    /// # Errors
    ///
    /// `RuntimeError` if it cannot be made, although nothing else has failed.
    fn merge_shares(&self, interrupted: bool, code: i32) -> PyResult<()> {
        let parts = self.parts.lock().unwrap_or_else(PoisonError::into_inner).take();
        let warn = &mut |_, report: Report| show(&report);
        let merged = parts.map(|parts| parts.merge(&self.program, interrupted, code, warn));
        merged.unwrap_or(Ok(())).map_err(to_python)
    }

    /// Closes all links at once.
    fn abort(&self) {
        self.handle.abort();
    }

    /// Waits until the federation has ended. Returns its exit code.
    fn wait(&self, py: Python<'_>) -> i32 {
        py.detach(|| {
            let ended = self.ended.lock().unwrap_or_else(PoisonError::into_inner);
            // The thread has panicked, if it has told nothing.
            ended.recv().unwrap_or(1)
        })
    }
}
