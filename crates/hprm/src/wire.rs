//! Wires: links as the loops use them, whether they lead to another process or to another thread.
//!
//! [`Link`] is a socket, [`MemoryLink`] a queue of this process. A [`Network`] is where addresses
//! mean something, so it makes one or the other.

mod memory;

use std::io;
use std::net::SocketAddr;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::sync::Arc;

use hprm_federated::Frame;
use hprm_federated::codec::CodecError;

use crate::Address;
use crate::link::{Arrival, Keys, Link, Listener, Purpose};
use crate::notifier::Notifier;
use crate::wait::Deadline;
pub(crate) use memory::Hub;
use memory::{MemoryGate, MemoryLink};

/// One end of a connection to the RTI or to another federate.
#[derive(Debug)]
pub(crate) enum Wire {
    Socket(Link),
    Memory(MemoryLink),
}

/// Where others connect.
#[derive(Debug)]
pub(crate) enum Gate {
    Socket(Listener, Notifier),
    Memory(MemoryGate),
}

/// Where addresses mean something.
#[derive(Clone, Debug)]
pub(crate) enum Network {
    /// On this machine, and beyond. Processes that share memory with this one notify it.
    Sockets(Notifier),
    /// In this process.
    Process(Arc<Hub>),
}

impl Network {
    /// This machine, and beyond.
    pub(crate) fn sockets() -> io::Result<Self> {
        Notifier::new().map(Self::Sockets)
    }

    /// By which processes that share memory with this one notify it.
    pub(crate) fn notifier(&self) -> Option<&Notifier> {
        match self {
            Self::Sockets(notifier) => Some(notifier),
            Self::Process(_) => None,
        }
    }

    /// Connects to an address at which a process listens, by the deadline at the latest.
    pub(crate) fn connect(
        &self,
        address: &Address,
        purpose: Purpose,
        keys: &Keys,
        deadline: Deadline,
    ) -> io::Result<Wire> {
        match self {
            Self::Sockets(notifier) => {
                Link::connect(address, purpose, keys, notifier, deadline).map(Wire::Socket)
            }
            Self::Process(hub) => hub.connect(address).map(Wire::Memory),
        }
    }

    /// Listens at an address.
    pub(crate) fn listen(&self, address: &Address) -> io::Result<Gate> {
        match self {
            Self::Sockets(notifier) => {
                Listener::bind(address).map(|listener| Gate::Socket(listener, notifier.clone()))
            }
            Self::Process(hub) => hub.listen(address).map(Gate::Memory),
        }
    }
}

impl Gate {
    /// Where it listens; a port of zero has become a real one.
    pub(crate) fn address(&self) -> &Address {
        match self {
            Self::Socket(listener, _) => listener.address(),
            Self::Memory(gate) => gate.address(),
        }
    }

    /// The next connection, if one waits; the process at its other end is not identified yet.
    pub(crate) fn accept(&self, purpose: Purpose, keys: &Keys) -> io::Result<Option<Wire>> {
        match self {
            Self::Socket(listener, notifier) => {
                while let Some(socket) = listener.accept()? {
                    // A connection that fails is dropped.
                    if let Ok(link) = Link::accepted(socket, purpose, keys, notifier) {
                        return Ok(Some(Wire::Socket(link)));
                    }
                }
                Ok(None)
            }
            Self::Memory(gate) => Ok(gate.accept().map(Wire::Memory)),
        }
    }
}

impl AsFd for Gate {
    fn as_fd(&self) -> BorrowedFd<'_> {
        match self {
            Self::Socket(listener, _) => listener.as_fd(),
            Self::Memory(gate) => gate.as_fd(),
        }
    }
}

impl Wire {
    /// The other end belongs to the federation.
    pub(crate) fn trust(&mut self) {
        match self {
            Self::Socket(link) => link.trust(),
            // All threads of the process belong to the federation.
            Self::Memory(_) => {}
        }
    }

    /// Whether both ends have proved what they have to.
    pub(crate) fn is_established(&self) -> bool {
        match self {
            Self::Socket(link) => link.is_established(),
            Self::Memory(_) => true,
        }
    }

    /// Whether the other end is known to be one of the same federation, or at least of the same user.
    pub(crate) fn is_proved(&self) -> bool {
        match self {
            Self::Socket(link) => link.is_proved(),
            Self::Memory(_) => true,
        }
    }

    /// Whether the other end has begun to prove that, as far as can be told.
    pub(crate) fn has_spoken(&self) -> bool {
        match self {
            Self::Socket(link) => link.has_spoken(),
            Self::Memory(_) => true,
        }
    }

    /// The address of the other end on the network.
    pub(crate) fn peer_address(&self) -> io::Result<SocketAddr> {
        match self {
            Self::Socket(link) => link.peer_address(),
            Self::Memory(_) => Err(io::ErrorKind::Unsupported.into()),
        }
    }

