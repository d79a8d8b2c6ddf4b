//! How a loop waits for its links: it glances at what has come through memory, then looks for a while
//! without sleeping, then announces that it sleeps, and does.
//!
//! What comes is up to the loops. Reading one link is in [`line`](mod@line).

mod line;

use std::io;
use std::os::fd::AsFd;

use hprm_core::{Nanos, PhysicalTime};
use hprm_federated::Frame;

use crate::Clock;
use crate::link::LinkAcceptor;
use crate::notifier::Notifier;
use crate::wait::{GLANCE, Interest, Interests, Ready, SPIN_GLANCE, wait};
use crate::wire::Wire;
pub(crate) use line::{Broken, Line};

/// A time that has come, whatever the clock says.
const NOW: PhysicalTime = PhysicalTime(0);

/// The links of a loop, and the acceptor of new ones.
pub(crate) trait Watched {
    /// All links, each time in the same order.
    fn lines(&self) -> impl Iterator<Item = &Line>;

    /// The same, in the same order.
    fn lines_mut(&mut self) -> impl Iterator<Item = &mut Line>;

    /// Where links are opened, if they are.
    fn door(&self) -> Option<&Door>;

    /// The same.
    fn door_mut(&mut self) -> Option<&mut Door>;

    /// Whether there is something to read, or may be.
    fn has_news(&self) -> bool {
        self.door().is_some_and(|door| door.is_ready) || self.lines().any(Line::may_be_read)
    }

    /// All links themselves.
    fn wires(&self) -> impl Iterator<Item = &Wire> {
        self.lines().map(|line| &line.wire)
    }

    /// The same.
    fn wires_mut(&mut self) -> impl Iterator<Item = &mut Wire> {
        self.lines_mut().map(|line| &mut line.wire)
    }
}

/// An acceptor, and whether there may be a link to accept.
#[derive(Debug)]
pub(crate) struct Door {
    pub(crate) acceptor: LinkAcceptor,
    is_ready: bool,
}

impl Door {
    /// A link may have been opened before this is watched.
    pub(crate) fn new(acceptor: LinkAcceptor) -> Self {
        Self { acceptor, is_ready: true }
    }

    /// Whether there may be new or pending links.
    pub(crate) fn is_ready(&self) -> bool {
        self.is_ready
    }

    /// The links that have come, each with its first frame, by the local time.
    ///
    /// # Errors
    ///
    /// If none can come any more.
    pub(crate) fn admit(&mut self, now: PhysicalTime) -> io::Result<Vec<(Wire, Frame)>> {
        self.is_ready = false;
        self.acceptor.admit(now)
    }
}

/// What a wait has brought.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub(crate) struct Found {
    /// Another thread has notified the loop, and the notifier is not cleared yet.
    pub(crate) notified: bool,
    /// Another process has written to shared memory, or has read from it.
    pub(crate) stirred: bool,
    /// There is something to read, or may be.
    pub(crate) news: bool,
}

impl Found {
    fn is_anything(self) -> bool {
        self.notified || self.stirred || self.news
    }
}

/// What waits for the links of one loop.
#[derive(Debug)]
pub(crate) struct Poller {
    /// By which other processes notify this loop that have written to shared memory.
    notifier: Option<Notifier>,
    /// How long to busy-poll before sleeping.
    spin: Nanos,
    /// When the system was last asked what has come.
    asked_at: PhysicalTime,
}

impl Poller {
    pub(crate) fn new(notifier: Option<&Notifier>, spin: Nanos) -> Self {
        Self { notifier: notifier.cloned(), spin, asked_at: NOW }
    }

    /// Waits until a link is ready, the loop is notified, or `until` has come; for the first nanoseconds,
    /// perhaps, without going to sleep.
    pub(crate) fn wait(
        &mut self,
        on: &mut impl Watched,
        wakeups: &impl AsFd,
        until: Option<PhysicalTime>,
    ) -> Found {
        let in_memory = on.wires().all(Wire::is_in_memory);
        if in_memory && Clock::local().since(self.asked_at) < GLANCE && on.has_news() {
            return Found { news: true, ..Found::default() };
        }
        if self.spin > 0 {
            let give_up = Clock::local().plus(self.spin);
            loop {
                let now = Clock::local();
                if now >= give_up {
                    break;
                }
                let found = if !in_memory || now.since(self.asked_at) > SPIN_GLANCE {
                    self.sleep(on, wakeups, Some(NOW))
                } else {
                    Found { news: on.has_news(), ..Found::default() }
                };
                if found.is_anything() || until.is_some_and(|until| until <= Clock::now()) {
                    return found;
                }
            }
        }
        self.sleep(on, wakeups, until)
    }

