//! Accepts links, and keeps them until their first frame has arrived.
//!
//! The acceptor hands over a link with its first frame, and the loop decides about it. The acceptor closes a
//! link that sends nothing, or something else; the link costs little until then, and no loop waits for it. The
//! number of pending links is bounded, also by the descriptors of the process: [`pending`] selects which of
//! them the acceptor closes. Unauthenticated clients never cause a failure of the process, and while the
//! federation runs they get a share of its time and no more.

mod pending;

use std::io;
use std::os::fd::AsFd;

use hprm_core::{Nanos, PhysicalTime};
use hprm_federated::Frame;

use self::pending::{LinkOrigin, PendingLimits, PendingLink, PendingLinks};
use super::{Address, Arrival, Keys, Link, LinkListener, Purpose, descriptors};
use crate::Clock;
use crate::wait::{Interest, Source, SourceId};

/// How long a link may take until its first frame has come.
const FIRST_FRAME_TIMEOUT: Nanos = 10_000_000_000;

/// The most unauthenticated clients in one stage, and from one address, unless more federates join.
const MOST_UNPROVED: usize = 32;
const FROM_ONE: usize = 16;

/// The most links that are authenticated and have sent no frame, unless more federates join.
const PROVED: usize = 64;

/// Unauthenticated clients take no more than one of this many free descriptors.
const SHARE_OF_DESCRIPTORS: usize = 4;

/// How long one round may take; it may be longer by the time for one link.
const ROUND: Nanos = 2_000_000;

/// While the federation runs, pending links wait this many times as long as the last round took.
const REST: Nanos = 3;

/// How long to wait if no descriptor is left, and no unauthenticated client has one.
const SHORTAGE: Nanos = 100_000_000;

/// See the module.
#[derive(Debug)]
pub(crate) struct LinkAcceptor {
    listeners: Vec<LinkListener>,
    listener_ids: Vec<SourceId>,
    pending: PendingLinks,
    purpose: Purpose,
    keys: Keys,
    /// How many federates may connect.
    members: usize,
    /// Whether the federation runs, so that this process has other work.
    is_busy: bool,
    /// The acceptor does not look at links before this time of the local clock.
    rests_until: Option<PhysicalTime>,
}

impl LinkAcceptor {
    /// An acceptor of links from this many members.
    pub(crate) fn new(
        listeners: Vec<LinkListener>,
        purpose: Purpose,
        keys: Keys,
        members: usize,
    ) -> Self {
        Self {
            listener_ids: listeners.iter().map(|_| SourceId::new()).collect(),
            listeners,
            pending: PendingLinks::default(),
            purpose,
            keys,
            members,
            is_busy: false,
            rests_until: None,
        }
    }

    /// Where it listens.
    pub(crate) fn addresses(&self) -> impl Iterator<Item = &Address> {
        self.listeners.iter().map(LinkListener::address)
    }

    /// The federation runs: pending links get a share of the time.
    pub(crate) fn become_busy(&mut self) {
        self.is_busy = true;
    }

    /// The links whose first frame has come, with that frame. It is `now` by the local clock, which
    /// is never set.
    pub(crate) fn admit(&mut self, now: PhysicalTime) -> io::Result<Vec<(Link, Frame)>> {
        if self.rests_until.is_some_and(|until| now < until) {
            return Ok(Vec::new());
        }
        self.rests_until = None;
        let begun = Clock::local();
        let mut admitted = Vec::new();
        self.look(now, begun, &mut admitted);
        self.accept(now, begun, &mut admitted)?;
        self.rest_after(now, Clock::local().since(begun));
        Ok(admitted)
    }

    /// Notes how long a round took that began `now`. In a short one, only a few members connect.
    fn rest_after(&mut self, now: PhysicalTime, took: Nanos) {
        if self.is_busy && took > ROUND / 2 {
            self.rests_until = self.rests_until.max(Some(now.plus(took * (1 + REST))));
        }
    }

