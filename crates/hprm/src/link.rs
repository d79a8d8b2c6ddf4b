//! Links: ordered frames in, ordered frames out, and a typed end.
//!
//! A link is a Unix stream socket on one machine, and TCP without Nagle's delay otherwise (paper,
//! section III-C, real-time sockets). Its buffers are allocated once; a message that fits into the
//! eager limit is read and written without another allocation. It knows frames, not what they mean.

mod address;
mod socket;

use std::collections::{BTreeMap, VecDeque};
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

use hprm_core::limits::EAGER_BUFFER;
use hprm_federated::Frame;
use hprm_federated::codec::{self, CodecError, Decoded};

pub use address::{Address, AddressError};
pub(crate) use socket::{Listener, Socket};

/// The longest frame that is taken from somebody who has not said who he is, in bytes.
const STRANGER_LIMIT: usize = 4096;

/// The most reads from one link before the others get their turn: a sender that is faster than
/// this process must not keep it from doing anything else.
pub(crate) const READS: usize = 64;

/// One end of a connection to the RTI or to another federate.
#[derive(Debug)]
pub(crate) struct Link {
    socket: Socket,
    /// Whether the other end is known to belong to the federation.
    trusted: bool,
    inbound: Inbound,
    outbound: Outbound,
}

/// Bytes that have arrived and are not frames yet.
#[derive(Debug)]
struct Inbound {
    buffer: Vec<u8>,
    start: usize,
    end: usize,
    /// How many more bytes the frame under way needs, as far as that is known.
    missing: usize,
    descriptors: VecDeque<OwnedFd>,
}

/// Bytes that have not left yet.
#[derive(Debug)]
struct Outbound {
    buffer: Vec<u8>,
    written: usize,
    /// Descriptors, by the position of the frame that they travel with.
    descriptors: BTreeMap<usize, OwnedFd>,
}

/// Whether the other end is still there.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Arrival {
    /// Something may have been read.
    Bytes,
    /// There is nothing to read at the moment.
    Nothing,
    /// The other end is closed.
    Closed,
}

impl Link {
    /// Connects to a listening address.
    pub(crate) fn connect(address: &Address) -> io::Result<Self> {
        let mut link = Self::new(Socket::connect(address)?);
        link.trust();
        Ok(link)
    }

    /// A link that somebody has opened, who has not said who he is.
    pub(crate) fn new(socket: Socket) -> Self {
        Self {
            socket,
            trusted: false,
            inbound: Inbound {
                buffer: vec![0; EAGER_BUFFER],
                start: 0,
                end: 0,
                missing: 0,
                descriptors: VecDeque::new(),
            },
            outbound: Outbound {
                buffer: Vec::with_capacity(EAGER_BUFFER),
                written: 0,
                descriptors: BTreeMap::new(),
            },
        }
    }

    /// The other end belongs to the federation.
    pub(crate) fn trust(&mut self) {
        self.trusted = true;
    }

    /// Whether descriptors can travel over this link.
    pub(crate) fn is_local(&self) -> bool {
        self.socket.is_unix()
    }

    /// Appends a frame to what is to be written.
    pub(crate) fn queue(&mut self, frame: &Frame) {
        self.outbound.compact();
        codec::encode(frame, &mut self.outbound.buffer);
    }

    /// Appends a frame with a descriptor.
    pub(crate) fn queue_with(&mut self, frame: &Frame, descriptor: OwnedFd) {
        self.outbound.compact();
        self.outbound.descriptors.insert(self.outbound.buffer.len(), descriptor);
        codec::encode(frame, &mut self.outbound.buffer);
    }

    /// Whether something is still to be written.
    pub(crate) fn has_outbound(&self) -> bool {
        self.outbound.written < self.outbound.buffer.len()
    }

