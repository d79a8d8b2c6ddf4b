//! The transport to a process on the same machine: ring buffers in shared memory instead of the socket.
//!
//! The process that opens a link to a Unix socket makes two rings, and sends their memory and its notifier
//! with the first byte. The process at the other end, if it trusts the first one, answers with a notifier
//! of its own; from then on bytes go through the rings. Each direction begins with the socket and continues in
//! its ring, at a position that the ring tells. Afterwards the socket still has two tasks. Descriptors travel
//! over it, each with one byte that means nothing; the writer sends a descriptor before it puts the frame that
//! the descriptor belongs to into the ring. And the end of the socket shows that a process has ended; the other
//! process then still reads what is in the ring.

use std::collections::VecDeque;
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

use hprm_core::limits::EAGER_BUFFER;
use hprm_store::{RING_CAPACITY, RingReader, RingWriter, map_ring_pair, ring_pair};

use super::socket::Socket;
use crate::notifier::{Notifier, RemoteNotifier};
use crate::wait::is_hung_up;

/// The byte that a descriptor travels with.
const CARRIER: [u8; 1] = [0];

/// A message that travels inside its frame fits.
const _: () = assert!(RING_CAPACITY >= EAGER_BUFFER);

/// This end of two ring buffers; it exists before the other end knows of them.
#[derive(Debug)]
pub(super) struct Rings {
    notifier: Notifier,
    ends: Option<(RingWriter, RingReader)>,
    /// Whether this end knows whether there will be rings.
    is_decided: bool,
    /// The memory of both, until it has been sent.
    offer: Option<OwnedFd>,
    /// Whether the other end still waits for this one's notifier.
    owes_notifier: bool,
    /// The notifier of the other end. Once it has come, this end writes into the ring.
    remote: Option<RemoteNotifier>,
    /// How many bytes have gone through the socket, apart from carriers.
    sent: u64,
    received: u64,
    /// Whether a descriptor waits until the socket can be written.
    is_congested: bool,
}

impl Rings {
    /// For the process that has opened the link. Without memory for rings (`ulimit -f` may forbid any),
    /// there are none, and all bytes go through the socket.
    pub(super) fn offered(notifier: Notifier) -> Self {
        let mut rings = Self::expected(notifier);
        rings.is_decided = true;
        if let Ok((writer, reader, file)) = ring_pair() {
            rings.ends = Some((writer, reader));
            rings.offer = Some(file);
        }
        rings
    }

    /// For the process that has accepted the link.
    pub(super) fn expected(notifier: Notifier) -> Self {
        Self {
            notifier,
            ends: None,
            is_decided: false,
            offer: None,
            owes_notifier: false,
            remote: None,
            sent: 0,
            received: 0,
            is_congested: false,
        }
    }

    /// Takes the rings that the other end has offered, if this one trusts it: they are the first two
    /// descriptors that have come. Without them, there is only the socket.
    #[inline]
    pub(super) fn take_offer(
        &mut self,
        socket: &Socket,
        descriptors: &mut VecDeque<OwnedFd>,
    ) -> io::Result<()> {
        match self.is_decided && !self.owes_notifier {
            true => Ok(()),
            false => self.decide(socket, descriptors),
        }
    }

