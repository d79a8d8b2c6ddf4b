//! Links over a stream of bytes: a link sends and receives frames in order, and tells when the other end is closed.
//!
//! On one machine, the transport of a link is a Unix stream socket together with ring buffers, through which
//! the bytes go. Otherwise it is TCP without Nagle's delay (paper, section III-C, real-time sockets), perhaps
//! with TLS. A link allocates its buffers once: it reads and writes a message that fits into the eager limit
//! without another allocation. A link does not know what its frames mean. Before the first frame, both ends prove
//! that they belong to the federation ([`proof`]); over a Unix socket the kernel tells the other end's user.

use std::collections::VecDeque;
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

use hprm_core::limits::EAGER_BUFFER;
use hprm_federated::Frame;
use hprm_federated::codec::{CodecError, Decoded, Decoder};

use super::outbound::Outbound;
use super::proof::{self, Handshake, Purpose, Refused, Role};
use super::socket::Socket;
use super::stream::Stream;
use super::{Address, Arrival, Keys};
use crate::notifier::Notifier;
use crate::wait::{Deadline, Interest};

/// The longest frame that a link accepts while the other end is not trusted, in bytes.
const UNTRUSTED_LIMIT: usize = 4096;

/// One end of a link whose transport carries bytes.
#[derive(Debug)]
pub(crate) struct StreamLink {
    stream: Stream,
    /// The handshake by which both ends authenticate, until it is over.
    handshake: Option<Box<Handshake>>,
    /// Whether the other end is known to belong to the federation.
    trusted: bool,
    /// Whether nothing can be written any more.
    is_write_closed: bool,
    inbound: Inbound,
    outbound: Outbound,
    /// Whether chunks of a long message have come or left.
    has_moved_chunks: bool,
}

/// Bytes that have arrived and are not frames yet.
#[derive(Debug)]
struct Inbound {
    buffer: Vec<u8>,
    start: usize,
    end: usize,
    /// How many more bytes the incomplete frame needs, as far as that is known.
    missing: usize,
    decoder: Decoder,
    descriptors: VecDeque<OwnedFd>,
}

impl StreamLink {
    /// Connects to a listening address, by the deadline at the latest. Queued frames leave once the handshake
    /// is over; [`Self::establish`] waits for that.
    pub(crate) fn connect(
        address: &Address,
        purpose: Purpose,
        keys: &Keys,
        notifier: &Notifier,
        deadline: Deadline,
    ) -> io::Result<Self> {
        let socket = Socket::connect(address, deadline)?;
        let mut link = Self::new(socket, Role::Opener, purpose, keys, notifier)?;
        link.trust();
        Ok(link)
    }

    /// A link that another process has opened. This process does not know yet which one that is.
    pub(crate) fn accepted(
        socket: Socket,
        purpose: Purpose,
        keys: &Keys,
        notifier: &Notifier,
    ) -> io::Result<Self> {
        Self::new(socket, Role::Acceptor, purpose, keys, notifier)
    }

    fn new(
        socket: Socket,
        role: Role,
        purpose: Purpose,
        keys: &Keys,
        notifier: &Notifier,
    ) -> io::Result<Self> {
        let handshake = keys.handshake(&socket, role, purpose)?;
        Ok(Self {
            stream: keys.stream(socket, role, notifier)?,
            handshake: handshake.map(Box::new),
            trusted: false,
            is_write_closed: false,
            inbound: Inbound {
                // An unauthenticated client costs little memory.
                buffer: vec![0; UNTRUSTED_LIMIT],
                start: 0,
                end: 0,
                missing: 0,
                decoder: Decoder::default(),
                descriptors: VecDeque::new(),
            },
            outbound: Outbound::default(),
            has_moved_chunks: false,
        })
    }

    /// Notes that the other end belongs to the federation: from now on it may send frames of any length.
    pub(crate) fn trust(&mut self) {
        self.trusted = true;
        self.inbound.prepare();
        self.outbound.prepare();
    }

    /// Whether the handshake is over, or this link needs none.
    pub(crate) fn is_established(&self) -> bool {
        self.handshake.is_none()
    }

    /// Whether the other end is known to belong to the federation, or at least to the same user.
    pub(crate) fn is_authenticated(&self) -> bool {
        self.is_established() || self.is_local()
    }

    /// Whether the other end has begun the handshake, as far as this process can tell.
    pub(crate) fn has_begun_handshake(&self) -> bool {
        self.handshake.as_ref().is_none_or(|handshake| handshake.is_greeted())
            || self.stream.has_begun_handshake()
    }

