//! The descriptors that a loop waits for, registered with the kernel: waiting then costs the same however many
//! they are. What to register is up to the [`Poller`](super::Poller).
//!
//! Where the kernel or the limits of the process do not permit that, the set polls the descriptors instead.

use std::mem::MaybeUninit;
use std::os::fd::{AsRawFd, OwnedFd, RawFd};

use hprm_core::PhysicalTime;
use rustix::event::epoll::{self, CreateFlags, Event, EventData, EventFlags};
use rustix::io::{Errno, Result};

use crate::wait::{Few, Interests, Readiness, Ready, Source, SourceId, timeout, wait};

/// What a loop waits for with epoll, or with poll if there is no epoll.
#[derive(Debug)]
pub(super) enum EpollSet {
    /// Nothing is registered yet.
    Empty,
    /// These sources are registered, in this order; an event contains the position of its source.
    Registered { epoll: OwnedFd, sources: Vec<Registration> },
    /// There is no epoll.
    Unavailable,
}

/// A source as it is registered.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Registration {
    id: SourceId,
    /// The number of its descriptor. A closed descriptor may have left its number to another one, so the number
    /// does not identify the source.
    fd: RawFd,
    write: bool,
    once: bool,
}

impl Registration {
    fn of(source: &Source<'_>) -> Self {
        let Source { id, interest, once } = source;
        Self { id: *id, fd: interest.fd.as_raw_fd(), write: interest.write, once: *once }
    }

    fn flags(self) -> EventFlags {
        let write = if self.write { EventFlags::OUT } else { EventFlags::empty() };
        let once = if self.once { EventFlags::ET } else { EventFlags::empty() };
        EventFlags::IN | write | once
    }
}

impl EpollSet {
    /// Waits until a source is ready, `until` has come, or a signal arrives. Returns which are ready: all that
    /// were when the wait ended.
    pub(super) fn wait(
        &mut self,
        sources: &[Source<'_>],
        until: Option<PhysicalTime>,
    ) -> Readiness {
        match self.try_wait(sources, until) {
            Ok(ready) => ready,
            Err(Errno::INTR) => Few::from_elem(Ready::NOT, sources.len()),
            Err(_) => {
                // Its descriptor becomes free, too.
                *self = Self::Unavailable;
                let interests: Interests<'_> = sources.iter().map(|it| it.interest).collect();
                wait(&interests, until)
            }
        }
    }

    /// Whether a notifier that has not been read is ready only when it is notified again.
    pub(super) fn tells_once(&self) -> bool {
        matches!(self, Self::Registered { .. })
    }

    fn try_wait(
        &mut self,
        sources: &[Source<'_>],
        until: Option<PhysicalTime>,
    ) -> Result<Readiness> {
        let epoll = self.registered(sources)?;
        // Room for all: the loop relies on hearing of everything that has come by now.
        let mut events: Few<MaybeUninit<Event>> = Few::new();
        events.resize_with(sources.len(), MaybeUninit::uninit);
        let (events, _) = epoll::wait(epoll, events.as_mut_slice(), timeout(until).as_ref())?;
        let mut ready = Few::from_elem(Ready::NOT, sources.len());
        for event in events {
            let (position, flags) = (event.data.u64(), event.flags);
            ready[position as usize] = Ready::of(flags.bits());
        }
        Ok(ready)
    }

    /// The epoll instance with these sources, and no others.
    fn registered(&mut self, wanted: &[Source<'_>]) -> Result<&OwnedFd> {
        if !self.has(wanted) {
            self.register(wanted)?;
        }
        match self {
            Self::Registered { epoll, .. } => Ok(epoll),
            Self::Empty | Self::Unavailable => Err(Errno::NOSYS),
        }
    }

    fn has(&self, wanted: &[Source<'_>]) -> bool {
        let Self::Registered { sources, .. } = self else { return false };
        sources.iter().copied().eq(wanted.iter().map(Registration::of))
    }

    fn register(&mut self, wanted: &[Source<'_>]) -> Result<()> {
        let new: Vec<_> = wanted.iter().map(Registration::of).collect();
        match self {
            Self::Unavailable => return Err(Errno::NOSYS),
            Self::Registered { epoll, sources } if are_same(sources, &new) => {
                for (position, source) in wanted.iter().enumerate() {
                    if sources[position].write != source.interest.write {
                        let data = EventData::new_u64(position as u64);
                        epoll::modify(&*epoll, source.interest.fd, data, new[position].flags())?;
                    }
                }
                *sources = new;
                return Ok(());
            }
            Self::Empty | Self::Registered { .. } => {}
        }
        // Sources have come or gone, which is rare. A new instance cannot hold what a closed descriptor has left
        // behind: a process that a reaction has forked may keep it open.
        *self = Self::Empty;
        let epoll = epoll::create(CreateFlags::CLOEXEC)?;
        for (position, source) in wanted.iter().enumerate() {
            let data = EventData::new_u64(position as u64);
            epoll::add(&epoll, source.interest.fd, data, new[position].flags())?;
        }
        *self = Self::Registered { epoll, sources: new };
        Ok(())
    }
}

/// Whether these are the same sources, each perhaps waited for in another way.
fn are_same(old: &[Registration], new: &[Registration]) -> bool {
    let source = |it: &Registration| (it.id, it.fd);
    old.iter().map(source).eq(new.iter().map(source))
}

#[cfg(test)]
mod tests;
