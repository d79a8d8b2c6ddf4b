//! Waiting for descriptors and for physical time.

use std::io;
use std::os::fd::BorrowedFd;
use std::sync::atomic::{AtomicU64, Ordering};

use hprm_core::{Nanos, PhysicalTime};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use smallvec::SmallVec;

use crate::Clock;

/// How long a loop that reads messages from shared memory does not ask the kernel: so long may ends of links,
/// new connections and signals wait.
pub(crate) const KERNEL_POLL_INTERVAL: Nanos = 50_000;

/// The same for a loop that busy-polls instead of sleeping.
pub(crate) const SPIN_KERNEL_POLL_INTERVAL: Nanos = 5_000;

/// As many as a federate of usual size has: waiting for that many allocates nothing.
pub(crate) type Few<T> = SmallVec<[T; 16]>;

/// What a loop waits for.
pub(crate) type Interests<'fd> = Few<Interest<'fd>>;

/// Which of the descriptors that a loop has waited for are ready, in their order.
pub(crate) type Readiness = Few<Ready>;

/// What a descriptor is ready for.
#[derive(Clone, Copy)]
pub(crate) struct Ready(PollFlags);

impl Ready {
    /// Not ready.
    pub(crate) const NOT: Self = Self(PollFlags::empty());

    /// Ready for what epoll reports with these bits, which are those of poll. Their type depends on whether rustix uses
    /// the C library, which is a feature that any crate of a program may turn on.
    pub(crate) fn of(bits: u32) -> Self {
        Self(PollFlags::from_bits_retain(bits as _))
    }

    /// Whether it is ready for anything.
    pub(crate) fn is_ready(self) -> bool {
        !self.0.is_empty()
    }

    /// Whether a read tells something: what has come, or that nothing more will.
    pub(crate) fn can_be_read(self) -> bool {
        !self.0.difference(PollFlags::OUT).is_empty()
    }

    /// Whether what is to be written can be.
    pub(crate) fn can_be_written(self) -> bool {
        self.0.contains(PollFlags::OUT)
    }
}

/// What a loop waits for at a descriptor.
#[derive(Clone, Copy)]
pub(crate) struct Interest<'fd> {
    pub(crate) fd: BorrowedFd<'fd>,
    /// Whether it also waits until more can be written.
    pub(crate) write: bool,
}

/// A descriptor that a loop waits for again and again.
#[derive(Clone, Copy)]
pub(crate) struct Source<'fd> {
    pub(crate) id: SourceId,
    pub(crate) interest: Interest<'fd>,
    /// Whether it is ready once for each time that it has been notified, as far as the kernel can tell that.
    pub(crate) once: bool,
}

impl<'fd> Source<'fd> {
    /// A descriptor that is ready as long as something can be read there, or written.
    pub(crate) fn new(id: SourceId, interest: Interest<'fd>) -> Self {
        Self { id, interest, once: false }
    }

    /// A notifier, which need not be read where it is ready once for each notification: that saves a system call.
    pub(crate) fn notifier(id: SourceId, fd: BorrowedFd<'fd>) -> Self {
        Self { id, interest: Interest { fd, write: false }, once: true }
    }
}

/// Identifies an open descriptor in this process; a later one with the same number has another identity.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct SourceId(u64);

impl SourceId {
    /// The identity of a descriptor that has just been opened.
    pub(crate) fn new() -> Self {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        Self(NEXT.fetch_add(1, Ordering::Relaxed))
    }
}

/// For how long something is waited for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Deadline {
    /// Until when, by the federation's time.
    pub(crate) until: PhysicalTime,
    /// What else ends the wait.
    pub(crate) breaker: Breaker,
}

/// What ends a wait before its time.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Breaker {
    /// Nothing.
    Nothing,
    /// Asked now and then: whether to wait no longer.
    Asked(fn() -> bool),
    /// Any signal that comes during the wait.
    Signals,
}

impl Deadline {
    /// Whatever signals come.
    pub(crate) fn at(until: PhysicalTime) -> Self {
        Self { until, breaker: Breaker::Nothing }
    }

    /// Fails once it is over.
    pub(crate) fn check(self) -> io::Result<()> {
        match self.breaker {
            Breaker::Asked(is_over) if is_over() => Err(interrupted()),
            _ if Clock::now() >= self.until => Err(io::ErrorKind::TimedOut.into()),
            _ => Ok(()),
        }
    }

