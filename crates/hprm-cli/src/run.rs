//! `hprm run` and `hprm federate`: from a checked program to the processes that run it.
//!
//! Programs are checked before any interpreter starts, so mistakes show at once.

use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Command, ExitCode};
use std::time::Duration;

use hprm::launch::die_with_parent;
use hprm::recorder::TRACE;
use hprm::trace::TraceShare;
use hprm::{Address, Security, Stage};
use hprm_core::{FederateId, Program, means_federate};
use hprm_model::Compiled;

use crate::args::{FederateArguments, Interpreter, Properties, Run};
use crate::join::Found;
use crate::launch::{self, FEDERATION_ID, PROPERTIES, Plan};
use crate::message::{self, Error};
use crate::registry::{self, Record};
use crate::source::Program as Wanted;
use crate::{
    check, declare, executable, frames, hosts, join, outputs, python, remote, rti, secret, signals,
    threads, trace,
};

/// Runs a program to its end.
///
/// # Errors
///
/// If it cannot be started.
pub(crate) fn run(arguments: &Run) -> Result<ExitCode, Error> {
    if let Some(parent) = arguments.die_with_parent {
        let lives = die_with_parent(parent)
            .map_err(|error| Error::new(format!("cannot end with the caller: {error}")))?;
        if !lives {
            return Ok(ExitCode::FAILURE);
        }
    }
    outputs::check_of_run(arguments)?;
    if !arguments.is_for_federation() && declare::is_alone(&arguments.file)? {
        let this = std::env::current_exe();
        let this =
            this.map_err(|error| Error::new(format!("cannot find this command: {error}")))?;
        let python = python::find(&arguments.interpreter)?;
        return Err(replace(alone(&python, arguments, Some(&this))));
    }
    let compiled = match check::checked(&arguments.program())? {
        Ok(compiled) => compiled,
        Err(code) => return Ok(code),
    };
    let debugged = debugged(&compiled.program, arguments)?;
    executable::refuse_terminal(&compiled, debugged)?;
    let python = match executable::are_all(&compiled) {
        true => arguments.interpreter.python.clone().unwrap_or_default(),
        false => python::find(&arguments.interpreter)?,
    };
    remote::check_key(&arguments.at)?;
    if !compiled.program.is_federated() {
        refuse_options_of_federations(&compiled.program, arguments)?;
        return Err(replace(alone(&python, arguments, None)));
    }
    frames::begin(&arguments.frames, Some(&compiled.program))?;
    let places = remote::places(&compiled.program, &arguments.at)?;
    let trace = arguments.tracing.request(compiled.trace_file());
    if let Some(places) = &places {
        places.refuse_terminal(&compiled.program, debugged)?;
    }
    check::show(&hosts::rti(&compiled), &compiled.sources);
    // That option says where all of them run.
    if arguments.at.fleet_key.is_none() && !arguments.in_process {
        let is_asked_for =
            |name: &str| arguments.at.at.iter().any(|(text, _)| means_federate(text, name));
        let elsewhere = hosts::federates(&compiled, is_asked_for);
        if !elsewhere.is_empty() {
            check::show(&elsewhere, &compiled.sources);
            return Ok(ExitCode::FAILURE);
        }
    }
    if arguments.in_process {
        executable::refuse_threads(&compiled)?;
        return threads::run(&compiled, &python, arguments);
    }
    check::show_warnings(&compiled);
    // Dropped, and so removed, when all processes have ended.
    let stage = Stage::of(&compiled)
        .map_err(|error| Error::new(format!("cannot lay out the program's files: {error}")))?;
    let plan = Plan {
        python,
        file: arguments.file.clone(),
        arguments: arguments.arguments.all().cloned().collect(),
        properties: arguments.properties.clone(),
        // A user at the debugger takes any time.
        join_timeout: if debugged.is_some() { Duration::MAX } else { arguments.join_timeout },
        debugged,
        hang_timeout: arguments.hang.timeout(),
        logical_trace: arguments.logical_trace.clone(),
        trace,
        stage: stage.as_ref().map(|stage| stage.path().to_owned()),
        security: Security { auth: compiled.settings.auth, ..Security::default() },
        places,
    };
    let code = launch::launch(&compiled, &plan)?;
    Ok(u8::try_from(code).map_or(ExitCode::FAILURE, ExitCode::from))
}

