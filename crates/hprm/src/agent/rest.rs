//! What a loop does that has no descriptor left for a connection: it does not look for connections for a while.
//!
//! The connection waits meanwhile, and so the listener stays ready: a loop that waited for it would never sleep.

use std::io;
use std::os::fd::AsFd;
use std::sync::atomic::{AtomicBool, Ordering};

use hprm_core::{Nanos, PhysicalTime};
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use crate::link::{descriptor_advice, is_shortage};
use crate::{Kind, Label, Report, console};

/// How long such a rest is.
const REST: Nanos = 100_000_000;

/// Whether the user of the agent has been told, which happens once in a process.
static IS_TOLD: AtomicBool = AtomicBool::new(false);

/// See the module.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Rest {
    until: Option<PhysicalTime>,
}

impl Rest {
    /// Whether connections may be accepted.
    pub fn is_over(&mut self, now: PhysicalTime) -> bool {
        self.until.take_if(|until| *until <= now);
        self.until.is_none()
    }

    /// When they may be again; none if they may be now.
    #[must_use]
    pub fn until(&self) -> Option<PhysicalTime> {
        self.until
    }

    /// Takes note of a connection that could not be accepted: if there was no descriptor, or no memory, the rest begins. Returns
    /// whether it does.
    pub fn begins_after(&mut self, error: &io::Error, now: PhysicalTime) -> bool {
        let begins = is_shortage(error);
        if begins {
            self.until = Some(now.plus(REST));
        }
        begins
    }

    /// The same in a loop of the agent, which tells its user the first time.
    pub fn begins_in_agent(
        &mut self,
        error: &io::Error,
        now: PhysicalTime,
        tell: impl FnOnce(&str),
    ) -> bool {
        let begins = self.begins_after(error, now);
        if begins && !IS_TOLD.swap(true, Ordering::Relaxed) {
            let text = "the agent can open no more files, so new connections wait until others end";
            let report = Report::new(Kind::System, text);
            let hint = descriptor_advice(error).map(str::to_owned);
            let report = Report { hint, ..report };
            tell(&report.text(Label::Warning, console::color(&io::stderr())));
        }
        begins
    }
}

/// Whether a connection waits to be accepted. Where there is no descriptor for it, the kernel says so also if none does.
#[must_use]
pub fn has_come(listener: &impl AsFd) -> bool {
    let mut waits = [PollFd::new(listener, PollFlags::IN)];
    poll(&mut waits, Some(&Timespec { tv_sec: 0, tv_nsec: 0 })).is_ok_and(|ready| ready > 0)
}

#[cfg(test)]
mod tests {
    use rustix::io::Errno;

    use super::*;

    #[test]
    fn a_rest_begins_if_there_is_no_descriptor_and_ends_by_itself() {
        let (mut rest, now) = (Rest::default(), PhysicalTime(7));
        for other in [Errno::AGAIN, Errno::CONNABORTED] {
            assert!(!rest.begins_after(&other.into(), now));
        }
        assert!(rest.is_over(now) && rest.until().is_none());
        assert!(rest.begins_after(&Errno::MFILE.into(), now));
        assert_eq!(rest.until(), Some(now.plus(REST)));
        assert!(!rest.is_over(now.plus(REST - 1)) && rest.until().is_some());
        assert!(rest.is_over(now.plus(REST)) && rest.until().is_none());
    }
}