    /// Waits until both ends have proved what they have to, until the deadline at the latest.
    pub(crate) fn establish(&mut self, deadline: Deadline) -> io::Result<()> {
        match self {
            Self::Socket(link) => link.establish(deadline),
            Self::Memory(_) => Ok(()),
        }
    }

    /// The address of this end on the network.
    pub(crate) fn local_address(&self) -> io::Result<SocketAddr> {
        match self {
            Self::Socket(link) => link.local_address(),
            Self::Memory(_) => Err(io::ErrorKind::Unsupported.into()),
        }
    }

    /// Whether the other end is on this machine, as far as its address tells.
    pub(crate) fn is_within_host(&self) -> bool {
        match self {
            Self::Socket(link) => link.is_within_host(),
            Self::Memory(_) => true,
        }
    }

    /// Whether something has been received of which the system knows nothing any more.
    pub(crate) fn has_unread(&self) -> bool {
        match self {
            Self::Socket(link) => link.has_unread(),
            Self::Memory(_) => false,
        }
    }

    /// Whether what comes is seen without asking the system, apart from the other end's end.
    pub(crate) fn is_in_memory(&self) -> bool {
        match self {
            Self::Socket(link) => link.is_in_memory(),
            // Its descriptor tells.
            Self::Memory(_) => false,
        }
    }

    /// Announces that this process is about to sleep: a process that sends something notifies it then. It
    /// must look once more after that.
    pub(crate) fn fall_asleep(&mut self) {
        match self {
            Self::Socket(link) => link.fall_asleep(),
            Self::Memory(_) => {}
        }
    }

    /// Says that this process does not sleep any more.
    pub(crate) fn wake_up(&mut self) {
        match self {
            Self::Socket(link) => link.wake_up(),
            Self::Memory(_) => {}
        }
    }

    /// Whether something is to be written, and can be once the descriptor says so.
    pub(crate) fn waits_for_socket(&self) -> bool {
        match self {
            Self::Socket(link) => link.waits_for_socket(),
            Self::Memory(link) => link.has_outbound(),
        }
    }

    /// Whether descriptors can travel over it.
    pub(crate) fn is_local(&self) -> bool {
        match self {
            Self::Socket(link) => link.is_local(),
            Self::Memory(_) => true,
        }
    }

    /// Appends a frame to what is to be written, with the descriptor that it travels with.
    pub(crate) fn queue(&mut self, frame: Frame, descriptor: Option<OwnedFd>) {
        match self {
            Self::Socket(link) => link.queue(frame, descriptor),
            Self::Memory(link) => link.queue(frame, descriptor),
        }
    }

    /// Whether some of a message that is longer than a frame has come or left since this was asked.
    pub(crate) fn take_moved(&mut self) -> bool {
        match self {
            Self::Socket(link) => link.take_moved(),
            // A frame is there at once.
            Self::Memory(_) => false,
        }
    }

    /// How many bytes are to be written, unless the other end took no more the last time. What goes to
    /// another thread has no bytes.
    pub(crate) fn writable_len(&self) -> usize {
        match self {
            Self::Socket(link) => link.writable_len(),
            Self::Memory(_) => 0,
        }
    }

    /// Whether something is still to be written.
    pub(crate) fn has_outbound(&self) -> bool {
        match self {
            Self::Socket(link) => link.has_outbound(),
            Self::Memory(link) => link.has_outbound(),
        }
    }

    /// Writes as much as the other end takes.
    pub(crate) fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Socket(link) => link.flush(),
            Self::Memory(link) => link.flush(),
        }
    }

    /// Forgets what was to be written.
    pub(crate) fn discard(&mut self) {
        match self {
            Self::Socket(link) => link.discard(),
            Self::Memory(link) => link.discard(),
        }
    }

    /// Tells the other end that nothing more will come.
    pub(crate) fn finish(&mut self) {
        match self {
            Self::Socket(link) => link.finish(),
            Self::Memory(link) => link.finish(),
        }
    }

    /// Throws away what comes. Returns whether the other end is still open.
    pub(crate) fn is_open(&mut self) -> bool {
        match self {
            Self::Socket(link) => link.is_open(),
            Self::Memory(link) => link.is_open(),
        }
    }

    /// Reads once.
    pub(crate) fn read(&mut self) -> io::Result<Arrival> {
        match self {
            Self::Socket(link) => link.read(),
            Self::Memory(link) => Ok(link.read()),
        }
    }

    /// The next whole frame that has been read, with the descriptor that came with it.
    pub(crate) fn next_frame(&mut self) -> Result<Option<(Frame, Option<OwnedFd>)>, CodecError> {
        match self {
            Self::Socket(link) => link.next_frame(),
            Self::Memory(link) => Ok(link.next_frame()),
        }
    }
}

impl AsFd for Wire {
    fn as_fd(&self) -> BorrowedFd<'_> {
        match self {
            Self::Socket(link) => link.as_fd(),
            Self::Memory(link) => link.as_fd(),
        }
    }
}
