//! Links within one process: frames are handed over as they are, and nothing is written or read.
//!
//! A lane goes in one direction. Its descriptor can be read as long as something is new in it, so a
//! loop waits for lanes as it waits for sockets.

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
pub(crate) struct MemoryLink {
    inbound: Arc<Lane<Item>>,
    outbound: Arc<Lane<Item>>,
    /// Taken from the lane, and not asked for yet.
    unread: VecDeque<Item>,
    /// Not in the lane yet: one ring is for all of them.
    unsent: Vec<Item>,
}

/// Where others connect.
#[derive(Debug)]
pub(crate) struct MemoryGate {
    hub: Arc<Hub>,
    address: Address,
    arrivals: Arc<Lane<MemoryLink>>,
}

/// The addresses of one process. They mean nothing outside of it.
#[derive(Debug, Default)]
pub(crate) struct Hub {
    gates: Mutex<BTreeMap<String, Arc<Lane<MemoryLink>>>>,
}

/// A queue from one thread to another.
#[derive(Debug)]
struct Lane<T> {
    state: Mutex<LaneState<T>>,
    /// An eventfd, because it is one descriptor and one number, however often it is rung.
    signal: OwnedFd,
}

#[derive(Debug)]
struct LaneState<T> {
    items: VecDeque<T>,
    closed: bool,
    /// Whether the descriptor can be read, or is about to be.
    rung: bool,
}

impl Hub {
    /// Opens a gate.
    pub(crate) fn listen(self: &Arc<Self>, address: &Address) -> io::Result<MemoryGate> {
        let arrivals = Arc::new(Lane::new()?);
        let mut gates = self.gates();
        let name = address.to_string();
        if gates.contains_key(&name) {
            return Err(io::ErrorKind::AddrInUse.into());
        }
        gates.insert(name, Arc::clone(&arrivals));
        drop(gates);
        Ok(MemoryGate { hub: Arc::clone(self), address: address.clone(), arrivals })
    }

    /// Connects to a gate.
    pub(crate) fn connect(&self, address: &Address) -> io::Result<MemoryLink> {
        let gate = self.gates().get(&address.to_string()).map(Arc::clone);
        let gate = gate.ok_or(io::ErrorKind::ConnectionRefused)?;
        let (here, there) = MemoryLink::pair()?;
        gate.push([there])?;
        Ok(here)
    }

    fn gates(&self) -> MutexGuard<'_, BTreeMap<String, Arc<Lane<MemoryLink>>>> {
        self.gates.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl MemoryGate {
    pub(crate) fn address(&self) -> &Address {
        &self.address
    }

    /// The next connection, if one waits.
    pub(crate) fn accept(&self) -> Option<MemoryLink> {
        self.arrivals.pop()
    }
}

impl Drop for MemoryGate {
    fn drop(&mut self) {
        self.hub.gates().remove(&self.address.to_string());
        self.arrivals.close();
        // Whoever has connected and was not answered learns that nobody will.
        while self.arrivals.pop().is_some() {}
    }
}

impl AsFd for MemoryGate {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.arrivals.signal.as_fd()
    }
}

impl MemoryLink {
    fn pair() -> io::Result<(Self, Self)> {
        let (there, back) = (Arc::new(Lane::new()?), Arc::new(Lane::new()?));
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
        while self.read() == Arrival::Rest {}
        self.unread.clear();
        self.read() != Arrival::Closed
    }
}

impl Drop for MemoryLink {
    fn drop(&mut self) {
        self.outbound.close();
        self.inbound.close();
    }
}

impl AsFd for MemoryLink {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.inbound.signal.as_fd()
    }
}

impl<T> Lane<T> {
    fn new() -> io::Result<Self> {
        let signal = eventfd(0, EventfdFlags::NONBLOCK | EventfdFlags::CLOEXEC)?;
        let state = LaneState { items: VecDeque::new(), closed: false, rung: false };
        Ok(Self { state: Mutex::new(state), signal })
    }