/// The one process that runs a program without federates. It shows the warnings, and has the `launcher` run the
/// program if that turns out to have federates.
fn alone(python: &Path, arguments: &Run, launcher: Option<&Path>) -> Command {
    let mut command = python::module(python, "run");
    command.args(message::json_option());
    if let Some(path) = &arguments.logical_trace {
        command.arg("--logical-trace").arg(path);
    }
    if let Some(request) = arguments.tracing.request(None) {
        // Options for a launcher, which a program may need that turns out to have federates.
        command.arg("--trace").arg(&request.path);
        command.arg("--trace-buffer").arg(request.capacity.to_string());
        command.env(TRACE, request.variable());
    }
    match launcher {
        Some(launcher) => command.arg("--launcher").arg(launcher),
        None => command.env(python::WARNED, "1"),
    };
    command.args(arguments.properties.options());
    command.arg("--").arg(&arguments.file).args(arguments.arguments.all());
    command
}

/// Why a program has nothing of a federation.
const NOT_FEDERATED: &str = "it has no federates: its main reactor is not federated";

/// The federate that gets the terminal.
fn debugged(program: &Program, arguments: &Run) -> Result<Option<FederateId>, Error> {
    let Some(name) = &arguments.debug else { return Ok(None) };
    match program.federate_named(name) {
        Some(federate) => Ok(Some(federate)),
        None => Err(no_federate(program, &arguments.file, name)),
    }
}

fn refuse_options_of_federations(program: &Program, arguments: &Run) -> Result<(), Error> {
    if arguments.frames.are_asked_for() {
        let said = format!("{} has no frames to log", arguments.file.display());
        return Err(Error::option(said).hint(NOT_FEDERATED));
    }
    match arguments.at.at.first() {
        Some((federate, _)) => Err(no_federate(program, &arguments.file, federate)),
        None => Ok(()),
    }
}

fn no_federate(program: &Program, file: &Path, name: &str) -> Error {
    let names: Vec<_> = program.federates.values().map(|federate| federate.name.as_str()).collect();
    let error = Error::option(format!("{} has no federate {name}", file.display()));
    match names.is_empty() {
        true => error.hint(NOT_FEDERATED),
        false => error.hint(format!("its federates: {}", names.join(", "))),
    }
}