    /// Writes as much as the socket takes.
    pub(crate) fn flush(&mut self) -> io::Result<()> {
        while self.has_outbound() {
            match self.outbound.write(&self.socket) {
                Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
                Ok(_) => {}
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(()),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        self.outbound.clear();
        Ok(())
    }

    /// Forgets what was to be written.
    pub(crate) fn discard(&mut self) {
        self.outbound.descriptors.clear();
        self.outbound.clear();
    }

    /// Tells the other end that nothing more will come.
    pub(crate) fn finish(&mut self) {
        // Fails only if the other end is closed already.
        let _ = self.socket.finish();
    }

    /// Throws away what comes. Returns whether the other end is still open.
    pub(crate) fn is_open(&mut self) -> bool {
        loop {
            (self.inbound.start, self.inbound.end) = (0, 0);
            match self.read() {
                Ok(Arrival::Bytes) => {}
                Ok(Arrival::Nothing) => return true,
                Ok(Arrival::Closed) | Err(_) => return false,
            }
        }
    }

    /// Reads once.
    pub(crate) fn read(&mut self) -> io::Result<Arrival> {
        self.inbound.make_room();
        let Inbound { buffer, end, descriptors, .. } = &mut self.inbound;
        match self.socket.receive(&mut buffer[*end..], descriptors) {
            Ok(0) => Ok(Arrival::Closed),
            Ok(count) => {
                *end += count;
                Ok(Arrival::Bytes)
            }
            Err(error) => match error.kind() {
                io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted => Ok(Arrival::Nothing),
                io::ErrorKind::ConnectionReset | io::ErrorKind::BrokenPipe => Ok(Arrival::Closed),
                _ => Err(error),
            },
        }
    }

    /// The next whole frame that has been read, with the descriptor that came with it.
    pub(crate) fn next_frame(&mut self) -> Result<Option<(Frame, Option<OwnedFd>)>, CodecError> {
        let Inbound { buffer, start, end, missing, descriptors } = &mut self.inbound;
        let frame = match codec::inspect(&buffer[*start..*end])? {
            Decoded::Frame(frame, len) => {
                *start += len;
                frame
            }
            Decoded::Missing(more) => {
                let (len, limit) = (*end - *start + more, STRANGER_LIMIT);
                if !self.trusted && len > limit {
                    return Err(CodecError::TooLong { len, limit });
                }
                *missing = more;
                return Ok(None);
            }
        };
        let descriptor = match frame {
            Frame::Segment { .. } => descriptors.pop_front(),
            _ => None,
        };
        Ok(Some((frame, descriptor)))
    }
}

impl AsFd for Link {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.socket.as_fd()
    }
}

impl Inbound {
    /// Makes sure that a read can bring something: moves what is left to the front, and grows to
    /// the frame that is under way.
    fn make_room(&mut self) {
        if self.start == self.end {
            (self.start, self.end) = (0, 0);
            if self.buffer.len() > 4 * EAGER_BUFFER {
                self.buffer = vec![0; EAGER_BUFFER];
            }
        }
        if self.end + self.missing.max(1) > self.buffer.len() {
            self.buffer.copy_within(self.start..self.end, 0);
            (self.start, self.end) = (0, self.end - self.start);
            // No faster than bytes arrive: who only claims to send much costs nothing.
            let wanted = (self.end + self.missing.max(1)).min(2 * self.buffer.len());
            self.buffer.resize(self.buffer.len().max(wanted), 0);
        }
    }
}

impl Outbound {
    fn write(&mut self, socket: &Socket) -> io::Result<usize> {
        // A descriptor goes with the first byte of its frame, so a write starts or ends there.
        let next = self.descriptors.range(self.written + 1..).next();
        let until = next.map_or(self.buffer.len(), |(at, _)| *at);
        let bytes = &self.buffer[self.written..until];
        let count = match self.descriptors.get(&self.written) {
            Some(descriptor) => socket.send_with(bytes, descriptor.as_fd())?,
            None => socket.send(bytes)?,
        };
        if count > 0 {
            self.descriptors.remove(&self.written);
        }
        self.written += count;
        Ok(count)
    }

    /// Forgets what has left, once that is the larger half: a reader that always lags a little would
    /// otherwise keep all of it here.
    fn compact(&mut self) {
        if self.written > EAGER_BUFFER && self.written > self.buffer.len() / 2 {
            self.buffer.drain(..self.written);
            let descriptors = std::mem::take(&mut self.descriptors).into_iter();
            self.descriptors = descriptors.map(|(at, fd)| (at - self.written, fd)).collect();
            self.written = 0;
        }
    }

    fn clear(&mut self) {
        self.buffer.clear();
        self.written = 0;
        if self.buffer.capacity() > 4 * EAGER_BUFFER {
            self.buffer = Vec::with_capacity(EAGER_BUFFER);
        }
    }
}
