//! Waiting for descriptors and for physical time.

use std::os::fd::BorrowedFd;

use hprm_core::PhysicalTime;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;

use crate::Clock;

/// What a loop waits for at a descriptor.
#[derive(Clone, Copy)]
pub(crate) struct Interest<'fd> {
    pub(crate) fd: BorrowedFd<'fd>,
    /// Whether it also waits until more can be written.
    pub(crate) write: bool,
}

/// Waits until a descriptor is ready, `until` has come, or a signal arrives. Returns which are.
pub(crate) fn wait(interests: &[Interest<'_>], until: Option<PhysicalTime>) -> Vec<bool> {
    let mut fds: Vec<_> = interests
        .iter()
        .map(|interest| {
            let write = if interest.write { PollFlags::OUT } else { PollFlags::empty() };
            PollFd::from_borrowed_fd(interest.fd, PollFlags::IN | write)
        })
        .collect();
    let timeout = until.filter(|until| *until != PhysicalTime::FOREVER).map(|until| {
        let nanos = until.since(Clock::now()).max(0);
        Timespec { tv_sec: nanos / 1_000_000_000, tv_nsec: nanos % 1_000_000_000 }
    });
    match poll(&mut fds, timeout.as_ref()) {
        Ok(_) => fds.iter().map(|fd| !fd.revents().is_empty()).collect(),
        // A signal: the caller looks whether it is meant to stop.
        Err(Errno::INTR) => vec![false; interests.len()],
        Err(error) => unreachable!("poll of open descriptors: {error}"),
    }
}