    /// Looks at the pending links, as far as there is time.
    fn look(&mut self, now: PhysicalTime, begun: PhysicalTime, admitted: &mut Vec<(Link, Frame)>) {
        self.pending.visit(|waiting| {
            if now < waiting.until && Clock::local().since(begun) > ROUND {
                return Some(waiting);
            }
            progress(waiting, now, admitted)
        });
    }

    fn accept(
        &mut self,
        now: PhysicalTime,
        begun: PhysicalTime,
        admitted: &mut Vec<(Link, Frame)>,
    ) -> io::Result<()> {
        let Self { listeners, pending, purpose, keys, members, .. } = self;
        let mut limits = None;
        for listener in listeners {
            // The round ends however many clients connect: members get their turn, too.
            while Clock::local().since(begun) <= ROUND {
                let link = match listener.accept(*purpose, keys) {
                    Ok(Some(link)) => link,
                    Ok(None) => break,
                    Err(error) if descriptors::is_shortage(&error) => {
                        if pending.hang_up() {
                            continue;
                        }
                        self.rests_until = Some(now.plus(SHORTAGE));
                        return Ok(());
                    }
                    Err(error) => return Err(error),
                };
                let origin = LinkOrigin::of(&link);
                // The first frame has often come together with the connection.
                let waiting = PendingLink {
                    link,
                    id: SourceId::new(),
                    until: now.plus(FIRST_FRAME_TIMEOUT),
                    origin,
                };
                let Some(waiting) = progress(waiting, now, admitted) else { continue };
                pending.push(waiting);
                let free = || descriptors::left() + pending.unproved();
                pending.make_room(*limits.get_or_insert_with(|| limits_for(*members, free())));
            }
        }
        Ok(())
    }

    /// What a loop has to wait for.
    pub(crate) fn sources(&self) -> impl Iterator<Item = Source<'_>> {
        let listeners = self.listeners.iter().zip(&self.listener_ids).map(|(listener, id)| {
            Source::new(*id, Interest { fd: listener.as_fd(), write: false })
        });
        let waiting = self.pending.iter().map(|waiting| {
            let write = waiting.link.has_outbound();
            Source::new(waiting.id, Interest { fd: waiting.link.as_fd(), write })
        });
        listeners.chain(waiting).filter(|_| self.rests_until.is_none())
    }

    /// When a link has taken too long, or links are looked at again, by the local clock.
    pub(crate) fn next_wakeup(&self) -> Option<PhysicalTime> {
        self.rests_until.or_else(|| self.pending.iter().map(|waiting| waiting.until).min())
    }
}

/// How many links may be pending in a process that expects `members`, and that could open `free`
/// descriptors if there were no unauthenticated clients.
fn limits_for(members: usize, free: usize) -> PendingLimits {
    // One for each stage: otherwise no link is accepted.
    let most = (free / SHARE_OF_DESCRIPTORS / 2).max(1);
    PendingLimits {
        unproved: members.max(MOST_UNPROVED).min(most),
        from_one: members.max(FROM_ONE).min(most),
        proved: (2 * members).max(PROVED),
    }
}

/// Continues with a pending link. Returns it if it stays pending. A link that breaks, or takes too long, is
/// closed without a failure.
fn progress(
    mut waiting: PendingLink,
    now: PhysicalTime,
    admitted: &mut Vec<(Link, Frame)>,
) -> Option<PendingLink> {
    match first_frame(&mut waiting.link) {
        Ok(Some(frame)) => {
            admitted.push((waiting.link, frame));
            None
        }
        Ok(None) => (now < waiting.until).then_some(waiting),
        Err(NotAMember) => None,
    }
}

/// The other end does not behave like a member, or not any more.
struct NotAMember;

fn first_frame(link: &mut Link) -> Result<Option<Frame>, NotAMember> {
    loop {
        let arrival = link.read().map_err(|_| NotAMember)?;
        link.flush().map_err(|_| NotAMember)?;
        if let Some((frame, _)) = link.next_frame().map_err(|_| NotAMember)? {
            return Ok(Some(frame));
        }
        match arrival {
            Arrival::Bytes | Arrival::LastBytes => {}
            Arrival::Nothing => return Ok(None),
            Arrival::Closed => return Err(NotAMember),
        }
    }
}

#[cfg(test)]
mod tests;