    /// Looks for what has come by now. It does not wait.
    pub(crate) fn look(&mut self, on: &mut impl Watched, wakeups: &impl AsFd) -> Found {
        let in_memory = on.wires().all(Wire::is_in_memory);
        if in_memory && Clock::local().since(self.asked_at) < GLANCE {
            return Found { news: on.has_news(), ..Found::default() };
        }
        self.sleep(on, wakeups, Some(NOW))
    }

    /// Writes what is to be written within `patience`; with `all`, as long as it moves.
    pub(crate) fn drain(&self, on: &mut impl Watched, patience: Nanos, all: bool) {
        let mut until = Clock::now().plus(patience);
        while Clock::now() < until {
            // A link that cannot be written has no reader any more.
            on.wires_mut().for_each(|link| link.flush().unwrap_or_else(|_| link.discard()));
            let moved = on.wires_mut().fold(false, |moved, link| link.take_moved() | moved);
            if all && moved {
                until = Clock::now().plus(patience);
            }
            let blocked = on.wires().filter(|link| link.has_outbound());
            let mut interests: Interests<'_> = blocked.map(interest).collect();
            if interests.is_empty() {
                return;
            }
            interests.extend(self.notifier.iter().map(to_read));
            wait(&interests, Some(until));
            self.notifier.iter().for_each(Notifier::clear);
        }
    }

    /// Asks the system what has come, and sleeps until then; not if `until` is [`NOW`].
    fn sleep(
        &mut self,
        on: &mut impl Watched,
        wakeups: &impl AsFd,
        until: Option<PhysicalTime>,
    ) -> Found {
        let sleeps = until != Some(NOW);
        if sleeps {
            on.wires_mut().for_each(Wire::fall_asleep);
        }
        // After that: a process that has not seen this one sleep has written something.
        let found = self.ask(on, wakeups, until);
        if sleeps {
            on.wires_mut().for_each(Wire::wake_up);
        }
        self.asked_at = Clock::local();
        found
    }

    fn ask(
        &self,
        on: &mut impl Watched,
        wakeups: &impl AsFd,
        until: Option<PhysicalTime>,
    ) -> Found {
        let impatience = on.door().and_then(|door| door.acceptor.next_wakeup()).map(Clock::at);
        let unread = on.lines().any(Line::may_be_read).then(Clock::now);
        let until = until.into_iter().chain(impatience).chain(unread).min();
        let mut ready = wait(&self.interests(on, wakeups), until).into_iter();
        let notified = ready.next().is_some_and(Ready::is_ready);
        let mut stirred = false;
        if let Some(notifier) = &self.notifier
            && ready.next().is_some_and(Ready::is_ready)
        {
            notifier.clear();
            stirred = true;
        }
        on.lines_mut().zip(&mut ready).for_each(|(line, ready)| {
            line.note(ready.can_be_read());
            stirred |= ready.can_be_written();
        });
        if let Some(door) = on.door_mut() {
            // A pending link may have taken too long, which no descriptor tells.
            let too_long = impatience.is_some_and(|at| at <= Clock::now());
            door.is_ready |= too_long || ready.any(Ready::is_ready);
        }
        Found { notified, stirred, news: on.has_news() }
    }

    /// The wakeups, the notifier, the links in their order, and the door.
    fn interests<'a>(&'a self, on: &'a impl Watched, wakeups: &'a impl AsFd) -> Interests<'a> {
        let mut interests = Interests::new();
        interests.push(to_read(wakeups));
        interests.extend(self.notifier.iter().map(to_read));
        interests.extend(on.wires().map(interest));
        interests.extend(on.door().into_iter().flat_map(|door| door.acceptor.interests()));
        interests
    }
}

fn to_read(fd: &impl AsFd) -> Interest<'_> {
    Interest { fd: fd.as_fd(), write: false }
}

fn interest(link: &Wire) -> Interest<'_> {
    Interest { fd: link.as_fd(), write: link.waits_for_socket() }
}

#[cfg(test)]
mod tests;
