//! The limits of this process, which the federates inherit: whether a federation can run within them, and
//! what to do about an error that one of them has caused.

use std::io;

use rustix::io::Errno;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

use crate::Failure;

/// The descriptors that the launcher needs itself, and for a federate: two pipes, a socket, memory, a
/// notifier, and descriptors that are being sent.
const FILES: u64 = 14;
const FILES_EACH: u64 = 6;

/// Raises the limit of open files, if a process that launches so many federates needs more.
///
/// # Errors
///
/// If it cannot be raised: some federate would find the RTI closed, without a reason.
pub(super) fn check_files(federates: usize) -> Result<(), Failure> {
    need_files(files_for(federates), federates)
}

/// The same for a federate, whose loop says later what a limit has prevented.
pub(crate) fn raise_for_federate(federates: usize) {
    let _ = raise_files(files_for(federates));
}

/// Raises the limit of open files, if it is below what this process `needs` for so many federates.
///
/// # Errors
///
/// If it cannot be raised.
pub fn need_files(needed: u64, federates: usize) -> Result<(), Failure> {
    let Err(now) = raise_files(needed) else { return Ok(()) };
    let error = format!(
        "too many open files: this process may have {now}, and needs {needed} for {federates} federates"
    );
    let hint = format!("raise the limit: ulimit -n {}", needed.max(1024));
    Err(Failure::command(error).with_hint(&hint))
}

/// Whether this process may have the descriptors of so many boards beside what it needs for each federate: all boards that
/// federates read may be on their way through it at a time. Raises the limit, if it is below that.
pub(crate) fn allow_boards(boards: usize, federates: usize) -> bool {
    raise_files(files_for(federates) + boards as u64).is_ok()
}

fn files_for(federates: usize) -> u64 {
    FILES + FILES_EACH * federates as u64
}

/// Raises the limit of open files, if it is below what this process needs; or returns the limit.
fn raise_files(needed: u64) -> Result<(), u64> {
    let Rlimit { current, maximum } = getrlimit(Resource::Nofile);
    let Some(now) = current.filter(|now| *now < needed) else { return Ok(()) };
    let is_raised = maximum.is_none_or(|maximum| maximum >= needed)
        && setrlimit(Resource::Nofile, Rlimit { current: Some(needed), maximum }).is_ok();
    if is_raised { Ok(()) } else { Err(now) }
}

/// The failure that a process cannot be started, with what to do about it if a limit is the cause.
pub fn unstarted(what: &str, cause: &io::Error) -> Failure {
    let failure = Failure::command(format!("{what}: {cause}"));
    match Errno::from_io_error(cause) {
        Some(Errno::MFILE) => failure.with_hint("let a process open more files: ulimit -n 1024"),
        Some(Errno::AGAIN) => failure.with_hint("let the user have more processes: ulimit -u"),
        Some(Errno::NOMEM) => failure.with_hint("free memory on this machine, or raise ulimit -v"),
        _ => failure,
    }
}
