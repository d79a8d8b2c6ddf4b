//! The limits of this process, which the federates inherit: whether a program can run within them, and
//! what to do about an error that one of them has caused.

use std::io;

use rustix::io::Errno;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

use crate::message::Error;

/// The stack that every program has room for, in bytes; a lower limit is raised, where that is allowed.
const AMPLE_STACK: u64 = 1 << 20;
/// Below this, neither the command nor Python gets far.
const LEAST_STACK: u64 = 128 << 10;

/// The descriptors that the command needs itself, and for a federate: two pipes, a socket, memory, a
/// notifier, and descriptors that are being sent.
const FILES: u64 = 14;
const FILES_EACH: u64 = 6;
/// The same for a process whose federates are threads: modules that are being read, the pipe for signals, and
/// notifiers.
const FILES_IN_PROCESS: u64 = 18;
const FILES_OF_THREAD: u64 = 4;

/// Raises the limit of the stack if it is low.
///
/// # Errors
///
/// If it cannot be raised, and nothing would run within it.
pub(crate) fn check_stack() -> Result<(), Error> {
    let Rlimit { current, maximum } = getrlimit(Resource::Stack);
    let Some(now) = current.filter(|now| *now < AMPLE_STACK) else { return Ok(()) };
    let wanted = maximum.map_or(AMPLE_STACK, |maximum| maximum.min(AMPLE_STACK));
    let raised = setrlimit(Resource::Stack, Rlimit { current: Some(wanted), maximum });
    let now = if raised.is_ok() { wanted } else { now };
    if now >= LEAST_STACK {
        return Ok(());
    }
    let (now, least) = (now >> 10, LEAST_STACK >> 10);
    let error = format!("the stack may have only {now} KiB, and needs {least} at least");
    Err(Error::new(error).hint("raise the limit: ulimit -s 8192"))
}

/// Raises the limit of open files, if the command, or the process that has the federates as threads, needs more
/// for so many federates.
///
/// # Errors
///
/// If it cannot be raised: some federate would find the RTI closed, without a reason.
pub(crate) fn check_files(federates: usize, in_process: bool) -> Result<(), Error> {
    let (own, each) = match in_process {
        true => (FILES_IN_PROCESS, FILES_OF_THREAD),
        false => (FILES, FILES_EACH),
    };
    let needed = own + each * federates as u64;
    let Rlimit { current, maximum } = getrlimit(Resource::Nofile);
    let Some(now) = current.filter(|now| *now < needed) else { return Ok(()) };
    if maximum.is_none_or(|maximum| maximum >= needed)
        && setrlimit(Resource::Nofile, Rlimit { current: Some(needed), maximum }).is_ok()
    {
        return Ok(());
    }
    let error = format!(
        "too many open files: this process may have {now}, and needs {needed} for {federates} federates"
    );
    Err(Error::new(error).hint(format!("raise the limit: ulimit -n {}", needed.max(1024))))
}

/// The error that a process cannot be started, with what to do about it if a limit is the cause.
pub(crate) fn unstarted(what: &str, cause: &io::Error) -> Error {
    let error = Error::new(format!("{what}: {cause}"));
    match Errno::from_io_error(cause) {
        Some(Errno::MFILE) => error.hint("let a process open more files: ulimit -n 1024"),
        Some(Errno::AGAIN) => error.hint("let the user have more processes: ulimit -u"),
        Some(Errno::NOMEM) => error.hint("free memory on this machine, or raise ulimit -v"),
        _ => error,
    }
}
