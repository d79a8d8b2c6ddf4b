//! What the loop of an agent waits for: descriptors, a mark that other tasks and threads set, and time.
//!
//! The loop is a task of the runtime in which Zenoh reads and writes its connections (`threads.rs`). So what comes from another
//! machine and is for a process here, and what a process sends to another machine, passes through one thread. Each
//! other thread that had to wake up for it would take longer than all that is done with it.
//!
//! In turn nothing here may wait, but where it says so ([`may_block`]): while it waits, Zenoh would neither read nor write.

use std::future::pending;
use std::io;
use std::mem::MaybeUninit;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::sync::Arc;
use std::time::Duration;

use hprm::Clock;
use hprm_core::PhysicalTime;
use rustix::event::Timespec;
use rustix::event::epoll::{self, CreateFlags, Event, EventData, EventFlags};
use tokio::io::Interest;
use tokio::io::unix::AsyncFd;
use tokio::sync::Notify;

/// How many descriptors are told to be ready at once; others are told the next time.
const EVENTS: usize = 256;

/// See the module.
pub(crate) struct Waiting {
    epoll: Arc<OwnedFd>,
    /// The same, for the runtime: it can be read while a descriptor is ready.
    readable: AsyncFd<Arc<OwnedFd>>,
    mark: Mark,
    watches: u64,
}

/// What ends the wait of the loop, from any thread.
#[derive(Clone, Default)]
pub(crate) struct Mark(Arc<Notify>);

/// The number of an object for which the loop waits.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(crate) struct Token(u64);

/// An object for which the loop waits: with it come its descriptors.
#[derive(Clone)]
pub(crate) struct Watch {
    epoll: Arc<OwnedFd>,
    token: Token,
}

/// The place of one descriptor among those that the loop waits for. The one that owns both takes it out before it closes the descriptor:
/// another process may have that, too, and the kernel would tell of it for ever.
pub(crate) struct Registration {
    epoll: Arc<OwnedFd>,
    token: Token,
    flags: EventFlags,
}

impl Waiting {
    /// Waits for nothing yet. To be called in the runtime.
    pub(crate) fn new() -> io::Result<Self> {
        let epoll = Arc::new(epoll::create(CreateFlags::CLOEXEC)?);
        #[expect(
            deprecated,
            reason = "it relies on a descriptor that stays open, which an owned one does"
        )]
        let readable = AsyncFd::with_interest(Arc::clone(&epoll), Interest::READABLE)?;
        Ok(Self { epoll, readable, mark: Mark::default(), watches: 0 })
    }

    pub(crate) fn mark(&self) -> Mark {
        self.mark.clone()
    }

    /// For a new object.
    pub(crate) fn watch(&mut self) -> Watch {
        self.watches += 1;
        Watch { epoll: Arc::clone(&self.epoll), token: Token(self.watches) }
    }

    /// Waits until a descriptor is ready, the loop is marked, or `until` has come. Returns whose are ready. Zenoh first
    /// does what it has to do.
    pub(crate) async fn wait(&mut self, until: PhysicalTime) -> io::Result<Vec<Token>> {
        tokio::task::yield_now().await;
        loop {
            let ready = ready(&self.epoll)?;
            if !ready.is_empty() {
                return Ok(ready);
            }
            tokio::select! {
                biased;
                () = self.mark.0.notified() => return Ok(ready),
                readable = self.readable.readable() => readable?.clear_ready(),
                () = sleep(until) => return Ok(ready),
            }
        }
    }
}

async fn sleep(until: PhysicalTime) {
    if until == PhysicalTime::FOREVER {
        return pending().await;
    }
    let nanos = until.since(Clock::local()).max(0).unsigned_abs();
    tokio::time::sleep(Duration::from_nanos(nanos)).await;
}

/// Whose descriptors are ready now.
fn ready(epoll: &OwnedFd) -> io::Result<Vec<Token>> {
    let mut events = [MaybeUninit::<Event>::uninit(); EVENTS];
    let now = Timespec { tv_sec: 0, tv_nsec: 0 };
    let (events, _) = epoll::wait(epoll, &mut events[..], Some(&now))?;
    let mut ready: Vec<_> = events.iter().map(|event| Token(event.data.u64())).collect();
    ready.sort_unstable();
    ready.dedup();
    Ok(ready)
}

impl Mark {
    /// Ends the wait, or the next one if there is none now.
    pub(crate) fn set(&self) {
        self.0.notify_one();
    }
}

impl Watch {
    pub(crate) fn token(&self) -> Token {
        self.token
    }

    /// A place for one descriptor.
    pub(crate) fn register(&self) -> Registration {
        let Self { epoll, token } = self;
        Registration { epoll: Arc::clone(epoll), token: *token, flags: EventFlags::empty() }
    }

    /// Waits until this can be read, as long as it is there.
    pub(crate) fn until_readable<T: AsFd>(&self, inner: T) -> io::Result<Watched<T>> {
        let mut registration = self.register();
        registration.set(inner.as_fd(), EventFlags::IN)?;
        Ok(Watched { inner, registration })
    }
}

