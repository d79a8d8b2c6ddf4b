//! The entry points: running a whole program, or one federate of it, from its file to its end.
//!
//! They return exit codes. What there is to say has been said by then.

use std::fmt::Display;
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::Command;
use std::sync::Arc;
use std::time::Duration;

use hprm::recorder::TraceRequest;
use hprm::supervisor::Signal;
use hprm::trace::{Trace, TraceShare};
use hprm::{Disk, Failure, FederateOptions, Handover, Inbox, Meeting, Reach, Security, TlsFiles};
use hprm_core::Scope;
use hprm_model::{Compiled, ExecutableFederate};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyList;

use crate::checked::Checked;
use crate::console::{say, tell, tell_caller};
use crate::embedded;
use crate::failure::{failure_in, failure_in_loading};
use crate::forced_end;
use crate::interrupt::Interrupt;
use crate::load::{Care, load};
use crate::program;
use crate::value::Value;

/// Runs a program in this process, to its end. Returns the exit code. If it is a federation, `launch` may run it
/// instead: it returns the exit code then.
///
/// Each of the `properties` is a target property, `KEY=VALUE`, that overrides the program's.
#[pyfunction]
#[pyo3(signature = (path, properties = vec![], *, logical_trace = None, launch = None))]
pub(crate) fn run_program(
    py: Python<'_>,
    path: &str,
    properties: Vec<String>,
    logical_trace: Option<PathBuf>,
    launch: Option<Bound<'_, PyAny>>,
) -> PyResult<i32> {
    let checked = Checked::load(py, path, &properties);
    if let (Ok(checked), Some(launch)) = (&checked, launch)
        && checked.compiled.federated
    {
        return launch.call0()?.extract();
    }
    Ok(exit_code(&checked.and_then(|checked| {
        checked.show_warnings(py);
        let care = Care::Own("the program".to_owned());
        let record = TraceRequest::of_this_process().or_else(|| stated_trace(&checked));
        run_whole(py, &checked, care, (logical_trace, record))
    })))
}

/// Runs the program that `declared` declares, to its end. Returns the exit code: the process goes on, and is as it
/// was. Each of the `properties` is a target property, as for [`run_program`]. Warnings are not shown:
/// [`check_declared`](crate::checked::check_declared) returns them.
///
/// Signals that ask for the end stop the program in order, if this is the main thread and the process has no
/// handlers for them. What has failed is appended to `failures`, as JSON.
#[pyfunction]
#[pyo3(signature = (declared, properties = vec![], *, logical_trace = None, trace = None, failures = None))]
pub(crate) fn run_declared(
    declared: &Bound<'_, PyAny>,
    properties: Vec<String>,
    logical_trace: Option<PathBuf>,
    trace: Option<PathBuf>,
    failures: Option<&Bound<'_, PyList>>,
) -> i32 {
    let py = declared.py();
    let outcome = Checked::of(declared, &properties).and_then(|checked| {
        let record = trace.map(TraceRequest::file).or_else(|| stated_trace(&checked));
        embedded::run(py, || run_whole(py, &checked, Care::Caller, (logical_trace, record)))
    });
    outcome.err().map_or(0, |failure| {
        tell_caller(py, &failure);
        if let Some(failures) = failures {
            // Only a lack of memory keeps it out of the list.
            let _ = failure.reports().iter().try_for_each(|report| failures.append(report.json()));
        }
        failure.exit_code()
    })
}

/// The trace that the program itself asks for.
fn stated_trace(checked: &Checked) -> Option<TraceRequest> {
    checked.compiled.trace_file().map(TraceRequest::file)
}

fn run_whole(
    py: Python<'_>,
    checked: &Checked,
    care: Care,
    (logical_trace, record): (Option<PathBuf>, Option<TraceRequest>),
) -> Result<(), Failure> {
    let Checked { compiled, declared } = checked;
    hprm::log_to_stderr(false)?;
    let inbox = inbox()?;
    let goes_on = care == Care::Caller;
    let declared = declared.as_ref().map(|declared| &declared.object);
    let mut host = load(py, (compiled, declared), Scope::Whole, &inbox, care)?;
    let program = &compiled.program;
    let trace = logical_trace.map(|path| Trace::create(&path, program)).transpose();
    let run = |trace| hprm::run_whole_traced(program, &mut host, &inbox, trace, record.as_ref());
    let outcome = trace.and_then(run);
    let interrupt = host.interrupt.clone_ref(py);
    interrupt.get().end();
    drop(host);
    if goes_on {
        Interrupt::uninstall(interrupt.bind(py));
    }
    outcome.map_err(|failure| by_signal(failure, interrupt.get()))
}

