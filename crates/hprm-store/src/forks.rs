//! Processes that this one has forked: what was open here is open there too.
//!
//! A forked process reads the same memory, but nothing tells when it drops what it reads. So what was
//! open at a fork counts as open until the new process has ended, and all that it has forked. What the
//! new process may write to is not known here.
//!
//! Each fork has a number, and marks the byte of that number in a file, by a mapping that the new
//! process inherits. The kernel keeps the mark as long as a process has the mapping: until the last one
//! has ended or has started another program. Programs close descriptors that they do not know, as
//! daemons do, but not mappings.

#![forbid(unsafe_code)]

use std::os::fd::{AsFd, OwnedFd};
use std::sync::atomic::{AtomicU64, Ordering};

use crate::shm::{Tether, is_marked, marks};

/// The forks of a process, which count from one.
#[derive(Debug)]
pub(crate) struct Forks {
    count: AtomicU64,
    /// The number of the last fork whose process may still run, or zero: most of the time there is
    /// none, and the system is not asked.
    last: AtomicU64,
    /// The number of the last fork of which the system tells nothing: its process is taken to run for
    /// ever.
    unknown: AtomicU64,
    marks: Option<OwnedFd>,
}

impl Default for Forks {
    fn default() -> Self {
        Self {
            count: AtomicU64::new(0),
            last: AtomicU64::new(0),
            unknown: AtomicU64::new(0),
            marks: marks().ok(),
        }
    }
}

impl Forks {
    /// How many there have been.
    pub(crate) fn count(&self) -> u64 {
        self.count.load(Ordering::Acquire)
    }

    /// There is about to be one more. The new process should keep what this returns, and this process
    /// drop it as soon as that has it, or there is none after all.
    pub(crate) fn begin(&self) -> Option<Tether> {
        let number = self.count.fetch_add(1, Ordering::AcqRel) + 1;
        let tether = self.marks.as_ref().and_then(|file| Tether::to(file.as_fd(), number).ok());
        if tether.is_none() {
            self.unknown.fetch_max(number, Ordering::AcqRel);
        }
        self.last.fetch_max(number, Ordering::AcqRel);
        tether
    }

    /// Whether a process runs that was forked when there had been only `count` of them.
    pub(crate) fn may_read_since(&self, count: u64) -> bool {
        let last = self.last.load(Ordering::Acquire);
        if last <= count {
            return false;
        }
        if self.unknown.load(Ordering::Acquire) > count {
            return true;
        }
        let runs =
            self.marks.as_ref().is_none_or(|file| is_marked(file.as_fd(), count + 1, last - count));
        if !runs {
            // Unless there is a new one.
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
        let tethers: Vec<_> = (0..200).map(|_| forks.begin()).collect();
        // Other tests of this process open some.
        assert!(open() < before + 100);
        assert!(forks.may_read_since(199));
        drop(tethers);
        assert!(!forks.may_read_since(0));
    }

    #[test]
    fn of_a_fork_without_a_mark_the_end_is_never_known() {
        let forks = Forks { marks: None, ..Forks::default() };
        assert!(!forks.may_read_since(0));
        assert!(forks.begin().is_none());
        assert!(forks.may_read_since(0) && !forks.may_read_since(1));
    }
}
