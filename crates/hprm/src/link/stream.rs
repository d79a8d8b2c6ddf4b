//! A socket, and what lies beside or above it: rings on one machine, perhaps TLS between machines.

use std::collections::VecDeque;
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

use super::rings::Rings;
use super::socket::Socket;
use super::tls::Channel;

/// A connection.
#[derive(Debug)]
pub(super) struct Stream {
    socket: Socket,
    way: Way,
}

/// The way that bytes take.
#[derive(Debug)]
pub(super) enum Way {
    /// As they are, over the socket.
    Plain,
    /// Encrypted, over the socket.
    Encrypted(Box<Channel>),
    /// Through memory, as soon as both ends know it.
    Rings(Box<Rings>),
}

impl Stream {
    pub(super) fn new(socket: Socket, way: Way) -> Self {
        Self { socket, way }
    }

    pub(super) fn socket(&self) -> &Socket {
        &self.socket
    }

    pub(super) fn receive(
        &mut self,
        buffer: &mut [u8],
        descriptors: &mut VecDeque<OwnedFd>,
    ) -> io::Result<usize> {
        match &mut self.way {
            Way::Plain => self.socket.receive(buffer, descriptors),
            Way::Encrypted(channel) => channel.receive(&self.socket, buffer),
            Way::Rings(rings) => rings.receive(&self.socket, buffer, descriptors),
        }
    }

    /// Receives a descriptor of which a frame that has been received tells, if it has not come with
    /// it.
    pub(super) fn receive_descriptor(&mut self, descriptors: &mut VecDeque<OwnedFd>) {
        if let Way::Rings(rings) = &mut self.way {
            // If there is none, the frame goes without; whether it can, others know.
            while descriptors.is_empty()
                && rings.receive_carriers(&self.socket, descriptors).is_ok_and(|count| count > 0)
            {
            }
        }
    }

    pub(super) fn send(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match &mut self.way {
            Way::Plain => self.socket.send(bytes),
            Way::Encrypted(channel) => channel.send(&self.socket, bytes),
            Way::Rings(rings) => rings.send(&self.socket, bytes),
        }
    }

    /// Sends bytes, and a descriptor with the first of them; only for Unix sockets.
    pub(super) fn send_with(&mut self, bytes: &[u8], fd: BorrowedFd<'_>) -> io::Result<usize> {
        match &mut self.way {
            Way::Rings(rings) => rings.send_with(&self.socket, bytes, Some(fd)),
            Way::Plain | Way::Encrypted(_) => self.socket.send_with(bytes, &[fd]),
        }
    }

    /// The other end is trusted: takes what it has offered.
    pub(super) fn meet(&mut self, descriptors: &mut VecDeque<OwnedFd>) -> io::Result<()> {
        match &mut self.way {
            Way::Rings(rings) => rings.meet(&self.socket, descriptors),
            Way::Plain | Way::Encrypted(_) => Ok(()),
        }
    }

    /// Says that this process is about to sleep. It must look once more after that.
    pub(super) fn fall_asleep(&mut self) {
        if let Way::Rings(rings) = &mut self.way {
            rings.fall_asleep();
        }
    }

    /// Says that this process does not sleep any more.
    pub(super) fn wake_up(&mut self) {
        if let Way::Rings(rings) = &mut self.way {
            rings.wake_up();
        }
    }

    /// Whether what is to be written waits for the socket, rather than for a notifier.
    pub(super) fn waits_for_socket(&self) -> bool {
        match &self.way {
            Way::Rings(rings) => rings.wait_for_socket(),
            Way::Plain | Way::Encrypted(_) => true,
        }
    }

    /// Whether what comes is seen without asking the system.
    pub(super) fn is_in_memory(&self) -> bool {
        matches!(&self.way, Way::Rings(rings) if rings.are_in_use())
    }

    /// Writes what has been sent and has not left.
    pub(super) fn pump(&mut self) -> io::Result<()> {
        match &mut self.way {
            Way::Encrypted(channel) => channel.pump(&self.socket),
            Way::Plain | Way::Rings(_) => Ok(()),
        }
    }

    /// Whether the other end has begun to speak TLS, if it has to.
    pub(super) fn has_spoken(&self) -> bool {
        matches!(&self.way, Way::Encrypted(channel) if channel.has_spoken())
    }

    /// Whether bytes come as they were sent.
    pub(super) fn is_plain(&self) -> bool {
        !matches!(self.way, Way::Encrypted(_))
    }

    pub(super) fn has_outbound(&self) -> bool {
        matches!(&self.way, Way::Encrypted(channel) if channel.has_outbound())
    }

    pub(super) fn has_unread(&self) -> bool {
        match &self.way {
            Way::Plain => false,
            Way::Encrypted(channel) => channel.has_unread(),
            Way::Rings(rings) => rings.have_unread(),
        }
    }

    /// Nothing more will be sent.
    pub(super) fn finish(&mut self) -> io::Result<()> {
        if let Way::Encrypted(channel) = &mut self.way {
            channel.finish(&self.socket)?;
        }
        self.socket.finish()
    }

    /// What only the two ends know, if it is encrypted; else nothing.
    pub(super) fn binding(&self) -> io::Result<Vec<u8>> {
        match &self.way {
            Way::Encrypted(channel) => channel.binding(),
            Way::Plain | Way::Rings(_) => Ok(Vec::new()),
        }
    }
}

impl AsFd for Stream {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.socket.as_fd()
    }
}