/// A failure that tells which signal it was, if it was one: Python's exception does not.
fn by_signal(failure: Failure, interrupt: &Interrupt) -> Failure {
    match failure {
        Failure::Interrupted { signal } if signal == Signal::INTERRUPT.0 => {
            Failure::Interrupted { signal: interrupt.signal() }
        }
        failure => failure,
    }
}

/// Where a federate belongs, and what its launcher has asked for.
#[derive(FromPyObject)]
pub(crate) struct Membership {
    #[pyo3(item)]
    rti: String,
    #[pyo3(item)]
    federation: String,
    /// Seconds that the RTI may take to be there.
    #[pyo3(item)]
    connect_timeout: f64,
    /// `HOST[:PORT]` by which other machines reach this one.
    #[pyo3(item)]
    advertise: Option<String>,
    /// Certificate, key and authority, if TCP connections are encrypted.
    #[pyo3(item)]
    tls: Option<(PathBuf, PathBuf, PathBuf)>,
    /// Whether the launcher shows the warnings, once for all federates, and the failures that are reported
    /// to the RTI.
    #[pyo3(item)]
    launched: bool,
    #[pyo3(item)]
    logical_trace: Option<PathBuf>,
    /// The trace of which that is a share.
    #[pyo3(item)]
    share_of: Option<PathBuf>,
    /// Target properties, `KEY=VALUE`, that override the program's.
    #[pyo3(item)]
    pub(crate) properties: Vec<String>,
}

/// Runs one federate of a program to its end. Returns the exit code.
#[pyfunction]
pub(crate) fn run_federate(
    py: Python<'_>,
    path: &str,
    federate: &str,
    membership: Membership,
) -> i32 {
    let launched = membership.launched;
    let is_beside = launched && !membership.rti.starts_with(hprm::THROUGH_AGENT);
    let mut joined = false;
    let checked = Checked::load(py, path, &membership.properties);
    let outcome = checked.and_then(|checked| {
        if !launched {
            checked.show_warnings(py);
        }
        let Checked { compiled, declared } = checked;
        hprm::log_to_stderr(false)?;
        let options = options(&compiled, federate, membership)?;
        if let Some(executable) = compiled.executables.get(&options.federate) {
            return Err(become_executable(&compiled, executable, &options));
        }
        let inbox = inbox()?;
        let scope = Scope::Federate(options.federate);
        let mut interrupt = None;
        let outcome = hprm::run_federate(&options, &inbox, || {
            joined = true;
            let care = match launched {
                true => Care::Launcher,
                false => Care::Own(format!("federate {federate}")),
            };
            let declared = declared.as_ref().map(|declared| &declared.object);
            let host = load(py, (&compiled, declared), scope, &inbox, care)?;
            interrupt = Some(host.interrupt.clone_ref(py));
            Ok(host)
        });
        let Some(interrupt) = interrupt else { return outcome };
        interrupt.get().end();
        outcome.map_err(|failure| by_signal(failure, interrupt.get()))
    });
    match outcome {
        // The RTI or this process itself reports it to the launcher.
        Err(failure) if launched && joined => failure.exit_code(),
        // The launcher has ended the RTI.
        Err(failure @ Failure::NoRti { .. }) if is_beside => failure.exit_code(),
        outcome => exit_code(&outcome),
    }
}

/// Becomes a federate that is an executable. Returns only if that fails.
fn become_executable(
    compiled: &Compiled,
    executable: &ExecutableFederate,
    options: &FederateOptions,
) -> Failure {
    let FederateOptions { rti, federation, security, reach, .. } = options;
    let meeting = Meeting { rti, federation: *federation, security };
    let name = &compiled.program.federates[options.federate].name;
    let mut handover = Handover::new(name, &compiled.program, &options.fingerprint, &meeting);
    handover.launched = options.launched;
    handover.store = compiled.settings.store;
    handover.parameters.clone_from(&executable.parameters);
    handover.connect_timeout = reach.connect_timeout.as_secs_f64();
    handover.advertise.clone_from(&reach.advertise);
    let share = options.trace.clone();
    handover.logical_trace = share.map(|share| (share.file, Some(share.trace)));
    let mut words = executable.command.iter();
    let mut command = Command::new(words.next().map_or("", String::as_str));
    command.args(words);
    let error = match handover.attach_beside(&mut command) {
        Ok(_kept) => command.exec(),
        Err(error) => error,
    };
    Failure::system(format!("cannot run {}", command.get_program().display()), &error)
}