impl Registration {
    /// Waits for that at the descriptor from now on, which is always the same one; for nothing if there are no flags.
    pub(crate) fn set(&mut self, fd: BorrowedFd<'_>, flags: EventFlags) -> io::Result<()> {
        if flags == self.flags {
            return Ok(());
        }
        let data = EventData::new_u64(self.token.0);
        match (self.flags.is_empty(), flags.is_empty()) {
            (true, _) => epoll::add(&*self.epoll, fd, data, flags)?,
            (false, false) => epoll::modify(&*self.epoll, fd, data, flags)?,
            (false, true) => epoll::delete(&*self.epoll, fd)?,
        }
        self.flags = flags;
        Ok(())
    }
}

/// What the loop waits for until it can be read, as long as it has it.
pub(crate) struct Watched<T: AsFd> {
    inner: T,
    registration: Registration,
}

impl<T: AsFd> Watched<T> {
    pub(crate) fn token(&self) -> Token {
        self.registration.token
    }

    pub(crate) fn get(&self) -> &T {
        &self.inner
    }

    /// Waits for it, or does not for the moment.
    pub(crate) fn set(&mut self, waits: bool) -> io::Result<()> {
        let flags = if waits { EventFlags::IN } else { EventFlags::empty() };
        self.registration.set(self.inner.as_fd(), flags)
    }

    /// Waits for it no longer.
    pub(crate) fn into_inner(mut self) -> T {
        // It fails only where nothing is waited for.
        let _ = self.set(false);
        self.inner
    }
}

/// Does what may wait, while Zenoh goes on in another thread. That costs more than most things that do not wait.
pub(crate) fn may_block<T>(work: impl FnOnce() -> T) -> T {
    tokio::task::block_in_place(work)
}

#[cfg(test)]
mod tests {
    use std::io::Write;
    use std::os::unix::net::UnixStream;
    use std::thread;

    use tokio::runtime::{Builder, Runtime};

    use super::*;

    fn begin() -> (Runtime, Waiting) {
        let runtime = Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap();
        let waiting = runtime.block_on(async { Waiting::new().unwrap() });
        (runtime, waiting)
    }

    fn soon() -> PhysicalTime {
        Clock::local().plus(20_000_000)
    }

    #[test]
    fn the_wait_ends_when_a_descriptor_is_ready_or_the_loop_is_marked_or_in_time() {
        let (runtime, mut waiting) = begin();
        let (mut far, near) = UnixStream::pair().unwrap();
        let near = waiting.watch().until_readable(near).unwrap();
        let mut wait = |until| runtime.block_on(waiting.wait(until)).unwrap();
        assert_eq!(wait(soon()), []);
        let writer = thread::spawn(move || {
            thread::sleep(Duration::from_millis(10));
            far.write_all(&[1]).unwrap();
            far
        });
        assert_eq!(wait(PhysicalTime::FOREVER), [near.token()]);
        // It is told as long as it is so.
        assert_eq!(wait(PhysicalTime::FOREVER), [near.token()]);
        let _far = writer.join().unwrap();
        drop(near);
        assert_eq!(wait(soon()), []);
        let mark = waiting.mark();
        let marker = thread::spawn(move || mark.set());
        assert_eq!(runtime.block_on(waiting.wait(PhysicalTime::FOREVER)).unwrap(), []);
        marker.join().unwrap();
    }

    #[test]
    fn a_mark_before_the_wait_ends_it() {
        let (runtime, mut waiting) = begin();
        waiting.mark().set();
        assert_eq!(runtime.block_on(waiting.wait(PhysicalTime::FOREVER)).unwrap(), []);
    }

    #[test]
    fn what_is_not_waited_for_any_more_is_not_told_though_another_one_has_the_descriptor() {
        let (runtime, mut waiting) = begin();
        let (mut far, near) = UnixStream::pair().unwrap();
        far.write_all(&[1]).unwrap();
        let copy = near.try_clone().unwrap();
        let mut near = waiting.watch().until_readable(near).unwrap();
        near.set(false).unwrap();
        assert_eq!(runtime.block_on(waiting.wait(soon())).unwrap(), []);
        near.set(true).unwrap();
        assert_eq!(runtime.block_on(waiting.wait(soon())).unwrap(), [near.token()]);
        drop(near.into_inner());
        assert_eq!(runtime.block_on(waiting.wait(soon())).unwrap(), []);
        drop(copy);
    }

    #[test]
    fn all_are_told_though_there_are_more_than_are_told_at_once() {
        let (runtime, mut waiting) = begin();
        let mut pairs = Vec::new();
        for _ in 0..EVENTS + 10 {
            let (mut far, near) = UnixStream::pair().unwrap();
            far.write_all(&[1]).unwrap();
            pairs.push((far, Some(waiting.watch().until_readable(near).unwrap())));
        }
        let mut told = 0;
        while told < pairs.len() {
            let ready = runtime.block_on(waiting.wait(PhysicalTime::FOREVER)).unwrap();
            told += ready.len();
            for (_, near) in &mut pairs {
                near.take_if(|near| ready.contains(&near.token()));
            }
        }
    }

    #[test]
    fn tasks_of_the_runtime_run_while_one_blocks() {
        let (runtime, _waiting) = begin();
        let (sender, receiver) = std::sync::mpsc::channel();
        let blocked = runtime.spawn(async move { may_block(|| receiver.recv().unwrap()) });
        runtime.spawn(async move { sender.send(7).unwrap() });
        assert_eq!(runtime.block_on(blocked).unwrap(), 7);
    }
}
