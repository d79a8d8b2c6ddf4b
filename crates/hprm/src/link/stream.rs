//! A stream of bytes: a socket, with ring buffers beside it on one machine, or perhaps TLS above it between
//! machines.

use std::collections::VecDeque;
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

use super::rings::Rings;
use super::socket::Socket;
use super::tls::TlsChannel;

/// A connection, by whichever transport.
#[derive(Debug)]
pub(super) struct Stream {
    socket: Socket,
    transport: Transport,
}

/// What carries the bytes of a stream.
#[derive(Debug)]
pub(super) enum Transport {
    /// The socket, with the bytes as they are.
    Plain,
    /// The socket, with encrypted bytes.
    Encrypted(Box<TlsChannel>),
    /// Ring buffers in shared memory, as soon as both ends know of them.
    Rings(Box<Rings>),
}

impl Stream {
    pub(super) fn new(socket: Socket, transport: Transport) -> Self {
        Self { socket, transport }
    }

    pub(super) fn socket(&self) -> &Socket {
        &self.socket
    }

    pub(super) fn receive(
        &mut self,
        buffer: &mut [u8],
        descriptors: &mut VecDeque<OwnedFd>,
    ) -> io::Result<usize> {
        match &mut self.transport {
            Transport::Plain => self.socket.receive(buffer, descriptors),
            Transport::Encrypted(channel) => channel.receive(&self.socket, buffer),
            Transport::Rings(rings) => rings.receive(&self.socket, buffer, descriptors),
        }
    }

    /// Receives the descriptor that belongs to a frame that has been received, if it did not come with the
    /// frame.
    pub(super) fn receive_descriptor(&mut self, descriptors: &mut VecDeque<OwnedFd>) {
        if let Transport::Rings(rings) = &mut self.transport {
            // If there is none, the frame arrives without it; the receiver of the frame decides whether
            // that is an error.
            while descriptors.is_empty()
                && rings.receive_carriers(&self.socket, descriptors).is_ok_and(|count| count > 0)
            {
            }
        }
    }

    pub(super) fn send(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match &mut self.transport {
            Transport::Plain => self.socket.send(bytes),
            Transport::Encrypted(channel) => channel.send(&self.socket, bytes),
            Transport::Rings(rings) => rings.send(&self.socket, bytes),
        }
    }

    /// So many bytes will soon be sent.
    pub(super) fn expect(&self, count: usize) {
        if let Transport::Rings(rings) = &self.transport {
            rings.expect(count);
        }
    }

    /// Sends bytes, and a descriptor with the first of them; only for Unix sockets.
    pub(super) fn send_with(&mut self, bytes: &[u8], fd: BorrowedFd<'_>) -> io::Result<usize> {
        match &mut self.transport {
            Transport::Rings(rings) => rings.send_with(&self.socket, bytes, Some(fd)),
            Transport::Plain | Transport::Encrypted(_) => self.socket.send_with(bytes, &[fd]),
        }
    }

    /// The other end is trusted: takes the ring buffers that it has offered.
    pub(super) fn take_offer(&mut self, descriptors: &mut VecDeque<OwnedFd>) -> io::Result<()> {
        match &mut self.transport {
            Transport::Rings(rings) => rings.take_offer(&self.socket, descriptors),
            Transport::Plain | Transport::Encrypted(_) => Ok(()),
        }
    }

    /// Announces that this process is about to sleep. After that it must look once more for what has come.
    pub(super) fn announce_sleep(&mut self) {
        if let Transport::Rings(rings) = &mut self.transport {
            rings.announce_sleep();
        }
    }

    /// Whether the other end sees what is written without being woken up.
    pub(super) fn reader_is_awake(&self) -> bool {
        matches!(&self.transport, Transport::Rings(rings) if rings.reader_is_awake())
    }

    /// Announces that this process does not sleep any more.
    pub(super) fn end_sleep(&mut self) {
        if let Transport::Rings(rings) = &mut self.transport {
            rings.end_sleep();
        }
    }

    /// Whether what is to be written waits for the socket, rather than for a notifier.
    pub(super) fn waits_for_socket(&self) -> bool {
        match &self.transport {
            Transport::Rings(rings) => rings.wait_for_socket(),
            Transport::Plain | Transport::Encrypted(_) => true,
        }
    }

    /// Whether this process sees what comes in shared memory, without asking the kernel.
    pub(super) fn is_in_memory(&self) -> bool {
        matches!(&self.transport, Transport::Rings(rings) if rings.are_in_use())
    }

    /// Writes what has been sent and has not left.
    pub(super) fn pump(&mut self) -> io::Result<()> {
        match &mut self.transport {
            Transport::Encrypted(channel) => channel.pump(&self.socket),
            Transport::Plain | Transport::Rings(_) => Ok(()),
        }
    }

    /// Whether the other end has begun to speak TLS, if it has to.
    pub(super) fn has_begun_handshake(&self) -> bool {
        matches!(&self.transport, Transport::Encrypted(channel) if channel.has_begun_handshake())
    }

    /// Whether bytes come as they were sent.
    pub(super) fn is_plain(&self) -> bool {
        !matches!(self.transport, Transport::Encrypted(_))
    }

    pub(super) fn has_outbound(&self) -> bool {
        matches!(&self.transport, Transport::Encrypted(channel) if channel.has_outbound())
    }

    #[inline]
    pub(super) fn has_unread(&self) -> bool {
        match &self.transport {
            Transport::Plain => false,
            Transport::Encrypted(channel) => channel.has_unread(),
            Transport::Rings(rings) => rings.have_unread(),
        }
    }

    /// Nothing more will be sent.
    pub(super) fn finish(&mut self) -> io::Result<()> {
        if let Transport::Encrypted(channel) = &mut self.transport {
            channel.finish(&self.socket)?;
        }
        self.socket.finish()
    }

    /// What only the two ends know, if it is encrypted; else nothing.
    pub(super) fn binding(&self) -> io::Result<Vec<u8>> {
        match &self.transport {
            Transport::Encrypted(channel) => channel.binding(),
            Transport::Plain | Transport::Rings(_) => Ok(Vec::new()),
        }
    }
}

impl AsFd for Stream {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.socket.as_fd()
    }
}
