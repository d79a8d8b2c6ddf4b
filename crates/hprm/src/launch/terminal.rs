//! The terminal of the launcher, lent to one federate: what is typed goes there, Ctrl-C too.
//!
//! A federate leads a process group of its own, and only the foreground group of a terminal may read
//! from it. Where the standard input is no terminal, there is nothing to lend.

use std::io::{self, IsTerminal};

use nix::sys::signal::{SigSet, SigmaskHow, Signal};
use nix::unistd::{Pid, getpgrp, tcsetpgrp};

/// A terminal that belongs to another process group until this is dropped.
#[derive(Debug)]
pub(super) struct Lent;

impl Lent {
    /// Makes the group that the process `leader` leads the foreground group of the terminal. None if
    /// there is no terminal, or it is another group's.
    pub(super) fn to(leader: u32) -> Option<Self> {
        let leader = Pid::from_raw(i32::try_from(leader).ok()?);
        (io::stdin().is_terminal() && tcsetpgrp(io::stdin(), leader).is_ok()).then_some(Self)
    }
}

impl Drop for Lent {
    fn drop(&mut self) {
        // The system stops a background process that takes the terminal, unless it blocks the signal.
        let mut stop = SigSet::empty();
        stop.add(Signal::SIGTTOU);
        if let Ok(before) = stop.thread_swap_mask(SigmaskHow::SIG_BLOCK) {
            // The terminal may be gone.
            let _ = tcsetpgrp(io::stdin(), getpgrp());
            let _ = before.thread_set_mask();
        }
    }
}
