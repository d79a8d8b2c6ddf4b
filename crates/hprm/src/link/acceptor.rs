//! Accepts links, and keeps them until their first frame has arrived.
//!
//! A link is handed over with its first frame, and the loop decides about it. One that sends nothing, or
//! something else, is closed and costs little until then; no loop waits for it. The number of pending links
//! is bounded, also by the descriptors of the process: [`pending`] selects which are closed. Unauthenticated
//! clients never cause a failure of the process, and while the federation runs they get a share of its time
//! and no more.

mod pending;

use std::io;
use std::os::fd::AsFd;

use hprm_core::{Nanos, PhysicalTime};
use hprm_federated::Frame;

use self::pending::{Origin, PendingLinks, Places, Waiting};
use super::{Address, Arrival, Keys, Purpose, descriptors};
use crate::Clock;
use crate::wait::Interest;
use crate::wire::{Gate, Wire};

/// How long a link may take to its first frame.
const PATIENCE: Nanos = 10_000_000_000;

/// The most unauthenticated clients in one stage, and from one address, unless more federates join.
const MOST_UNPROVED: usize = 32;
const FROM_ONE: usize = 16;

/// The most links that are authenticated and have sent no frame, unless more federates join.
const PROVED: usize = 64;

/// Unauthenticated clients take no more than one of so many descriptors that are left.
const SHARE_OF_DESCRIPTORS: usize = 4;

/// How long one round may take, give or take one link.
const ROUND: Nanos = 2_000_000;

/// While the federation runs, pending links wait so many times as long as the last round took.
const REST: Nanos = 3;

/// How long to wait if no descriptor is left, and no unauthenticated client has one.
const SHORTAGE: Nanos = 100_000_000;

/// See the module.
#[derive(Debug)]
pub(crate) struct LinkAcceptor {
    gates: Vec<Gate>,
    pending: PendingLinks,
    purpose: Purpose,
    keys: Keys,
    /// How many federates may connect.
    members: usize,
    /// Whether this process has something else to do.
    is_busy: bool,
    /// Links are not looked at before, by the local clock.
    rests_until: Option<PhysicalTime>,
}

impl LinkAcceptor {
    /// An acceptor for so many members.
    pub(crate) fn new(gates: Vec<Gate>, purpose: Purpose, keys: Keys, members: usize) -> Self {
        let pending = PendingLinks::default();
        Self { gates, pending, purpose, keys, members, is_busy: false, rests_until: None }
    }

    /// Where it listens.
    pub(crate) fn addresses(&self) -> impl Iterator<Item = &Address> {
        self.gates.iter().map(Gate::address)
    }

    /// The federation runs: pending links get a share of the time.
    pub(crate) fn become_busy(&mut self) {
        self.is_busy = true;
    }

    /// The links whose first frame has come, with that frame. It is `now` by the local clock, which
    /// is never set.
    pub(crate) fn admit(&mut self, now: PhysicalTime) -> io::Result<Vec<(Wire, Frame)>> {
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

    /// A round that began `now` took so long. Short ones are those in which a few members connect.
    fn rest_after(&mut self, now: PhysicalTime, took: Nanos) {
        if self.is_busy && took > ROUND / 2 {
            self.rests_until = self.rests_until.max(Some(now.plus(took * (1 + REST))));
        }
    }

    /// Looks at the links that wait, as far as there is time.
    fn look(&mut self, now: PhysicalTime, begun: PhysicalTime, admitted: &mut Vec<(Wire, Frame)>) {
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
        admitted: &mut Vec<(Wire, Frame)>,
    ) -> io::Result<()> {
        let Self { gates, pending, purpose, keys, members, .. } = self;
        let mut places = None;
        for gate in gates {
            // However many come: the members have their turn, too.
            while Clock::local().since(begun) <= ROUND {
                let wire = match gate.accept(*purpose, keys) {
                    Ok(Some(wire)) => wire,
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
                let origin = Origin::of(&wire);
                // What it has to say has often come with it.
                let waiting = Waiting { wire, until: now.plus(PATIENCE), origin };
                let Some(waiting) = progress(waiting, now, admitted) else { continue };
                pending.push(waiting);
                let free = || descriptors::left() + pending.unproved();
                pending.make_room(*places.get_or_insert_with(|| places_for(*members, free())));
            }
        }
        Ok(())
    }

    /// What a loop has to wait for.
    pub(crate) fn interests(&self) -> impl Iterator<Item = Interest<'_>> {
        let gates = self.gates.iter().map(|gate| Interest { fd: gate.as_fd(), write: false });
        let waiting = self.pending.iter().map(|waiting| Interest {
            fd: waiting.wire.as_fd(),
            write: waiting.wire.has_outbound(),
        });
        gates.chain(waiting).filter(|_| self.rests_until.is_none())
    }

    /// When a link has taken too long, or links are looked at again, by the local clock.
    pub(crate) fn next_wakeup(&self) -> Option<PhysicalTime> {
        self.rests_until.or_else(|| self.pending.iter().map(|waiting| waiting.until).min())
    }
}

/// How many links may wait in a process that expects so many members, and could open so many
/// descriptors if there were no unauthenticated clients.
fn places_for(members: usize, free: usize) -> Places {
    // One for each stage: otherwise no link is accepted.
    let most = (free / SHARE_OF_DESCRIPTORS / 2).max(1);
    Places {
        unproved: members.max(MOST_UNPROVED).min(most),
        from_one: members.max(FROM_ONE).min(most),
        proved: (2 * members).max(PROVED),
    }
}

/// Goes on with a link. Returns it if it has to wait further. A link that breaks, or takes too long, is
/// dropped without a failure.
fn progress(
    mut waiting: Waiting,
    now: PhysicalTime,
    admitted: &mut Vec<(Wire, Frame)>,
) -> Option<Waiting> {
    match first_frame(&mut waiting.wire) {
        Ok(Some(frame)) => {
            admitted.push((waiting.wire, frame));
            None
        }
        Ok(None) => (now < waiting.until).then_some(waiting),
        Err(NotAMember) => None,
    }
}

/// The other end does not, or no longer, behave like a member.
struct NotAMember;

fn first_frame(link: &mut Wire) -> Result<Option<Frame>, NotAMember> {
    loop {
        let arrival = link.read().map_err(|_| NotAMember)?;
        link.flush().map_err(|_| NotAMember)?;
        if let Some((frame, _)) = link.next_frame().map_err(|_| NotAMember)? {
            return Ok(Some(frame));
        }
        match arrival {
            Arrival::Bytes | Arrival::Rest => {}
            Arrival::Nothing => return Ok(None),
            Arrival::Closed => return Err(NotAMember),
        }
    }
}

#[cfg(test)]
mod tests;