    /// Waits until the handshake is over, until the deadline at the latest.
    pub(crate) fn establish(&mut self, deadline: Deadline) -> io::Result<()> {
        loop {
            self.flush()?;
            if self.is_established() {
                return Ok(());
            }
            match self.read()? {
                Arrival::Bytes | Arrival::LastBytes => continue,
                Arrival::Closed => return Err(io::ErrorKind::ConnectionReset.into()),
                Arrival::Nothing => {}
            }
            deadline.wait(Interest { fd: self.as_fd(), write: self.has_outbound() })?;
        }
    }

    /// Whether both ends are on one host.
    pub(crate) fn is_within_host(&self) -> bool {
        let socket = self.stream.socket();
        let same = |other: std::net::SocketAddr| {
            socket.local_address().is_ok_and(|here| here.ip() == other.ip())
        };
        socket.is_unix() || socket.peer_address().is_ok_and(same)
    }

    /// The address of the other end, if it is TCP.
    pub(crate) fn peer_address(&self) -> io::Result<std::net::SocketAddr> {
        match self.is_local() {
            true => Err(io::ErrorKind::Unsupported.into()),
            false => self.stream.socket().peer_address(),
        }
    }

    /// The address of this end.
    pub(crate) fn local_address(&self) -> io::Result<std::net::SocketAddr> {
        self.stream.socket().local_address()
    }

    /// Whether descriptors can travel over this link.
    pub(crate) fn is_local(&self) -> bool {
        self.stream.socket().is_unix()
    }

    /// Appends a frame to what is to be written, perhaps with a descriptor.
    pub(crate) fn queue(&mut self, frame: Frame, descriptor: Option<OwnedFd>) {
        if !self.is_write_closed {
            self.outbound.queue(frame, descriptor);
            self.stream.expect(self.outbound.writable_len());
        }
    }

    /// How many bytes of frames are to be written; zero if the other end took no more the last time.
    pub(crate) fn writable_len(&self) -> usize {
        self.outbound.writable_len()
    }

    /// Whether chunks of a long message have come or left since the last call.
    pub(crate) fn take_moved_chunks(&mut self) -> bool {
        std::mem::take(&mut self.has_moved_chunks)
    }

    /// Whether something is to be written, and the link may still be written.
    pub(crate) fn has_outbound(&self) -> bool {
        let more = match &self.handshake {
            Some(handshake) => !handshake.outbound().is_empty(),
            None => self.outbound.is_some(),
        };
        !self.is_write_closed && (more || self.stream.has_outbound())
    }

    /// Whether a later flush may have something to write: frames also wait for the end of the handshake.
    pub(crate) fn must_flush_again(&self) -> bool {
        let waits = self.handshake.is_some() || self.outbound.is_some();
        !self.is_write_closed && (waits || self.stream.has_outbound())
    }

    /// Whether bytes wait until the socket takes more. Bytes that wait for room in a ring buffer do not count:
    /// the peer notifies the loop when it has made room.
    pub(crate) fn waits_for_socket(&self) -> bool {
        self.has_outbound() && self.stream.waits_for_socket()
    }

    /// Whether bytes come through shared memory, where this process sees them without asking the kernel. Only
    /// the socket shows that the peer has ended.
    pub(crate) fn is_in_memory(&self) -> bool {
        self.stream.is_in_memory()
    }

    /// Announces that this process is about to sleep: from then on a peer that sends something notifies it.
    /// After the announcement this process must look once more for what has come.
    pub(crate) fn announce_sleep(&mut self) {
        self.stream.announce_sleep();
    }

    /// Announces that this process does not sleep any more.
    pub(crate) fn end_sleep(&mut self) {
        self.stream.end_sleep();
    }

    /// Whether the other end sees what is written without being woken up.
    pub(crate) fn reader_is_awake(&self) -> bool {
        self.stream.reader_is_awake()
    }

    /// Whether bytes wait that the socket does not report as readable: in a ring buffer, or decrypted.
    #[inline]
    pub(crate) fn has_unread(&self) -> bool {
        self.stream.has_unread()
    }

