//! A socket, and what lies between it and the frames: nothing, or TLS.

use std::collections::VecDeque;
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

use super::socket::Socket;
use super::tls::Channel;

/// A connected socket, encrypted or not.
#[derive(Debug)]
pub(super) struct Stream {
    socket: Socket,
    channel: Option<Box<Channel>>,
}

impl Stream {
    pub(super) fn new(socket: Socket, channel: Option<Channel>) -> Self {
        Self { socket, channel: channel.map(Box::new) }
    }

    pub(super) fn socket(&self) -> &Socket {
        &self.socket
    }

    pub(super) fn receive(
        &mut self,
        buffer: &mut [u8],
        descriptors: &mut VecDeque<OwnedFd>,
    ) -> io::Result<usize> {
        match &mut self.channel {
            None => self.socket.receive(buffer, descriptors),
            Some(channel) => channel.receive(&self.socket, buffer),
        }
    }

    pub(super) fn send(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match &mut self.channel {
            None => self.socket.send(bytes),
            Some(channel) => channel.send(&self.socket, bytes),
        }
    }

    /// Sends bytes, and a descriptor with the first of them; only for Unix sockets.
    pub(super) fn send_with(&self, bytes: &[u8], fd: BorrowedFd<'_>) -> io::Result<usize> {
        self.socket.send_with(bytes, fd)
    }

    /// Writes what has been sent and has not left.
    pub(super) fn pump(&mut self) -> io::Result<()> {
        self.channel.as_mut().map_or(Ok(()), |channel| channel.pump(&self.socket))
    }

    /// Whether bytes come as they were sent.
    pub(super) fn is_plain(&self) -> bool {
        self.channel.is_none()
    }

    pub(super) fn has_outbound(&self) -> bool {
        self.channel.as_ref().is_some_and(|channel| channel.has_outbound())
    }

    pub(super) fn has_unread(&self) -> bool {
        self.channel.as_ref().is_some_and(|channel| channel.has_unread())
    }

    /// Nothing more will be sent.
    pub(super) fn finish(&mut self) -> io::Result<()> {
        if let Some(channel) = &mut self.channel {
            channel.finish(&self.socket)?;
        }
        self.socket.finish()
    }

    /// What only the two ends know, if it is encrypted; else nothing.
    pub(super) fn binding(&self) -> io::Result<Vec<u8>> {
        self.channel.as_ref().map_or(Ok(Vec::new()), |channel| channel.binding())
    }
}

impl AsFd for Stream {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.socket.as_fd()
    }
}