/// Runs one federate of a program, in this process.
///
/// # Errors
///
/// If it cannot be started.
pub(crate) fn federate(arguments: &FederateArguments) -> Result<ExitCode, Error> {
    outputs::check_of_federate(arguments)?;
    let mut properties = arguments.properties.clone();
    let (running, nothing) = match join::running(arguments)? {
        Found::Running(running) => (running, None),
        Found::Nothing(error) => (None, Some(error)),
    };
    inherit(&mut properties, running.as_ref());
    let mut interpreter = arguments.interpreter.clone();
    if let Some(running) = &running {
        interpreter.python.get_or_insert_with(|| running.python.clone());
    }
    let mut known = None;
    let is_made_here =
        !declare::is_python(&arguments.file) || secret::is_awaited(&arguments.secret);
    if is_made_here || nothing.is_some() {
        match has_federate(arguments, &properties, &interpreter)? {
            Ok(compiled) => known = Some(compiled),
            Err(code) => return Ok(code),
        }
    } else {
        // The one process that runs it makes its reactors, and says what is wrong.
        declare::is_readable(declare::file_of(&arguments.file))?;
    }
    let says_where = known.as_ref().is_some_and(|compiled| compiled.rti_host.is_some());
    if let Some(error) = nothing.filter(|_| !says_where) {
        return Err(error);
    }
    frames::begin(&arguments.frames, known.as_ref().map(|compiled| &*compiled.program))?;
    let rti = join::address(arguments, running.as_ref(), known.as_ref())?;
    let (secret, connect_timeout) = match running.as_ref().and_then(Record::federation) {
        Some(secret) => (secret, arguments.connect_timeout),
        None => secret::of_federate(&arguments.secret, arguments.connect_timeout)?,
    };
    let share = share(arguments, running.as_ref(), &rti)?;
    let is_declared = known.is_some() && declare::is_python(&arguments.file);
    if let Some(compiled) = known {
        let place = (&rti, secret, share.clone());
        let command = executable::replacing(&compiled, arguments, place, connect_timeout)?;
        if let Some((mut command, _kept)) = command {
            check::show_warnings(&compiled);
            // Nothing there would let Ctrl-C through again.
            return Err(not_run(&command.exec(), &command));
        }
    }
    let python = python::find(&interpreter)?;
    let mut command = python::module(&python, "federate");
    command.args(message::json_option());
    if is_declared {
        command.env(python::WARNED, "1");
    }
    command.arg("--rti").arg(rti.to_string());
    command.arg("--connect-timeout").arg(connect_timeout.as_secs_f64().to_string());
    if let Some(advertise) = &arguments.advertise {
        command.arg("--advertise").arg(advertise);
    }
    command.args(share.iter().flat_map(trace::share_options));
    if let Some(request) = arguments.tracing.request(None) {
        command.env(TRACE, request.variable());
    }
    command.args(arguments.tls.options());
    command.args(properties.options());
    command.arg("--").arg(&arguments.file).arg(&arguments.name).args(arguments.arguments.all());
    command.env(FEDERATION_ID, secret.to_string());
    Err(replace(command))
}

/// What a process writes that joins: the file that the user names, or its share of the trace that is recorded of the
/// federation here.
fn share(
    arguments: &FederateArguments,
    running: Option<&Record>,
    rti: &Address,
) -> Result<Option<TraceShare>, Error> {
    if let Some(path) = &arguments.logical_trace {
        return Ok(Some(TraceShare::new(path.clone(), None)));
    }
    // If the user says where the RTI is and what its secret is, that may be a federation on record.
    let found = if running.is_none() { registry::at(rti) } else { None };
    running.or(found.as_ref()).map_or(Ok(None), |record| record.share(&arguments.name))
}

/// Lets target properties be those of the process that has started this one, or of the federation that runs.
fn inherit(properties: &mut Properties, running: Option<&Record>) {
    if let Ok(inherited) = std::env::var(PROPERTIES) {
        properties.inherit(inherited.lines());
    } else if let Some(running) = running {
        properties.inherit(running.properties.iter().map(String::as_str));
    }
}

/// The program, if it has the federate; what the command ends with if it has mistakes, which
/// have been shown.
fn has_federate(
    arguments: &FederateArguments,
    properties: &Properties,
    interpreter: &Interpreter,
) -> Result<Result<Compiled, ExitCode>, Error> {
    let program = Wanted {
        path: &arguments.file,
        properties: properties.stated(),
        arguments: arguments.arguments.all().collect(),
        interpreter,
    };
    let compiled = match check::checked(&program)? {
        Ok(compiled) => compiled,
        Err(code) => return Ok(Err(code)),
    };
    rti::require_federation(&compiled.program, &arguments.file)?;
    match compiled.program.federate_named(&arguments.name) {
        Some(_) => Ok(Ok(compiled)),
        None => Err(no_federate(&compiled.program, &arguments.file, &arguments.name)),
    }
}

/// Becomes another program. Returns only if that fails.
pub(crate) fn replace(mut command: Command) -> Error {
    let error = signals::without_ctrl_c(|| command.exec());
    not_run(&error, &command)
}

fn not_run(error: &std::io::Error, command: &Command) -> Error {
    Error::new(format!("cannot run {}: {error}", command.get_program().display()))
}