/// Describes a program without its instances, to use some of its Python outside of a run; or `all` that
/// is in a file, which need not have a main reactor then.
///
/// # Errors
///
/// `ValueError` with what is wrong with the program.
#[pyfunction]
#[pyo3(signature = (path, *, all = false))]
pub(crate) fn describe_program<'py>(
    py: Python<'py>,
    path: &str,
    all: bool,
) -> PyResult<Bound<'py, PyAny>> {
    let mut disk = Disk::from_environment();
    let compiled = match all {
        true => hprm_lf::check(path, &mut disk),
        false => hprm_lf::compile(path, &mut disk),
    };
    let compiled = compiled.map_err(|failure| PyValueError::new_err(failure.to_string()))?;
    let instances = all && !compiled.instances.is_empty();
    program::describe(py, &compiled, instances.then_some(Scope::Whole))
}

/// What an exception means that has ended the loading of the program at `path`: the exit code that follows, and the
/// reports, as JSON.
#[pyfunction]
pub(crate) fn loading_failed(
    py: Python<'_>,
    error: Bound<'_, PyAny>,
    path: &str,
) -> (i32, Vec<String>) {
    let failure = failure_in_loading(py, PyErr::from_value(error), path);
    let reports = failure.reports().iter().map(|report| report.json()).collect();
    (failure.exit_code(), reports)
}

/// Tells of a mistake in a program that the calling script has not handled, as of one that a run finds.
#[pyfunction]
pub(crate) fn tell_mistake(error: Bound<'_, PyAny>) {
    let py = error.py();
    tell_caller(py, &failure_in(py, PyErr::from_value(error), "loading"));
}

/// Reads what the launcher hands to this process of executables. Returns the environment variable that has told it, which
/// is of no use then, and wrong for programs that this one starts.
#[pyfunction]
pub(crate) fn read_descriptions() -> &'static str {
    hprm::read_descriptions();
    hprm::DESCRIPTIONS
}

/// Has the kernel end this process when the one that started it ends. Returns whether that is
/// still alive: `parent` is its process id.
///
/// # Errors
///
/// If the kernel refuses.
#[pyfunction]
pub(crate) fn die_with_parent(parent: i32) -> PyResult<bool> {
    Ok(hprm::launch::die_with_parent(parent)?)
}

pub(crate) fn options(
    compiled: &Compiled,
    federate: &str,
    membership: Membership,
) -> Result<FederateOptions, Failure> {
    let Membership {
        rti,
        federation,
        logical_trace,
        share_of,
        connect_timeout,
        advertise,
        tls,
        launched,
        properties: _,
    } = membership;
    let program = &compiled.program;
    let Some(id) = program.federate_named(federate) else {
        let names: Vec<_> = program.federates.values().map(|f| f.name.as_str()).collect();
        let name = &program.name;
        return Err(Failure::option(if names.is_empty() {
            format!("{name} is not federated, so it has no federate {federate}")
        } else {
            format!("{name} has no federate {federate}; it has: {}", names.join(", "))
        }));
    };
    let wrong = |option, error: &dyn Display| Failure::option(format!("{option}: {error}"));
    Ok(FederateOptions {
        program: Arc::clone(program),
        fingerprint: Arc::new(compiled.fingerprint()),
        federate: id,
        rti: rti.parse().map_err(|error| wrong("--rti", &error))?,
        federation: federation.parse().map_err(|error| wrong("--federation", &error))?,
        security: Security {
            auth: compiled.settings.auth,
            encrypt: compiled.settings.encrypt,
            tls: tls.map(|(certificate, key, authority)| TlsFiles { certificate, key, authority }),
        },
        reach: Reach {
            connect_timeout: Duration::try_from_secs_f64(connect_timeout)
                .map_err(|error| wrong("--connect-timeout", &error))?,
            advertise,
            // A launcher waits as well, and says for how long.
            notice: (!launched).then_some(say as fn(&str)),
            // The handlers of signals that have come; that of Ctrl-C raises.
            interrupted: Some(|| Python::attach(|py| py.check_signals().is_err())),
        },
        store: hprm::store_limits(compiled.settings.store),
        trace: logical_trace.map(|file| TraceShare::new(file, share_of)),
        record: TraceRequest::of_this_process(),
        launched,
        end_process: (!launched).then_some(forced_end::after_failure as hprm::EndProcess),
    })
}

pub(crate) fn inbox() -> Result<Inbox<Value>, Failure> {
    Inbox::new().map_err(|error| Failure::system("no descriptor is left", &error))
}

/// What the process ends with, after a failure has been told.
pub(crate) fn exit_code(outcome: &Result<(), Failure>) -> i32 {
    outcome.as_ref().err().map_or(0, |failure| {
        tell(failure);
        failure.exit_code()
    })
}
