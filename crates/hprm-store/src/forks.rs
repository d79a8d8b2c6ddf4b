//! Processes that this one has forked: what was open here is open there too.
//!
//! A forked process reads the same memory, but does not tell its parent when it drops what it reads. So
//! an object that was open at a fork counts as open until the forked process has ended, and all
//! processes that it has forked. Memory that the forked process may write is not known here.
//!
//! Each fork has a number, and locks the byte of that number in a file, by a mapping that the forked
//! process inherits. The kernel keeps the lock as long as a process has the mapping: until the last one
//! has ended or has started another program. Programs close descriptors that they do not know, as
//! daemons do, but not mappings.

#![forbid(unsafe_code)]

use std::os::fd::{AsFd, OwnedFd};
use std::sync::atomic::{AtomicU64, Ordering};

use crate::shm::{ForkLock, is_locked, lock_file};

/// The forks of a process, which count from one.
#[derive(Debug)]
pub(crate) struct Forks {
    count: AtomicU64,
    /// The number of the last fork whose process may still run, or zero: most of the time there is
    /// none, and no system call is made.
    last: AtomicU64,
    /// The number of the last fork for which the system gave no lock: its process is assumed to run for
    /// ever.
    unknown: AtomicU64,
    file: Option<OwnedFd>,
}

impl Default for Forks {
    fn default() -> Self {
        Self {
            count: AtomicU64::new(0),
            last: AtomicU64::new(0),
            unknown: AtomicU64::new(0),
            file: lock_file().ok(),
        }
    }
}

impl Forks {
    /// How many there have been.
    pub(crate) fn count(&self) -> u64 {
        self.count.load(Ordering::Acquire)
    }

    /// Counts a fork that is about to happen. The forked process keeps the lock that this returns. This
    /// process drops it as soon as the forked process has it, or if the fork fails.
    pub(crate) fn begin(&self) -> Option<ForkLock> {
        let number = self.count.fetch_add(1, Ordering::AcqRel) + 1;
        let lock = self.file.as_ref().and_then(|file| ForkLock::new(file.as_fd(), number).ok());
        if lock.is_none() {
            self.unknown.fetch_max(number, Ordering::AcqRel);
        }
        self.last.fetch_max(number, Ordering::AcqRel);
        lock
    }

    /// Whether a process may run that was forked after the first `count` forks.
    pub(crate) fn may_read_since(&self, count: u64) -> bool {
        let last = self.last.load(Ordering::Acquire);
        if last <= count {
            return false;
        }
        if self.unknown.load(Ordering::Acquire) > count {
            return true;
        }
        let runs =
            self.file.as_ref().is_none_or(|file| is_locked(file.as_fd(), count + 1, last - count));
        if !runs {
            // Fails if there was another fork meanwhile, which counts.
            let _ = self.last.compare_exchange(last, count, Ordering::AcqRel, Ordering::Relaxed);
        }
        runs
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
        assert!(first.is_some() && second.is_some());
        assert_eq!(forks.count(), 2);
        assert!(forks.may_read_since(0) && forks.may_read_since(1) && !forks.may_read_since(2));
        drop(second);
        assert!(forks.may_read_since(0) && !forks.may_read_since(1));
        drop(first);
        assert!(!forks.may_read_since(0));
        assert!(forks.begin().is_some());
    }

    #[test]
    fn forks_that_have_ended_leave_no_descriptor() {
        let open = || std::fs::read_dir("/proc/self/fd").unwrap().count();
        let forks = Forks::default();
        let before = open();
        let locks: Vec<_> = (0..200).map(|_| forks.begin()).collect();
        // Other tests of this process open some descriptors.
        assert!(open() < before + 100);
        assert!(forks.may_read_since(199));
        drop(locks);
        assert!(!forks.may_read_since(0));
    }

    #[test]
    fn a_fork_without_a_lock_is_assumed_to_run_for_ever() {
        let forks = Forks { file: None, ..Forks::default() };
        assert!(!forks.may_read_since(0));
        assert!(forks.begin().is_none());
        assert!(forks.may_read_since(0) && !forks.may_read_since(1));
    }
}
