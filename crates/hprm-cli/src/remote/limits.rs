//! What a program may use that is started here for another user: limits that the starter sets for itself, and that all
//! processes inherit which it starts. None of them can raise a limit again.

use std::io;

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

/// See the module. A process that already has less keeps that.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Limits {
    /// Bytes that a process may allocate. Memory that it shares with others is not among them, nor are files.
    pub(super) memory: u64,
    /// Processes and threads of this user, also those that are no part of the program; for root, there is no such limit.
    pub(super) processes: u64,
    /// Open files of a process.
    pub(super) files: u64,
}

impl Limits {
    /// Sets them.
    ///
    /// # Errors
    ///
    /// If the system refuses.
    pub(super) fn apply(&self) -> io::Result<()> {
        for (resource, limit) in [
            (Resource::Data, self.memory),
            (Resource::Nproc, self.processes),
            (Resource::Nofile, self.files),
        ] {
            let Rlimit { current, maximum } = getrlimit(resource);
            let at_most = |bound: Option<u64>| Some(bound.map_or(limit, |bound| bound.min(limit)));
            let limits = Rlimit { current: at_most(current), maximum: at_most(maximum) };
            setrlimit(resource, limits)?;
        }
        Ok(())
    }
}
