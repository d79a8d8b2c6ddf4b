//! Links: ordered, reliable connections that carry frames, to another process or to another thread.
//!
//! A [`Link`] is one of two kinds. A [`StreamLink`] leads to another process; its transport carries bytes: a
//! Unix socket with ring buffers, TCP or TLS, or what the agent of this machine leads to another one. A [`QueueLink`] leads to another thread of this process; its
//! transport is a pair of queues, which carry frames as they are. A [`Network`] is where addresses mean
//! something, so it makes links of one kind. Under this module are the transports, the handshake, and the
//! acceptor of new links.

mod acceptor;
mod address;
mod agents;
pub(crate) mod descriptors;
mod ends;
mod keys;
mod outbound;
mod proof;
mod queue_link;
mod rings;
mod socket;
mod stream;
mod stream_link;
mod tls;

use std::io;
use std::net::SocketAddr;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::sync::Arc;

use hprm_federated::Frame;
use hprm_federated::codec::CodecError;

use crate::notifier::Notifier;
use crate::wait::Deadline;
pub(crate) use acceptor::LinkAcceptor;
pub use address::{Address, AddressError};
pub(crate) use agents::{ask_for_machines, connect_through_agent, route as route_through_agent};
pub(crate) use descriptors::{advice as descriptor_advice, is_shortage};
pub(crate) use ends::CloseInChild;
pub(crate) use keys::Keys;
pub use keys::Security;
pub(crate) use proof::{Purpose, name_of};
pub(crate) use queue_link::Hub;
use queue_link::{QueueLink, QueueListener};
use socket::SocketListener;
use stream_link::StreamLink;
pub use tls::TlsFiles;

/// The most reads from one link before the loop reads the others: a sender that is faster than this
/// process must not keep it from doing anything else.
pub(crate) const READS: usize = 64;

/// Whether the other end is still there.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Arrival {
    /// Something may have been received, and there may be more.
    Bytes,
    /// Something has been received, and at that moment there was no more.
    LastBytes,
    /// There is nothing to read at the moment.
    Nothing,
    /// The other end is closed.
    Closed,
}

/// One end of a link to the RTI or to another federate.
#[derive(Debug)]
pub(crate) enum Link {
    Stream(StreamLink),
    Queue(QueueLink),
}

/// Accepts links at one address.
#[derive(Debug)]
pub(crate) enum LinkListener {
    Socket(SocketListener, Notifier),
    Queue(QueueListener),
}

/// Where addresses mean something, and so where links begin and end.
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

    /// What processes use to notify this one, with which they share memory.
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
    ) -> io::Result<Link> {
        match self {
            Self::Sockets(notifier) => {
                StreamLink::connect(address, purpose, keys, notifier, deadline).map(Link::Stream)
            }
            Self::Process(hub) => hub.connect(address).map(Link::Queue),
        }
    }

    /// Listens at an address.
    pub(crate) fn listen(&self, address: &Address) -> io::Result<LinkListener> {
        match self {
            Self::Sockets(notifier) => SocketListener::bind(address)
                .map(|listener| LinkListener::Socket(listener, notifier.clone())),
            Self::Process(hub) => hub.listen(address).map(LinkListener::Queue),
        }
    }
}

impl LinkListener {
    /// Where it listens; a port of zero has become a real one.
    pub(crate) fn address(&self) -> &Address {
        match self {
            Self::Socket(listener, _) => listener.address(),
            Self::Queue(listener) => listener.address(),
        }
    }

    /// The next connection, if one waits; the process at its other end is not identified yet.
    pub(crate) fn accept(&self, purpose: Purpose, keys: &Keys) -> io::Result<Option<Link>> {
        match self {
            Self::Socket(listener, notifier) => {
                while let Some(socket) = listener.accept()? {
                    // A connection that fails is dropped.
                    if let Ok(link) = StreamLink::accepted(socket, purpose, keys, notifier) {
                        return Ok(Some(Link::Stream(link)));
                    }
                }
                Ok(None)
            }
            Self::Queue(listener) => Ok(listener.accept().map(Link::Queue)),
        }
    }
}

impl AsFd for LinkListener {
    fn as_fd(&self) -> BorrowedFd<'_> {
        match self {
            Self::Socket(listener, _) => listener.as_fd(),
            Self::Queue(listener) => listener.as_fd(),
        }
    }
}

impl Link {
    /// The other end belongs to the federation.
    pub(crate) fn trust(&mut self) {
        match self {
            Self::Stream(link) => link.trust(),
            // All threads of the process belong to the federation.
            Self::Queue(_) => {}
        }
    }

    /// Whether the other end is known to be one of the same federation, or at least of the same user.
    pub(crate) fn is_authenticated(&self) -> bool {
        match self {
            Self::Stream(link) => link.is_authenticated(),
            Self::Queue(_) => true,
        }
    }

    /// Whether the other end has begun to prove that, as far as this process can tell.
    pub(crate) fn has_begun_handshake(&self) -> bool {
        match self {
            Self::Stream(link) => link.has_begun_handshake(),
            Self::Queue(_) => true,
        }
    }

    /// The address of the other end on the network.
    pub(crate) fn peer_address(&self) -> io::Result<SocketAddr> {
        match self {
            Self::Stream(link) => link.peer_address(),
            Self::Queue(_) => Err(io::ErrorKind::Unsupported.into()),
        }
    }

    /// Waits until both ends have proved what they have to, until the deadline at the latest.
    pub(crate) fn establish(&mut self, deadline: Deadline) -> io::Result<()> {
        match self {
            Self::Stream(link) => link.establish(deadline),
            Self::Queue(_) => Ok(()),
        }
    }

