//! Running a federation as threads of one Python process.
//!
//! That process looks after itself. This one only has to stay if there is something to do afterwards:
//! one logical trace is made of what the federates have written. It forwards signals meanwhile.

use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::Path;
use std::process::{Command, ExitCode, ExitStatus, Stdio};
use std::sync::{Arc, Mutex, PoisonError};

use hprm::recorder::{Shares, TRACE};
use hprm::supervisor::Signal;
use hprm::trace::Parts;
use hprm::{Failure, Label};
use hprm_model::Compiled;
use rustix::process::{Pid, kill_process};

use crate::args::Run;
use crate::limits;
use crate::message::{self, Error};
use crate::run::replace;
use crate::signals;
use crate::trace::share_options;

/// Has `python` run the federates of a program as its threads.
///
/// # Errors
///
/// If it cannot be started, or the trace cannot be written.
pub(crate) fn run(compiled: &Compiled, python: &Path, arguments: &Run) -> Result<ExitCode, Error> {
    let program = &compiled.program;
    limits::check_files(program.federates.len())?;
    let mut command = crate::python::module(python, "run");
    // Federates that have a process each cannot read the terminal either.
    command.arg("--in-process").args(message::json_option()).stdin(Stdio::null());
    command.env(crate::python::WARNED, "1");
    command.arg("--join-timeout").arg(arguments.join_timeout.as_secs_f64().to_string());
    command.args(arguments.properties.options());
    if let Some(limit) = arguments.hang.limit {
        command.arg("--hang-timeout").arg(limit.as_secs_f64().to_string());
    }
    let request = arguments.tracing.request(compiled.trace_file());
    if arguments.logical_trace.is_none() && request.is_none() {
        command.arg("--").arg(&arguments.file).args(arguments.arguments.all());
        return Err(replace(command));
    }
    let parts = arguments.logical_trace.as_deref().map(Parts::of).transpose()?;
    command.args(parts.iter().flat_map(|parts| share_options(&parts.shares())));
    let shares =
        request.map(|it| Ok::<_, Failure>(Shares::of(&it.path)?.with_capacity(it.capacity)));
    let shares = shares.transpose()?;
    if let Some(shares) = &shares {
        command.env(TRACE, shares.request().variable());
    }
    command.arg("--die-with-parent").arg(std::process::id().to_string());
    command.arg("--").arg(&arguments.file).args(arguments.arguments.all());
    let status = supervise(command)?;
    let ways = [Signal::HANG_UP, Signal::INTERRUPT, Signal::TERMINATE];
    let code = match status.signal() {
        None => status.code().unwrap_or(1),
        Some(signal) => {
            let signal = Signal(signal);
            if !ways.contains(&signal) {
                let said = format!("the program was killed by signal {signal}");
                Error::new(said).show();
            }
            signal.exit_code()
        }
    };
    let interrupted = ways.iter().any(|signal| signal.exit_code() == code);
    if let Some(report) = shares.map_or(Ok(None), Shares::merge)? {
        message::tell(Label::Warning, report);
    }
    if let Some(parts) = parts {
        parts.merge(program, interrupted, code, &mut message::tell)?;
    }
    Ok(u8::try_from(code).map_or(ExitCode::FAILURE, ExitCode::from))
}

/// Waits for a process, and forwards the signals that this one gets.
fn supervise(mut command: Command) -> Result<ExitStatus, Error> {
    // None as soon as its number may belong to another process.
    let child = Arc::new(Mutex::new(None::<Pid>));
    let receiver = Arc::clone(&child);
    let forward = move |signal: Signal| {
        let receiver = receiver.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(pid) = *receiver {
            let signal = match signal {
                Signal::TERMINATE => rustix::process::Signal::TERM,
                Signal::HANG_UP => rustix::process::Signal::HUP,
                _ => rustix::process::Signal::INT,
            };
            // It may be about to end.
            let _ = kill_process(pid, signal);
        }
        true
    };
    let what = format!("cannot run {}", command.get_program().display());
    let failed = |error: std::io::Error| Error::new(format!("{what}: {error}"));
    signals::watch(forward).map_err(failed)?;
    // A group of its own, so that a Ctrl-C at the terminal does not reach it twice.
    let command = command.process_group(0);
    let mut process = signals::without_ctrl_c(|| command.spawn()).map_err(failed)?;
    let set = |pid| *child.lock().unwrap_or_else(PoisonError::into_inner) = pid;
    let pid = Pid::from_child(&process);
    set(Some(pid));
    // Without reaping it, so that the number is still its own when signals are no longer forwarded.
    let ended = rustix::process::WaitIdOptions::EXITED | rustix::process::WaitIdOptions::NOWAIT;
    while rustix::process::waitid(rustix::process::WaitId::Pid(pid), ended)
        .is_err_and(|error| error == rustix::io::Errno::INTR)
    {}
    set(None);
    process.wait().map_err(failed)
}
