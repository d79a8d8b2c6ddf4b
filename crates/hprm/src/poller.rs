//! How a loop waits for its links: it looks at what has come through shared memory, then busy-polls for a while,
//! then announces that it sleeps, and sleeps.
//!
//! The loops decide what to do with what comes. Reading one link is in `polled_link`.

mod epoll_set;
mod polled_link;

use std::hint::black_box;
use std::io;
use std::os::fd::AsFd;

use hprm_core::{Nanos, PhysicalTime};
use hprm_federated::Frame;

use crate::Clock;
use crate::federate_loop::boards::Boards;
use crate::link::{Link, LinkAcceptor};
use crate::notifier::Notifier;
use crate::shipping::Shipping;
use crate::wait::{
    Few, Interest, Interests, KERNEL_POLL_INTERVAL, Readiness, Ready, SPIN_KERNEL_POLL_INTERVAL,
    Source, SourceId, wait,
};
use crate::watch::WatchServer;
use epoll_set::EpollSet;
pub(crate) use polled_link::{Arrivals, Broken, PolledLink};

/// A time that has come, whatever the clock says.
const NOW: PhysicalTime = PhysicalTime(0);

/// How often a loop that busy-polls looks into memory before it reads the clock, which takes longer than a look.
const LOOKS: u32 = 16;

/// What a loop polls: its links, and the acceptor of new ones.
pub(crate) trait PollSet {
    /// All links, always in the same order.
    fn polled_links(&self) -> impl Iterator<Item = &PolledLink>;

    /// The same, in the same order.
    fn polled_links_mut(&mut self) -> impl Iterator<Item = &mut PolledLink>;

    /// The acceptor of new links, if the loop accepts any.
    fn acceptor(&self) -> Option<&PolledAcceptor>;

    /// The same.
    fn acceptor_mut(&mut self) -> Option<&mut PolledAcceptor>;

    /// What watches this loop from outside, if anything may.
    fn watch(&self) -> Option<&WatchServer> {
        None
    }

    /// The same.
    fn watch_mut(&mut self) -> Option<&mut WatchServer> {
        None
    }

    /// What federates show one another, if this loop reads that.
    fn boards(&self) -> Option<&Boards> {
        None
    }

    /// What takes large values to other machines, if agents do that.
    fn shipping(&self) -> Option<&Shipping> {
        None
    }

    /// The same.
    fn shipping_mut(&mut self) -> Option<&mut Shipping> {
        None
    }

    /// Whether there may be something to read or to accept.
    fn may_be_readable(&self) -> bool {
        self.acceptor().is_some_and(|acceptor| acceptor.is_ready)
            || self.boards().is_some_and(Boards::have_news)
            || self.shipping().is_some_and(Shipping::is_ready)
            || self.polled_links().any(PolledLink::may_be_read)
    }

    /// All links, without the state of polling.
    fn links(&self) -> impl Iterator<Item = &Link> {
        self.polled_links().map(|polled| &polled.link)
    }

    /// The same.
    fn links_mut(&mut self) -> impl Iterator<Item = &mut Link> {
        self.polled_links_mut().map(|polled| &mut polled.link)
    }
}

/// An acceptor, and whether there may be a link to accept.
#[derive(Debug)]
pub(crate) struct PolledAcceptor {
    pub(crate) inner: LinkAcceptor,
    is_ready: bool,
}

impl PolledAcceptor {
    /// A peer may have opened a link before the loop polls, so the acceptor is ready at first.
    pub(crate) fn new(acceptor: LinkAcceptor) -> Self {
        Self { inner: acceptor, is_ready: true }
    }

    /// Whether there may be new or pending links.
    pub(crate) fn is_ready(&self) -> bool {
        self.is_ready
    }

    /// The links whose first frame has come, each with that frame. It is `now` by the local clock.
    ///
    /// # Errors
    ///
    /// If no link can be accepted any more.
    pub(crate) fn admit(&mut self, now: PhysicalTime) -> io::Result<Vec<(Link, Frame)>> {
        self.is_ready = false;
        self.inner.admit(now)
    }
}

/// What a wait has brought.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub(crate) struct Found {
    /// Another thread has notified the loop, which has not cleared the notifier yet.
    pub(crate) notified: bool,
    /// Another process has written to a ring buffer or has read from one, or a socket takes more.
    pub(crate) peer_activity: bool,
    /// There may be something to read or to accept.
    pub(crate) readable: bool,
    /// What the local clock showed shortly before, if the poller has read it.
    pub(crate) at: Option<PhysicalTime>,
}