    /// The address of this end on the network.
    pub(crate) fn local_address(&self) -> io::Result<SocketAddr> {
        match self {
            Self::Stream(link) => link.local_address(),
            Self::Queue(_) => Err(io::ErrorKind::Unsupported.into()),
        }
    }

    /// Whether the other end is on this machine, as far as its address tells.
    pub(crate) fn is_within_host(&self) -> bool {
        match self {
            Self::Stream(link) => link.is_within_host(),
            Self::Queue(_) => true,
        }
    }

    /// Whether something has been received that the kernel does not report any more.
    #[inline]
    pub(crate) fn has_unread(&self) -> bool {
        match self {
            Self::Stream(link) => link.has_unread(),
            Self::Queue(_) => false,
        }
    }

    /// Whether this process sees what comes in shared memory, without asking the kernel; only the end of the
    /// peer it does not see there.
    pub(crate) fn is_in_memory(&self) -> bool {
        match self {
            Self::Stream(link) => link.is_in_memory(),
            // The descriptor of the queue shows it.
            Self::Queue(_) => false,
        }
    }

    /// Announces that this process is about to sleep: from then on a peer that sends something notifies it.
    /// After the announcement this process must look once more for what has come.
    pub(crate) fn announce_sleep(&mut self) {
        match self {
            Self::Stream(link) => link.announce_sleep(),
            Self::Queue(_) => {}
        }
    }

    /// Announces that this process does not sleep any more.
    pub(crate) fn end_sleep(&mut self) {
        match self {
            Self::Stream(link) => link.end_sleep(),
            Self::Queue(_) => {}
        }
    }

    /// Whether something is to be written that waits until the descriptor can be written.
    pub(crate) fn waits_for_socket(&self) -> bool {
        match self {
            Self::Stream(link) => link.waits_for_socket(),
            Self::Queue(link) => link.has_outbound(),
        }
    }

    /// Whether the link carries descriptors.
    pub(crate) fn is_local(&self) -> bool {
        match self {
            Self::Stream(link) => link.is_local(),
            Self::Queue(_) => true,
        }
    }

    /// Queues a frame, perhaps with a descriptor that travels with it.
    pub(crate) fn queue(&mut self, frame: Frame, descriptor: Option<OwnedFd>) {
        match self {
            Self::Stream(link) => link.queue(frame, descriptor),
            Self::Queue(link) => link.queue(frame, descriptor),
        }
    }

    /// Whether chunks of a long message have come or left since the last call.
    pub(crate) fn take_moved_chunks(&mut self) -> bool {
        match self {
            Self::Stream(link) => link.take_moved_chunks(),
            // A frame is there at once.
            Self::Queue(_) => false,
        }
    }

    /// How many bytes are to be written; zero if the other end took no more the last time. Frames to another
    /// thread have no bytes.
    pub(crate) fn writable_len(&self) -> usize {
        match self {
            Self::Stream(link) => link.writable_len(),
            Self::Queue(_) => 0,
        }
    }

    /// Whether something is still to be written.
    pub(crate) fn has_outbound(&self) -> bool {
        match self {
            Self::Stream(link) => link.has_outbound(),
            Self::Queue(link) => link.has_outbound(),
        }
    }

    /// Whether a later flush may have something to write.
    pub(crate) fn must_flush_again(&self) -> bool {
        match self {
            Self::Stream(link) => link.must_flush_again(),
            Self::Queue(link) => link.has_outbound(),
        }
    }

    /// Whether the other end sees what is written without being woken up.
    pub(crate) fn reader_is_awake(&self) -> bool {
        matches!(self, Self::Stream(link) if link.reader_is_awake())
    }

    /// Writes as much as the other end takes.
    pub(crate) fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Stream(link) => link.flush(),
            Self::Queue(link) => link.flush(),
        }
    }

    /// Discards what was to be written.
    pub(crate) fn discard(&mut self) {
        match self {
            Self::Stream(link) => link.discard(),
            Self::Queue(link) => link.discard(),
        }
    }

    /// Tells the other end that nothing more will come.
    pub(crate) fn finish(&mut self) {
        match self {
            Self::Stream(link) => link.finish(),
            Self::Queue(link) => link.finish(),
        }
    }

    /// Reads and discards what comes. Returns whether the other end is still open.
    pub(crate) fn is_open(&mut self) -> bool {
        match self {
            Self::Stream(link) => link.is_open(),
            Self::Queue(link) => link.is_open(),
        }
    }

    /// Reads once.
    pub(crate) fn read(&mut self) -> io::Result<Arrival> {
        match self {
            Self::Stream(link) => link.read(),
            Self::Queue(link) => Ok(link.read()),
        }
    }

    /// The next whole frame that has been read, if it is a plain message, as most are. If there is none,
    /// [`next_frame`](Self::next_frame) tells what there is.
    #[inline]
    pub(crate) fn next_plain_message(&mut self) -> Option<Frame> {
        match self {
            Self::Stream(link) => link.next_plain_message(),
            Self::Queue(_) => None,
        }
    }

    /// The next whole frame that has been read, with the descriptor that came with it.
    pub(crate) fn next_frame(&mut self) -> Result<Option<(Frame, Option<OwnedFd>)>, CodecError> {
        match self {
            Self::Stream(link) => link.next_frame(),
            Self::Queue(link) => Ok(link.next_frame()),
        }
    }
}

impl AsFd for Link {
    fn as_fd(&self) -> BorrowedFd<'_> {
        match self {
            Self::Stream(link) => link.as_fd(),
            Self::Queue(link) => link.as_fd(),
        }
    }
}
