//! Federates that are executables, and programs that are: their processes, and what is not done with them.

use std::ffi::OsString;
use std::fs::File;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use hprm::launch::Membership;
use hprm::recorder::TRACE;
use hprm::trace::TraceShare;
use hprm::{Address, Failure, FederationId, Handover, Meeting, Security, TlsFiles};
use hprm_core::FederateId;
use hprm_declared::Declaration;
use hprm_model::{Compiled, ExecutableFederate, Purpose};

use crate::args::FederateArguments;
use crate::message::Error;

/// Whether a path names an executable, which may be a program of its own.
pub(crate) fn is_program(path: &Path) -> bool {
    let is_other = path.extension().is_some_and(|extension| extension == "lf" || extension == "py");
    let found = path.metadata();
    let is_executable =
        found.is_ok_and(|found| found.is_file() && found.permissions().mode() & 0o111 != 0);
    is_executable && !is_other
}

/// Has an executable declare the program that it is. Returns what starts it, and the declaration. To run it, it must be a
/// federation.
///
/// # Errors
///
/// Why there is none.
pub(crate) fn declared(
    path: &Path,
    arguments: &[&OsString],
    purpose: Purpose,
) -> Result<ExecutableFederate, Error> {
    let unable = |what: String| Error::new(what);
    let absolute = std::path::absolute(path)
        .map_err(|error| unable(format!("{} cannot be found: {error}", path.display())))?;
    let words = std::iter::once(absolute.as_os_str());
    let words = words.chain(arguments.iter().map(|argument| argument.as_os_str()));
    let command = words.map(|word| word.to_str().map(str::to_owned));
    let command: Option<Vec<_>> = command.collect();
    let command = command.ok_or_else(|| {
        unable(format!("{} and its arguments are not all UTF-8 text", path.display()))
    })?;
    let declaration =
        hprm::declaration_of(&command, &[]).map_err(|why| match why.split_once('\n') {
            Some((why, hint)) => unable(why.to_owned()).hint(hint),
            None => unable(why),
        })?;
    let read = Declaration::read(&declaration).ok();
    if purpose == Purpose::Run && read.as_ref().is_some_and(|it| !it.is_federation()) {
        let error = Error::option(format!("{} declares no federation", path.display()));
        return Err(error.hint(
            "a program without federates is run directly, without `hprm`; an executable that is a federate is named \
             in a program, and that is run",
        ));
    }
    if let Some(why) = read.as_ref().and_then(Declaration::refusal) {
        let what = format!("{} is a federate that {why}", path.display());
        return Err(Error::new(what).hint("name the program instead that states its value"));
    }
    Ok(ExecutableFederate { command, parameters: Vec::new(), declaration })
}

/// Lets an executable be all federates of the federation that it has declared.
pub(crate) fn of_itself(compiled: &mut Compiled, executable: &ExecutableFederate) {
    let federates = compiled.program.federates.ids();
    compiled.executables = federates.map(|id| (id, executable.clone())).collect();
}

/// Whether there are federates, and none of them needs an interpreter.
pub(crate) fn are_all(compiled: &Compiled) -> bool {
    let federates = compiled.program.federates.len();
    compiled.federated && federates > 0 && compiled.executables.len() == federates
}

/// Refuses to run an executable as a thread of another process.
///
/// # Errors
///
/// If a federate is one.
pub(crate) fn refuse_threads(compiled: &Compiled) -> Result<(), Error> {
    let Some(federate) = compiled.executables.keys().next() else { return Ok(()) };
    let name = &compiled.program.federates[*federate].name;
    let what = format!("the federate {name} is an executable, and cannot run in this process");
    Err(Error::option(what).hint("run the federation as processes, without --in-process"))
}