impl Found {
    fn is_anything(self) -> bool {
        self.notified || self.peer_activity || self.readable
    }
}

/// Waits for the links of one loop.
#[derive(Debug)]
pub(crate) struct Poller {
    /// What other processes use to notify this loop when they have written to shared memory.
    notifier: Option<Notifier>,
    sources: EpollSet,
    /// The identities of the wakeups and of the notifier.
    ids: (SourceId, SourceId),
    /// How long to busy-poll before sleeping.
    spin: Nanos,
    /// When this poller last asked the kernel what has come.
    asked_at: PhysicalTime,
}

impl Poller {
    pub(crate) fn new(notifier: Option<&Notifier>, spin: Nanos) -> Self {
        Self {
            notifier: notifier.cloned(),
            sources: EpollSet::Empty,
            ids: (SourceId::new(), SourceId::new()),
            spin,
            asked_at: NOW,
        }
    }

    /// From now on, the loop sleeps at once: nothing waits for it.
    pub(crate) fn do_not_spin(&mut self) {
        self.spin = 0;
    }

    /// Waits until a link is ready, the loop is notified, or `until` has come. The poller may busy-poll for
    /// some time before it sleeps.
    // Apart, so that the loop itself stays small.
    #[inline(never)]
    pub(crate) fn wait(
        &mut self,
        on: &mut impl PollSet,
        wakeups: &impl AsFd,
        until: Option<PhysicalTime>,
    ) -> Found {
        if on.may_be_readable() {
            let now = Clock::local();
            if self.may_put_off_kernel(on, now) {
                return Found { readable: true, at: Some(now), ..Found::default() };
            }
        }
        if self.spin > 0
            && let Some(found) = self.busy_poll(on, wakeups, until)
        {
            return found;
        }
        self.sleep(on, wakeups, until)
    }

    /// Looks for messages again and again. Returns nothing if none has come after the time of busy-polling.
    fn busy_poll(
        &mut self,
        on: &mut impl PollSet,
        wakeups: &impl AsFd,
        until: Option<PhysicalTime>,
    ) -> Option<Found> {
        let in_memory = on.links().all(Link::is_in_memory);
        let began = Clock::local();
        let (give_up, until) = (began.plus(self.spin), until.map(Clock::local_at));
        let mut now = began;
        while now < give_up {
            // What usually comes, comes soon and through memory. The kernel is asked when it does not.
            let quiet = now.since(self.asked_at.max(began)) > SPIN_KERNEL_POLL_INTERVAL;
            let overdue = now.since(self.asked_at) > KERNEL_POLL_INTERVAL;
            let found = match in_memory && !quiet && !overdue {
                true => {
                    Found { readable: looks_find_anything(on), at: Some(now), ..Found::default() }
                }
                false => self.sleep(on, wakeups, Some(NOW)),
            };
            if found.is_anything() {
                return Some(found);
            }
            now = Clock::local();
            if until.is_some_and(|until| until <= now) {
                return Some(Found { at: Some(now), ..found });
            }
        }
        None
    }

    /// Looks for what has come by now, without waiting. It is about `now` by the local clock.
    pub(crate) fn look(
        &mut self,
        on: &mut impl PollSet,
        wakeups: &impl AsFd,
        now: PhysicalTime,
    ) -> Found {
        if self.may_put_off_kernel(on, now) {
            return Found { readable: on.may_be_readable(), ..Found::default() };
        }
        self.sleep(on, wakeups, Some(NOW))
    }

    /// Whether all messages come through memory, and the kernel was asked a short time ago for everything else.
    fn may_put_off_kernel(&self, on: &impl PollSet, now: PhysicalTime) -> bool {
        now.since(self.asked_at) < KERNEL_POLL_INTERVAL && on.links().all(Link::is_in_memory)
    }

    /// Writes what is to be written within `timeout`; with `all`, as long as some of it leaves.
    pub(crate) fn drain(&self, on: &mut impl PollSet, timeout: Nanos, all: bool) {
        let mut until = Clock::now().plus(timeout);
        while Clock::now() < until {
            // Nothing reads a link any more that cannot be written.
            on.links_mut().for_each(|link| link.flush().unwrap_or_else(|_| link.discard()));
            let moved = on.links_mut().fold(false, |moved, link| link.take_moved_chunks() | moved);
            if all && moved {
                until = Clock::now().plus(timeout);
            }
            let blocked = on.links().filter(|link| link.has_outbound());
            let mut interests: Interests<'_> = blocked.map(interest).collect();
            if interests.is_empty() {
                return;
            }
            interests.extend(self.notifier.iter().map(to_read));
            wait(&interests, Some(until));
            self.notifier.iter().for_each(Notifier::clear);
        }
    }

