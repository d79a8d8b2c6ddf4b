//! Links within one process, whose transport is a queue in each direction.
//!
//! The sender puts frames into the queue as they are, and writes no bytes. The descriptor of a queue can be read
//! as long as something is new in it, so a loop waits for queues as it waits for sockets.

use std::collections::{BTreeMap, VecDeque};
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use hprm_federated::Frame;
use rustix::event::{EventfdFlags, eventfd};

use crate::Address;
use crate::link::Arrival;

/// A frame, and the descriptor that it travels with.
type Item = (Frame, Option<OwnedFd>);

/// One end of a connection between two threads.
#[derive(Debug)]
pub(crate) struct QueueLink {
    inbound: Arc<Queue<Item>>,
    outbound: Arc<Queue<Item>>,
    /// Frames taken from the inbound queue that the loop has not asked for yet.
    unread: VecDeque<Item>,
    /// Frames that are not in the outbound queue yet: one notification serves all of them.
    unsent: Vec<Item>,
}

/// Accepts links at one address of this process.
#[derive(Debug)]
pub(crate) struct QueueListener {
    hub: Arc<Hub>,
    address: Address,
    arrivals: Arc<Queue<QueueLink>>,
}

/// The addresses of one process, and the listeners at them. The addresses mean nothing outside of it.
#[derive(Debug, Default)]
pub(crate) struct Hub {
    listeners: Mutex<BTreeMap<String, Arc<Queue<QueueLink>>>>,
}

/// A queue from one thread to another.
#[derive(Debug)]
struct Queue<T> {
    state: Mutex<QueueState<T>>,
    /// An eventfd, because it is one descriptor and one number, however often it is notified.
    signal: OwnedFd,
}

#[derive(Debug)]
struct QueueState<T> {
    items: VecDeque<T>,
    closed: bool,
    /// Whether the descriptor can be read, or is about to be.
    notified: bool,
}

impl Hub {
    /// Opens a listener at an address.
    pub(crate) fn listen(self: &Arc<Self>, address: &Address) -> io::Result<QueueListener> {
        let arrivals = Arc::new(Queue::new()?);
        let mut listeners = self.listeners();
        let name = address.to_string();
        if listeners.contains_key(&name) {
            return Err(io::ErrorKind::AddrInUse.into());
        }
        listeners.insert(name, Arc::clone(&arrivals));
        drop(listeners);
        Ok(QueueListener { hub: Arc::clone(self), address: address.clone(), arrivals })
    }

    /// Connects to the listener at an address.
    pub(crate) fn connect(&self, address: &Address) -> io::Result<QueueLink> {
        let listener = self.listeners().get(&address.to_string()).map(Arc::clone);
        let listener = listener.ok_or(io::ErrorKind::ConnectionRefused)?;
        let (here, there) = QueueLink::pair()?;
        listener.push([there])?;
        Ok(here)
    }

    fn listeners(&self) -> MutexGuard<'_, BTreeMap<String, Arc<Queue<QueueLink>>>> {
        self.listeners.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl QueueListener {
    pub(crate) fn address(&self) -> &Address {
        &self.address
    }

    /// The next connection, if one waits.
    pub(crate) fn accept(&self) -> Option<QueueLink> {
        self.arrivals.pop()
    }
}

impl Drop for QueueListener {
    fn drop(&mut self) {
        self.hub.listeners().remove(&self.address.to_string());
        self.arrivals.close();
        // A thread that has connected and was not answered sees its link closed.
        while self.arrivals.pop().is_some() {}
    }
}

impl AsFd for QueueListener {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.arrivals.signal.as_fd()
    }
}

impl QueueLink {
    fn pair() -> io::Result<(Self, Self)> {
        let (there, back) = (Arc::new(Queue::new()?), Arc::new(Queue::new()?));
        let end = |inbound: &Arc<_>, outbound: &Arc<_>| Self {
            inbound: Arc::clone(inbound),
            outbound: Arc::clone(outbound),
            unread: VecDeque::new(),
            unsent: Vec::new(),
        };
        Ok((end(&back, &there), end(&there, &back)))
    }

    pub(crate) fn queue(&mut self, frame: Frame, descriptor: Option<OwnedFd>) {
        self.unsent.push((frame, descriptor));
    }

    pub(crate) fn has_outbound(&self) -> bool {
        !self.unsent.is_empty()
    }

    /// Hands everything over. Fails if the other end is closed.
    pub(crate) fn flush(&mut self) -> io::Result<()> {
        if self.unsent.is_empty() {
            return Ok(());
        }
        self.outbound.push(self.unsent.drain(..))
    }

    pub(crate) fn discard(&mut self) {
        self.unsent.clear();
    }

    pub(crate) fn finish(&mut self) {
        self.outbound.close();
    }

    pub(crate) fn read(&mut self) -> Arrival {
        self.inbound.take_all(&mut self.unread)
    }

    pub(crate) fn next_frame(&mut self) -> Option<Item> {
        self.unread.pop_front()
    }

    /// Throws away what comes. Returns whether the other end is still open.
    pub(crate) fn is_open(&mut self) -> bool {
        while self.read() == Arrival::LastBytes {}
        self.unread.clear();
        self.read() != Arrival::Closed
    }
}