    /// Writes as much as the socket takes.
    pub(crate) fn flush(&mut self) -> io::Result<()> {
        if self.is_write_closed {
            self.outbound.clear();
            return Ok(());
        }
        self.stream.pump()?;
        self.flush_handshake()?;
        if !self.is_established() {
            return Ok(());
        }
        self.take_offer()?;
        while self.outbound.fill()? {
            match self.outbound.write(&mut self.stream) {
                Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
                Ok(_) => self.has_moved_chunks |= self.outbound.is_long(),
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(()),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// Discards what was to be written: the other end cannot read it.
    pub(crate) fn discard(&mut self) {
        self.is_write_closed = true;
        self.outbound.clear();
    }

    /// Tells the other end that nothing more will come.
    pub(crate) fn finish(&mut self) {
        // Fails only if the other end is closed already.
        let _ = self.stream.finish();
    }

    /// Reads and discards what comes. Returns whether the other end is still open.
    pub(crate) fn is_open(&mut self) -> bool {
        loop {
            (self.inbound.start, self.inbound.end) = (0, 0);
            match self.read() {
                Ok(Arrival::Bytes | Arrival::LastBytes) => {}
                Ok(Arrival::Nothing) => return true,
                Ok(Arrival::Closed) | Err(_) => return false,
            }
        }
    }

    /// Takes the ring buffers that the other end offers, once it is trusted.
    fn take_offer(&mut self) -> io::Result<()> {
        if self.trusted { self.stream.take_offer(&mut self.inbound.descriptors) } else { Ok(()) }
    }

    /// Writes the bytes that the handshake has to send, and notices when it is over.
    fn flush_handshake(&mut self) -> io::Result<()> {
        let Some(handshake) = &mut self.handshake else { return Ok(()) };
        while !handshake.outbound().is_empty() {
            match self.stream.send(handshake.outbound()) {
                Ok(count) => handshake.sent(count),
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(()),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        if handshake.is_over() {
            self.handshake = None;
        }
        Ok(())
    }

    /// Reads the bytes that the handshake wants, and no more. If the handshake refuses the other end, this end
    /// sends the refusal before it returns it as an error.
    fn read_handshake(&mut self) -> io::Result<Arrival> {
        let Some(handshake) = &mut self.handshake else { return Ok(Arrival::Bytes) };
        let mut buffer = [0; proof::LONGEST];
        let wanted = handshake.wanted();
        if wanted == 0 {
            // The handshake waits until its last bytes have left.
            self.flush_handshake()?;
            return Ok(if self.is_established() { Arrival::Bytes } else { Arrival::Nothing });
        }
        let received = self.stream.receive(&mut buffer[..wanted], &mut self.inbound.descriptors);
        let arrival = arrival(received)?;
        let taken = match arrival {
            Ok(count) => {
                let binding = self.stream.binding()?;
                handshake.take(&buffer[..count], || binding)
            }
            Err(arrival) => return Ok(arrival),
        };
        if taken == Err(Refused::Encrypted) {
            // If this end closed the socket while it holds unread bytes, the kernel would reset the connection,
            // and the other end might not get the answer.
            let mut rest = [0; UNTRUSTED_LIMIT];
            let _ = self.stream.receive(&mut rest, &mut self.inbound.descriptors);
        }
        self.flush_handshake()?;
        taken.map_err(refused)?;
        Ok(Arrival::Bytes)
    }

    /// Reads once.
    pub(crate) fn read(&mut self) -> io::Result<Arrival> {
        if self.handshake.is_some() {
            return self.read_handshake();
        }
        self.take_offer()?;
        self.inbound.make_room()?;
        let Inbound { buffer, end, descriptors, .. } = &mut self.inbound;
        let (room, held) = (buffer.len() - *end, descriptors.len());
        let received = self.stream.receive(&mut buffer[*end..], descriptors);
        Ok(match arrival(received)? {
            Ok(count) => {
                *end += count;
                // A read that has not filled the buffer has read all that there was, unless it has ended at a
                // descriptor or at the end of a TLS record.
                let is_last = count < room && descriptors.len() == held && self.stream.is_plain();
                if is_last { Arrival::LastBytes } else { Arrival::Bytes }
            }
            Err(arrival) => arrival,
        })
    }

    /// The next whole frame that has been read, if it is a plain message. If there is none,
    /// [`next_frame`](Self::next_frame) tells what there is.
    #[inline]
    pub(crate) fn next_plain_message(&mut self) -> Option<Frame> {
        let Inbound { buffer, start, end, decoder, .. } = &mut self.inbound;
        let (frame, len) = decoder.next_plain(&buffer[*start..*end])?;
        *start += len;
        Some(frame)
    }

    /// The next whole frame that has been read, with the descriptor that came with it.
    pub(crate) fn next_frame(&mut self) -> Result<Option<(Frame, Option<OwnedFd>)>, CodecError> {
        let Inbound { buffer, start, end, missing, decoder, descriptors } = &mut self.inbound;
        if start == end {
            *missing = 0;
            return Ok(None);
        }
        let frame = loop {
            let (more, frame_len) = match decoder.next(&buffer[*start..*end])? {
                Decoded::Frame(frame, len) => {
                    *start += len;
                    break frame;
                }
                Decoded::Chunk { taken, message_len } => {
                    *start += taken;
                    self.has_moved_chunks = true;
                    (0, message_len)
                }
                Decoded::Missing(more) => (more, *end - *start + more),
            };
            let limit = UNTRUSTED_LIMIT;
            if !self.trusted && frame_len > limit {
                return Err(CodecError::TooLong { len: frame_len, limit });
            }
            if more > 0 {
                *missing = more;
                return Ok(None);
            }
        };
        let descriptor = match frame.carries() {
            Some(_) => {
                self.stream.receive_descriptor(descriptors);
                descriptors.pop_front()
            }
            None => None,
        };
        Ok(Some((frame, descriptor)))
    }
}

/// How many bytes have come; if none have, what that says of the link.
fn arrival(received: io::Result<usize>) -> io::Result<Result<usize, Arrival>> {
    match received {
        Ok(0) => Ok(Err(Arrival::Closed)),
        Ok(count) => Ok(Ok(count)),
        Err(error) => match error.kind() {
            io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted => Ok(Err(Arrival::Nothing)),
            io::ErrorKind::ConnectionReset | io::ErrorKind::BrokenPipe => Ok(Err(Arrival::Closed)),
            _ => Err(error),
        },
    }
}

/// The error of a read or a write for which the system has no memory.
pub(super) fn no_memory(error: CodecError) -> io::Error {
    io::Error::new(io::ErrorKind::OutOfMemory, error)
}

fn refused(refused: Refused) -> io::Error {
    io::Error::new(io::ErrorKind::PermissionDenied, refused)
}

impl AsFd for StreamLink {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.stream.as_fd()
    }
}

impl Inbound {
    /// Makes room for eager messages. The pages of new memory, which is zero already, cost nothing before they are
    /// used; short messages use the first ones alone.
    fn prepare(&mut self) {
        if self.buffer.len() < EAGER_BUFFER {
            let mut buffer = vec![0; EAGER_BUFFER];
            buffer[..self.end].copy_from_slice(&self.buffer[..self.end]);
            self.buffer = buffer;
        }
    }

    /// Makes room for the next read: moves the bytes that are not a frame yet to the front of the buffer, and
    /// grows the buffer for the incomplete frame.
    fn make_room(&mut self) -> io::Result<()> {
        if self.start == self.end {
            (self.start, self.end) = (0, 0);
            if self.buffer.len() > 4 * EAGER_BUFFER {
                self.buffer = vec![0; EAGER_BUFFER];
            }
        }
        if self.end + self.missing.max(1) > self.buffer.len() {
            self.buffer.copy_within(self.start..self.end, 0);
            (self.start, self.end) = (0, self.end - self.start);
            // The buffer grows no faster than bytes arrive: a process that only claims to send much costs
            // no memory.
            let wanted = (self.end + self.missing.max(1)).min(2 * self.buffer.len());
            let more = wanted.saturating_sub(self.buffer.len());
            self.buffer
                .try_reserve_exact(more)
                .map_err(|_| CodecError::NoMemory(wanted))
                .map_err(no_memory)?;
            self.buffer.resize(self.buffer.len() + more, 0);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use hprm_federated::FederationId;

    use super::*;
    use crate::Security;
    use crate::link::socket::SocketListener;

    #[test]
    fn a_link_that_cannot_be_written_waits_for_nothing() {
        let listener = SocketListener::bind(&"127.0.0.1:0".parse().unwrap()).unwrap();
        let keys = Keys::new(FederationId(7), Security::default()).unwrap();
        let deadline = Deadline::at(crate::Clock::now().plus(10_000_000_000));
        let notifier = Notifier::new().unwrap();
        let address = listener.address();
        let connect = StreamLink::connect(address, Purpose::Messages, &keys, &notifier, deadline);
        let mut link = connect.unwrap();
        link.queue(Frame::Resign, None);
        assert!(link.has_outbound());
        link.finish();
        assert!(link.flush().is_err());
        link.discard();
        assert!(!link.has_outbound());
        link.queue(Frame::Resign, None);
        assert!(link.flush().is_ok() && !link.has_outbound());
    }
}