    /// Adds items. Fails if the lane is closed.
    fn push(&self, items: impl IntoIterator<Item = T>) -> io::Result<()> {
        let mut state = self.state();
        if state.closed {
            return Err(io::ErrorKind::BrokenPipe.into());
        }
        state.items.extend(items);
        self.ring(state);
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
        // A closed lane goes on ringing until its reader has let go of it.
        if !state.closed {
            self.clear(&mut state);
        }
        match (empty, state.closed) {
            (false, _) => Arrival::Rest,
            (true, false) => Arrival::Nothing,
            (true, true) => Arrival::Closed,
        }
    }

    fn close(&self) {
        let mut state = self.state();
        state.closed = true;
        self.ring(state);
    }

    /// Rings once the lock is free: whoever wakes up takes it at once.
    fn ring(&self, mut state: MutexGuard<'_, LaneState<T>>) {
        let silent = !std::mem::replace(&mut state.rung, true);
        drop(state);
        if silent {
            // Fails only if the number is at its limit, and then it can be read.
            let _ = rustix::io::write(&self.signal, &1_u64.to_ne_bytes());
        }
    }

    fn clear(&self, state: &mut LaneState<T>) {
        // It fails if the ring is still to come: then somebody has to silence it later.
        if state.rung && rustix::io::read(&self.signal, &mut [0; 8]).is_ok() {
            state.rung = false;
        }
    }

    fn state(&self) -> MutexGuard<'_, LaneState<T>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use hprm_federated::Frame;

    use super::{Hub, MemoryLink};
    use crate::Address;
    use crate::link::Arrival;
    use crate::wait::{Interest, wait};
    use hprm_core::PhysicalTime;
    use std::os::fd::AsFd;

    /// Whether a loop that waits for this would wake up at once.
    fn rings(what: &impl AsFd) -> bool {
        wait(&[Interest { fd: what.as_fd(), write: false }], Some(PhysicalTime(0)))[0].is_ready()
    }

    fn address(name: &str) -> Address {
        format!("unix:@{name}").parse().unwrap()
    }

    #[test]
    fn frames_arrive_in_order_behind_one_ring() {
        let (mut here, mut there) = MemoryLink::pair().unwrap();
        assert!(!rings(&there));
        here.queue(Frame::Resign, None);
        here.queue(Frame::Resign, None);
        assert!(here.has_outbound() && !rings(&there));
        here.flush().unwrap();
        assert!(!here.has_outbound() && rings(&there));
        assert_eq!(there.read(), Arrival::Rest);
        assert!(!rings(&there));
        assert_eq!(there.next_frame().map(|(frame, _)| frame), Some(Frame::Resign));
        assert_eq!(there.next_frame().map(|(frame, _)| frame), Some(Frame::Resign));
        assert!(there.next_frame().is_none());
        assert_eq!(there.read(), Arrival::Nothing);
    }

    #[test]
    fn what_was_said_before_the_end_is_heard() {
        let (mut here, mut there) = MemoryLink::pair().unwrap();
        here.queue(Frame::Resign, None);
        here.flush().unwrap();
        drop(here);
        assert!(rings(&there));
        assert_eq!(there.read(), Arrival::Rest);
        assert_eq!(there.read(), Arrival::Closed);
        assert!(rings(&there), "the end can be noticed at any later time");
        there.queue(Frame::Resign, None);
        assert!(there.flush().is_err());
    }

    #[test]
    fn a_gate_is_found_by_its_name_as_long_as_it_is_there() {
        let hub = Arc::new(Hub::default());
        assert!(hub.connect(&address("rti")).is_err());
        let gate = hub.listen(&address("rti")).unwrap();
        assert!(hub.listen(&address("rti")).is_err(), "a name is taken once");
        let mut answered = hub.connect(&address("rti")).unwrap();
        assert!(rings(&gate));
        let _served = gate.accept().unwrap();
        assert!(gate.accept().is_none() && !rings(&gate));
        let mut ignored = hub.connect(&address("rti")).unwrap();
        drop(gate);
        assert_eq!(answered.read(), Arrival::Nothing);
        assert_eq!(ignored.read(), Arrival::Closed);
        assert!(hub.connect(&address("rti")).is_err());
    }
}