    /// Asks the kernel what has come, and sleeps until something has; not if `until` is [`NOW`].
    fn sleep(
        &mut self,
        on: &mut impl PollSet,
        wakeups: &impl AsFd,
        until: Option<PhysicalTime>,
    ) -> Found {
        let sleeps = until != Some(NOW);
        if sleeps {
            on.links_mut().for_each(Link::announce_sleep);
            on.boards().into_iter().for_each(Boards::announce_sleep);
        }
        // Only after the announcement: a peer that did not see it has already written what it had to write.
        let found = self.ask(on, wakeups, until);
        if sleeps {
            on.links_mut().for_each(Link::end_sleep);
            on.boards().into_iter().for_each(Boards::end_sleep);
        }
        self.asked_at = Clock::local();
        found
    }

    fn ask(
        &mut self,
        on: &mut impl PollSet,
        wakeups: &impl AsFd,
        until: Option<PhysicalTime>,
    ) -> Found {
        let acceptor_wakeup =
            on.acceptor().and_then(|acceptor| acceptor.inner.next_wakeup()).map(Clock::at);
        let unread = on.polled_links().any(PolledLink::may_be_read)
            || on.boards().is_some_and(Boards::have_news)
            || on.shipping().is_some_and(Shipping::is_ready);
        let unread = unread.then(Clock::now);
        let until = until.into_iter().chain(acceptor_wakeup).chain(unread).min();
        let mut ready = self.ready(on, wakeups, until).into_iter();
        let notified = ready.next().is_some_and(Ready::is_ready);
        let mut peer_activity = false;
        if let Some(notifier) = &self.notifier
            && ready.next().is_some_and(Ready::is_ready)
        {
            if !self.sources.tells_once() {
                notifier.clear();
            }
            peer_activity = true;
        }
        if let Some(watch) = on.watch_mut() {
            watch.note(&mut ready);
        }
        if let Some(shipping) = on.shipping_mut().filter(|it| it.is_open())
            && let Some(ready) = ready.next()
        {
            shipping.note(ready);
        }
        on.polled_links_mut().zip(&mut ready).for_each(|(polled, ready)| {
            polled.note(ready.can_be_read());
            peer_activity |= ready.can_be_written();
        });
        if let Some(acceptor) = on.acceptor_mut() {
            // A pending link may have taken too long, which no descriptor shows.
            let too_long = acceptor_wakeup.is_some_and(|at| at <= Clock::now());
            acceptor.is_ready |= too_long || ready.any(Ready::is_ready);
        }
        Found { notified, peer_activity, readable: on.may_be_readable(), at: None }
    }

    /// Waits for the wakeups, the notifier, watchers, shipments, the links in their order, and the acceptor.
    fn ready(
        &mut self,
        on: &impl PollSet,
        wakeups: &impl AsFd,
        until: Option<PhysicalTime>,
    ) -> Readiness {
        let Self { notifier, sources, ids, .. } = self;
        let mut wanted = Few::new();
        wanted.push(Source::new(ids.0, to_read(wakeups)));
        wanted.extend(notifier.iter().map(|it| Source::notifier(ids.1, it.as_fd())));
        wanted.extend(on.watch().into_iter().flat_map(WatchServer::sources));
        wanted.extend(on.shipping().and_then(Shipping::source));
        wanted.extend(on.polled_links().map(PolledLink::source));
        wanted.extend(on.acceptor().into_iter().flat_map(|acceptor| acceptor.inner.sources()));
        sources.wait(&wanted, until)
    }
}

/// Looks into memory [`LOOKS`] times, and says whether there may be something to read.
// As a loop that stays one: unrolled, it would take the place of what is to run next in the processor's cache.
#[inline(never)]
fn looks_find_anything(on: &impl PollSet) -> bool {
    let mut looks = black_box(LOOKS);
    while looks > 0 {
        if on.may_be_readable() {
            return true;
        }
        looks -= 1;
    }
    false
}

fn to_read(fd: &impl AsFd) -> Interest<'_> {
    Interest { fd: fd.as_fd(), write: false }
}

fn interest(link: &Link) -> Interest<'_> {
    Interest { fd: link.as_fd(), write: link.waits_for_socket() }
}

#[cfg(test)]
mod tests;