    /// Waits until a descriptor is ready; false if a signal has ended the wait, which may go on. Fails once the
    /// deadline is over.
    pub(crate) fn wait(self, interest: Interest<'_>) -> io::Result<bool> {
        self.check()?;
        if wait(&[interest], Some(self.until))[0].is_ready() {
            return Ok(true);
        }
        self.check()?;
        match self.breaker {
            Breaker::Signals => Err(interrupted()),
            Breaker::Nothing | Breaker::Asked(_) => Ok(false),
        }
    }
}

fn interrupted() -> io::Error {
    io::Error::new(io::ErrorKind::Interrupted, "interrupted")
}

/// Waits until a descriptor is ready, `until` has come, or a signal arrives. Returns which are.
pub(crate) fn wait(interests: &[Interest<'_>], until: Option<PhysicalTime>) -> Readiness {
    let mut fds: Few<_> = interests
        .iter()
        .map(|interest| {
            let write = if interest.write { PollFlags::OUT } else { PollFlags::empty() };
            PollFd::from_borrowed_fd(interest.fd, PollFlags::IN | write)
        })
        .collect();
    if poll_until(&mut fds, until) {
        fds.iter().map(|fd| Ready(fd.revents())).collect()
    } else {
        Few::from_elem(Ready::NOT, interests.len())
    }
}

/// Waits until one descriptor can be read, `until` has come, or a signal arrives. Returns whether it
/// is known to be readable. Allocates nothing.
pub(crate) fn wait_for(fd: BorrowedFd<'_>, until: Option<PhysicalTime>) -> bool {
    let mut asked = [PollFd::from_borrowed_fd(fd, PollFlags::IN)];
    poll_until(&mut asked, until) && !asked[0].revents().is_empty()
}

/// Whether the other end of a socket is gone. It does not wait.
pub(crate) fn is_hung_up(fd: BorrowedFd<'_>) -> bool {
    let mut fds = [PollFd::from_borrowed_fd(fd, PollFlags::empty())];
    let now = Timespec { tv_sec: 0, tv_nsec: 0 };
    poll(&mut fds, Some(&now)).is_ok() && fds[0].revents().contains(PollFlags::HUP)
}

/// Returns whether `fds` tell what happened; not after a signal.
fn poll_until(fds: &mut [PollFd<'_>], until: Option<PhysicalTime>) -> bool {
    match poll(fds, timeout(until).as_ref()) {
        Ok(_) => true,
        // The caller looks whether it is meant to stop.
        Err(Errno::INTR) => false,
        Err(error) => unreachable!("poll of open descriptors: {error}"),
    }
}

/// How long it takes until a time comes; none if it never comes.
pub(crate) fn timeout(until: Option<PhysicalTime>) -> Option<Timespec> {
    until.filter(|until| *until != PhysicalTime::FOREVER).map(|until| {
        let nanos = Clock::until(until).max(0);
        Timespec { tv_sec: nanos / 1_000_000_000, tv_nsec: nanos % 1_000_000_000 }
    })
}

#[cfg(test)]
mod tests {
    use std::os::fd::AsFd;
    use std::os::unix::net::UnixStream;

    use super::*;

    #[test]
    fn the_end_of_the_time_is_no_signal() {
        let (one, _other) = UnixStream::pair().unwrap();
        let nothing = Interest { fd: one.as_fd(), write: false };
        let until = Clock::now().plus(1_000_000);
        for breaker in [Breaker::Nothing, Breaker::Asked(|| false), Breaker::Signals] {
            let deadline = Deadline { until, breaker };
            let error = deadline.wait(nothing).unwrap_err();
            assert_eq!(error.kind(), io::ErrorKind::TimedOut, "{breaker:?}");
        }
    }

    #[test]
    fn a_wait_without_a_signal_goes_on_until_something_comes() {
        let (one, _other) = UnixStream::pair().unwrap();
        let ready = Interest { fd: one.as_fd(), write: true };
        let until = Clock::now().plus(60_000_000_000);
        assert!(Deadline { until, breaker: Breaker::Signals }.wait(ready).unwrap());
        let error = Deadline { until, breaker: Breaker::Asked(|| true) }.wait(ready).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::Interrupted);
    }
}