/// Refuses to give an executable the terminal.
///
/// # Errors
///
/// If the federate is one.
pub(crate) fn refuse_terminal(
    compiled: &Compiled,
    debugged: Option<FederateId>,
) -> Result<(), Error> {
    let Some(federate) = debugged.filter(|it| compiled.executables.contains_key(it)) else {
        return Ok(());
    };
    let name = &compiled.program.federates[federate].name;
    let what = format!("--debug: the federate {name} is an executable, which gets no terminal");
    Err(Error::option(what).hint(
        "its standard input is what the launcher hands to it; let a debugger attach to its process, or start it by \
         `hprm federate`",
    ))
}

/// The command of a federate that is launched; none if it is no executable.
///
/// # Errors
///
/// If what it is to be handed cannot be.
pub(crate) fn launched(
    compiled: &Compiled,
    membership: &Membership<'_>,
    (federation, security): (FederationId, &Security),
) -> Result<Option<Command>, Failure> {
    let Some(executable) = compiled.executables.get(&membership.federate) else {
        return Ok(None);
    };
    let meeting = Meeting { rti: membership.rti, federation, security };
    let mut handover = handover(compiled, executable, membership.name, &meeting);
    let share = membership.share.clone();
    handover.logical_trace = share.map(|share| (share.file, Some(share.trace)));
    let mut command = started(executable);
    handover.attach(&mut command).map_err(|error| {
        Failure::system(format!("cannot hand the program to {}", membership.name), &error)
    })?;
    Ok(Some(command))
}

/// The command by which this process becomes a federate, and what must live until then; none if it is no
/// executable.
///
/// # Errors
///
/// If what it is to be handed cannot be.
pub(crate) fn replacing(
    compiled: &Compiled,
    arguments: &FederateArguments,
    (rti, federation, share): (&Address, FederationId, Option<TraceShare>),
    connect_timeout: Duration,
) -> Result<Option<(Command, File)>, Error> {
    let name = arguments.name.as_str();
    let federate = compiled.program.federate_named(name);
    let Some(executable) = federate.and_then(|it| compiled.executables.get(&it)) else {
        return Ok(None);
    };
    let tls = absolute(arguments.tls.clone().files());
    let settings = &compiled.settings;
    let security = Security { auth: settings.auth, encrypt: settings.encrypt, tls };
    let meeting = Meeting { rti, federation, security: &security };
    let mut handover = handover(compiled, executable, name, &meeting);
    handover.launched = false;
    handover.connect_timeout = connect_timeout.as_secs_f64();
    handover.advertise.clone_from(&arguments.advertise);
    handover.logical_trace = share.map(|share| (share.file, Some(share.trace)));
    let mut command = started(executable);
    if let Some(request) = arguments.tracing.request(None) {
        command.env(TRACE, request.variable());
    }
    let kept = handover.attach_beside(&mut command);
    let kept =
        kept.map_err(|error| Error::new(format!("cannot hand the program to {name}: {error}")))?;
    Ok(Some((command, kept)))
}

/// The same files by paths that lead there from anywhere.
fn absolute(files: Option<TlsFiles>) -> Option<TlsFiles> {
    let absolute = |path: PathBuf| std::path::absolute(&path).unwrap_or(path);
    files.map(|TlsFiles { certificate, key, authority }| TlsFiles {
        certificate: absolute(certificate),
        key: absolute(key),
        authority: absolute(authority),
    })
}

fn handover(
    compiled: &Compiled,
    executable: &ExecutableFederate,
    name: &str,
    meeting: &Meeting<'_>,
) -> Handover {
    let mut handover = Handover::new(name, &compiled.program, &compiled.fingerprint(), meeting);
    handover.store = compiled.settings.store;
    handover.parameters.clone_from(&executable.parameters);
    handover
}

fn started(executable: &ExecutableFederate) -> Command {
    let mut words = executable.command.iter();
    let mut command = Command::new(words.next().map_or("", String::as_str));
    command.args(words);
    // What it starts is not of this program.
    command.env_remove(hprm::DESCRIPTIONS);
    command
}
