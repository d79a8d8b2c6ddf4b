//! Processes that this one has forked: what was open here is open there too.
//!
//! A forked process reads the same memory, but nobody hears of it when it stops. So what was open at a
//! fork counts as open until the new process has ended, which the end of a pipe tells. What the new
//! process may write to is not known here.

#![forbid(unsafe_code)]
#![allow(clippy::disallowed_types, reason = "programs fork on any thread; nothing waits under it")]

use std::os::fd::OwnedFd;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::pipe::{PipeFlags, pipe_with};

const NOW: Timespec = Timespec { tv_sec: 0, tv_nsec: 0 };

/// The forks of a process, which count from one.
#[derive(Debug, Default)]
pub(crate) struct Forks {
    count: AtomicU64,
    /// The number of the last fork whose process may still run, or zero: most of the time there is
    /// none, and nobody takes the lock for that.
    last: AtomicU64,
    running: Mutex<Vec<Child>>,
}

#[derive(Debug)]
struct Child {
    number: u64,
    /// Ends with the process. Without it, it is taken to run for ever.
    pipe: Option<OwnedFd>,
}

impl Child {
    fn has_ended(&self) -> bool {
        let Some(pipe) = &self.pipe else { return false };
        let mut asked = [PollFd::new(pipe, PollFlags::IN)];
        poll(&mut asked, Some(&NOW)).is_ok_and(|ready| ready > 0)
    }
}

impl Forks {
    /// How many there have been.
    pub(crate) fn count(&self) -> u64 {
        self.count.load(Ordering::Acquire)
    }

    /// There is about to be one more. The new process should keep what this returns, and this process
    /// drop it as soon as that has it, or there is none after all.
    pub(crate) fn begin(&self) -> Option<OwnedFd> {
        let (pipe, tether) = pipe_with(PipeFlags::CLOEXEC).ok().unzip();
        let mut running = self.running();
        let number = self.count.fetch_add(1, Ordering::AcqRel) + 1;
        running.push(Child { number, pipe });
        self.last.store(number, Ordering::Release);
        tether
    }

    /// Whether a process runs that was forked when there had been only `count` of them.
    pub(crate) fn may_read_since(&self, count: u64) -> bool {
        if self.last.load(Ordering::Acquire) <= count {
            return false;
        }
        let mut running = self.running();
        running.retain(|child| !child.has_ended());
        let last = running.last().map_or(0, |child| child.number);
        self.last.store(last, Ordering::Release);
        last > count
    }

    fn running(&self) -> MutexGuard<'_, Vec<Child>> {
        self.running.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_open_at_a_fork_may_be_read_until_that_process_ends() {
        let forks = Forks::default();
        assert!(!forks.may_read_since(0));
        let first = forks.begin();
        let second = forks.begin();
        assert_eq!(forks.count(), 2);
        assert!(forks.may_read_since(0) && forks.may_read_since(1) && !forks.may_read_since(2));
        drop(second);
        assert!(forks.may_read_since(0) && !forks.may_read_since(1));
        drop(first);
        assert!(!forks.may_read_since(0));
    }
}