    /// The same, as long as something is open.
    fn decide(&mut self, socket: &Socket, descriptors: &mut VecDeque<OwnedFd>) -> io::Result<()> {
        if !std::mem::replace(&mut self.is_decided, true) && descriptors.len() >= 2 {
            let mut offered = descriptors.drain(..2);
            let (file, remote) = (offered.next(), offered.next());
            let (Some(file), Some(remote)) = (file, remote) else { return Ok(()) };
            self.ends = Some(map_ring_pair(&file).map_err(io::Error::other)?);
            self.open(remote)?;
            self.owes_notifier = true;
        }
        if self.owes_notifier {
            match socket.send_with(&CARRIER, &[self.notifier.as_fd()]) {
                Ok(_) => self.owes_notifier = false,
                Err(error) if is_transient(&error) => {}
                // The other end has ended, and what it has sent before is still to be read.
                Err(error) if is_ended(&error) => self.owes_notifier = false,
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// From now on this end writes into the ring.
    fn open(&mut self, remote: OwnedFd) -> io::Result<()> {
        self.remote = Some(RemoteNotifier::new(remote)?);
        if let Some((writer, _)) = &mut self.ends {
            writer.open(self.sent);
        }
        Ok(())
    }

    /// Whether what is to be written waits for the socket, and not for the other end to read.
    pub(super) fn wait_for_socket(&self) -> bool {
        self.remote.is_none() || self.is_congested
    }

    /// Whether all messages go through the rings.
    pub(super) fn are_in_use(&self) -> bool {
        self.remote.is_some() && self.is_reading()
    }

    /// Whether something can be read from the ring.
    #[inline]
    pub(super) fn have_unread(&self) -> bool {
        self.is_reading() && self.ends.as_ref().is_some_and(|(_, reader)| !reader.is_empty())
    }

    /// Whether the other end looks into its ring by itself, at this moment.
    pub(super) fn reader_is_awake(&self) -> bool {
        self.remote.is_some()
            && self.ends.as_ref().is_some_and(|(writer, _)| !writer.reader_sleeps())
    }

    /// Announces that this process is about to sleep. After that it must look once more for what has come.
    pub(super) fn announce_sleep(&mut self) {
        if let Some((_, reader)) = &mut self.ends {
            reader.announce_sleep();
        }
    }

    pub(super) fn end_sleep(&mut self) {
        if let Some((_, reader)) = &mut self.ends {
            reader.end_sleep();
        }
    }

    /// So many bytes will soon be sent.
    pub(super) fn expect(&self, count: usize) {
        if let Some((writer, _)) = &self.ends {
            writer.fetch(count);
        }
    }

    pub(super) fn send(&mut self, socket: &Socket, bytes: &[u8]) -> io::Result<usize> {
        self.send_with(socket, bytes, None)
    }

    /// Sends bytes, and perhaps a descriptor with the first of them.
    pub(super) fn send_with(
        &mut self,
        socket: &Socket,
        bytes: &[u8],
        descriptor: Option<BorrowedFd<'_>>,
    ) -> io::Result<usize> {
        if self.remote.is_some() {
            return self.write(socket, bytes, descriptor);
        }
        let count = match (&self.offer, descriptor) {
            (None, None) => socket.send(bytes)?,
            (None, Some(descriptor)) => socket.send_with(bytes, &[descriptor])?,
            (Some(file), None) => {
                socket.send_with(bytes, &[file.as_fd(), self.notifier.as_fd()])?
            }
            (Some(file), Some(descriptor)) => {
                socket.send_with(bytes, &[file.as_fd(), self.notifier.as_fd(), descriptor])?
            }
        };
        self.offer = None;
        self.sent += count as u64;
        Ok(count)
    }

    fn write(
        &mut self,
        socket: &Socket,
        bytes: &[u8],
        descriptor: Option<BorrowedFd<'_>>,
    ) -> io::Result<usize> {
        let (Some((writer, _)), Some(remote)) = (&mut self.ends, &self.remote) else {
            return Err(io::ErrorKind::NotConnected.into());
        };
        // The descriptor leaves first, and only if at least the beginning of its frame fits into the ring.
        let has_room = descriptor.is_none() || writer.has_room_or_waits().map_err(violation)?;
        if let Some(descriptor) = descriptor.filter(|_| has_room) {
            let sent = socket.send_with(&CARRIER, &[descriptor]);
            self.is_congested = sent.as_ref().is_err_and(is_transient);
            sent?;
        }
        let mut count = if has_room { writer.write(bytes).map_err(violation)? } else { 0 };
        if count == 0 {
            if !writer.has_room_or_waits().map_err(violation)? {
                // A process that has ended will not read.
                let kind = match is_hung_up(socket.as_fd()) {
                    true => io::ErrorKind::BrokenPipe,
                    false => io::ErrorKind::WouldBlock,
                };
                return Err(kind.into());
            }
            count = writer.write(bytes).map_err(violation)?;
        }
        if writer.take_sleeping_reader() {
            remote.notify();
        }
        Ok(count)
    }

    /// Receives bytes; also over the socket, as long as the other end still uses it.
    pub(super) fn receive(
        &mut self,
        socket: &Socket,
        buffer: &mut [u8],
        descriptors: &mut VecDeque<OwnedFd>,
    ) -> io::Result<usize> {
        if !self.is_reading() {
            return self.receive_before(socket, buffer, descriptors);
        }
        let count = self.read(buffer)?;
        if count > 0 {
            return Ok(count);
        }
        let carriers = self.receive_carriers(socket, descriptors)?;
        // A process that has ended may have written to the ring just before.
        match self.read(buffer)? {
            0 if carriers > 0 => Err(io::ErrorKind::WouldBlock.into()),
            count => Ok(count),
        }
    }

    /// Receives descriptors; the peer has sent them before the bytes that this end has read from the ring.
    pub(super) fn receive_carriers(
        &mut self,
        socket: &Socket,
        descriptors: &mut VecDeque<OwnedFd>,
    ) -> io::Result<usize> {
        if !self.is_reading() {
            return Ok(0);
        }
        let count = receive(socket, &mut [0; 64], descriptors)?;
        self.take_remote(descriptors)?;
        Ok(count)
    }

    fn receive_before(
        &mut self,
        socket: &Socket,
        buffer: &mut [u8],
        descriptors: &mut VecDeque<OwnedFd>,
    ) -> io::Result<usize> {
        let count = receive(socket, buffer, descriptors)?;
        self.take_remote(descriptors)?;
        if count == 0 {
            // A process that has ended may have begun to use the ring just before.
            return if self.is_reading() { self.read(buffer) } else { Ok(0) };
        }
        let opened = self.ends.as_ref().and_then(|(_, reader)| reader.opened());
        let before = opened.unwrap_or(u64::MAX).saturating_sub(self.received);
        // The bytes after these are carriers.
        let count = count.min(usize::try_from(before).unwrap_or(usize::MAX));
        self.received += count as u64;
        if count == 0 { Err(io::ErrorKind::WouldBlock.into()) } else { Ok(count) }
    }

    /// The first descriptor that answers an offer is a notifier.
    fn take_remote(&mut self, descriptors: &mut VecDeque<OwnedFd>) -> io::Result<()> {
        if self.remote.is_none()
            && self.ends.is_some()
            && let Some(remote) = descriptors.pop_front()
        {
            self.open(remote)?;
        }
        Ok(())
    }

    /// Whether this end now reads from the ring.
    #[inline]
    fn is_reading(&self) -> bool {
        self.ends.as_ref().is_some_and(|(_, reader)| reader.opened() == Some(self.received))
    }

    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let Some((_, reader)) = &mut self.ends else { return Ok(0) };
        let count = reader.read(buffer).map_err(violation)?;
        if count > 0 && reader.take_waiting_writer() {
            self.remote.iter().for_each(RemoteNotifier::notify);
        }
        Ok(count)
    }
}

/// Receives once. A process that ends before it has read everything resets the connection, which is an end,
/// too.
fn receive(
    socket: &Socket,
    buffer: &mut [u8],
    descriptors: &mut VecDeque<OwnedFd>,
) -> io::Result<usize> {
    match socket.receive(buffer, descriptors) {
        Err(error) if error.kind() == io::ErrorKind::ConnectionReset => Ok(0),
        received => received,
    }
}

fn violation(error: hprm_store::RingError) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, error)
}

/// Whether a later attempt will succeed.
fn is_transient(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted)
}

/// Whether the other end has closed the socket.
fn is_ended(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::BrokenPipe | io::ErrorKind::ConnectionReset)
}

#[cfg(test)]
mod tests;