impl Drop for QueueLink {
    fn drop(&mut self) {
        self.outbound.close();
        self.inbound.close();
    }
}

impl AsFd for QueueLink {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.inbound.signal.as_fd()
    }
}

impl<T> Queue<T> {
    fn new() -> io::Result<Self> {
        let signal = eventfd(0, EventfdFlags::NONBLOCK | EventfdFlags::CLOEXEC)?;
        let state = QueueState { items: VecDeque::new(), closed: false, notified: false };
        Ok(Self { state: Mutex::new(state), signal })
    }

    /// Adds items. Fails if the queue is closed.
    fn push(&self, items: impl IntoIterator<Item = T>) -> io::Result<()> {
        let mut state = self.state();
        if state.closed {
            return Err(io::ErrorKind::BrokenPipe.into());
        }
        state.items.extend(items);
        self.notify(state);
        Ok(())
    }

    fn pop(&self) -> Option<T> {
        let mut state = self.state();
        let item = state.items.pop_front();
        if state.items.is_empty() && !state.closed {
            self.clear(&mut state);
        }
        item
    }

    /// Moves everything to the end of `taken`.
    fn take_all(&self, taken: &mut VecDeque<T>) -> Arrival {
        let mut state = self.state();
        let empty = state.items.is_empty();
        taken.append(&mut state.items);
        // The descriptor of a closed queue stays readable until the reader has dropped the queue.
        if !state.closed {
            self.clear(&mut state);
        }
        match (empty, state.closed) {
            (false, _) => Arrival::LastBytes,
            (true, false) => Arrival::Nothing,
            (true, true) => Arrival::Closed,
        }
    }

    fn close(&self) {
        let mut state = self.state();
        state.closed = true;
        self.notify(state);
    }

    /// Notifies the reader once the lock is free: the thread that wakes up takes the lock at once.
    fn notify(&self, mut state: MutexGuard<'_, QueueState<T>>) {
        let is_first = !std::mem::replace(&mut state.notified, true);
        drop(state);
        if is_first {
            // Fails only if the number is at its limit, and then the descriptor can be read.
            let _ = rustix::io::write(&self.signal, &1_u64.to_ne_bytes());
        }
    }

    fn clear(&self, state: &mut QueueState<T>) {
        // The read fails if the writer has not notified yet: then a later read has to clear the descriptor.
        if state.notified && rustix::io::read(&self.signal, &mut [0; 8]).is_ok() {
            state.notified = false;
        }
    }

    fn state(&self) -> MutexGuard<'_, QueueState<T>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use hprm_federated::Frame;

    use super::{Hub, QueueLink};
    use crate::Address;
    use crate::link::Arrival;
    use crate::wait::{Interest, wait};
    use hprm_core::PhysicalTime;
    use std::os::fd::AsFd;

    /// Whether a loop that waits for this would wake up at once.
    fn is_notified(what: &impl AsFd) -> bool {
        wait(&[Interest { fd: what.as_fd(), write: false }], Some(PhysicalTime(0)))[0].is_ready()
    }

    fn address(name: &str) -> Address {
        format!("unix:@{name}").parse().unwrap()
    }

    #[test]
    fn frames_arrive_in_order_behind_one_notification() {
        let (mut here, mut there) = QueueLink::pair().unwrap();
        assert!(!is_notified(&there));
        here.queue(Frame::Resign, None);
        here.queue(Frame::Resign, None);
        assert!(here.has_outbound() && !is_notified(&there));
        here.flush().unwrap();
        assert!(!here.has_outbound() && is_notified(&there));
        assert_eq!(there.read(), Arrival::LastBytes);
        assert!(!is_notified(&there));
        assert_eq!(there.next_frame().map(|(frame, _)| frame), Some(Frame::Resign));
        assert_eq!(there.next_frame().map(|(frame, _)| frame), Some(Frame::Resign));
        assert!(there.next_frame().is_none());
        assert_eq!(there.read(), Arrival::Nothing);
    }

    #[test]
    fn frames_sent_before_the_end_arrive() {
        let (mut here, mut there) = QueueLink::pair().unwrap();
        here.queue(Frame::Resign, None);
        here.flush().unwrap();
        drop(here);
        assert!(is_notified(&there));
        assert_eq!(there.read(), Arrival::LastBytes);
        assert_eq!(there.read(), Arrival::Closed);
        assert!(is_notified(&there), "the end can be noticed at any later time");
        there.queue(Frame::Resign, None);
        assert!(there.flush().is_err());
    }

    #[test]
    fn a_listener_is_found_by_its_name_as_long_as_it_is_there() {
        let hub = Arc::new(Hub::default());
        assert!(hub.connect(&address("rti")).is_err());
        let listener = hub.listen(&address("rti")).unwrap();
        assert!(hub.listen(&address("rti")).is_err(), "a name is taken once");
        let mut answered = hub.connect(&address("rti")).unwrap();
        assert!(is_notified(&listener));
        let _served = listener.accept().unwrap();
        assert!(listener.accept().is_none() && !is_notified(&listener));
        let mut ignored = hub.connect(&address("rti")).unwrap();
        drop(listener);
        assert_eq!(answered.read(), Arrival::Nothing);
        assert_eq!(ignored.read(), Arrival::Closed);
        assert!(hub.connect(&address("rti")).is_err());
    }
}
