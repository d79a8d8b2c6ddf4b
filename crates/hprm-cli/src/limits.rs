//! The limits of this process, which those that it starts inherit: whether a program can run within them. Those of
//! a federation of processes are the launcher's business.

use hprm::launch::need_files;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

use crate::message::Error;

/// The stack that every program has room for, in bytes; a lower limit is raised, where that is allowed.
const AMPLE_STACK: u64 = 1 << 20;
/// Below this, neither the command nor Python gets far.
const LEAST_STACK: u64 = 128 << 10;

/// The descriptors that a process needs whose federates are threads: for modules that are being read, for the
/// pipe for signals, and for notifiers; and those for each federate.
const FILES_IN_PROCESS: u64 = 18;
const FILES_OF_THREAD: u64 = 5;

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

/// Raises the limit of open files, if a process that has so many federates as threads needs more.
///
/// # Errors
///
/// If it cannot be raised.
pub(crate) fn check_files(federates: usize) -> Result<(), Error> {
    Ok(need_files(FILES_IN_PROCESS + FILES_OF_THREAD * federates as u64, federates)?)
}
