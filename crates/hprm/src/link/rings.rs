//! Bytes to a process on the same machine: through rings in memory instead of its socket.
//!
//! Who opens a link to a Unix socket makes two rings, and sends their memory and its doorbell with the
//! first byte. Who is at the other end and trusts it answers with a doorbell of its own; from then on
//! bytes go through the rings. A direction begins with its socket and goes on in its ring, at a
//! position that the ring tells. Afterwards the socket still has two tasks: descriptors travel over it,
//! each with one byte that means nothing, sent before the frame that it belongs to is in the ring; and
//! its end tells that a process has ended, after which what is in the ring is still read.

use std::collections::VecDeque;
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

use hprm_core::limits::EAGER_BUFFER;
use hprm_store::{RING_CAPACITY, RingReader, RingWriter, map_ring_pair, ring_pair};

use super::socket::Socket;
use crate::doorbell::{Doorbell, Rope};
use crate::wait::is_hung_up;

/// What a descriptor travels with.
const CARRIER: [u8; 1] = [0];

/// A message that travels inside its frame fits.
const _: () = assert!(RING_CAPACITY >= EAGER_BUFFER);

/// This end of two rings, from before the other end knows them.
#[derive(Debug)]
pub(super) struct Rings {
    doorbell: Doorbell,
    ends: Option<(RingWriter, RingReader)>,
    /// Whether it is known whether there will be any.
    is_decided: bool,
    /// The memory of both, until it has been sent.
    offer: Option<OwnedFd>,
    /// Whether the other end still waits for this one's doorbell.
    owes_doorbell: bool,
    /// The other end's doorbell: if it is known, what is to be written goes into a ring.
    rope: Option<Rope>,
    /// How many bytes have gone through the socket, apart from carriers.
    sent: u64,
    received: u64,
    /// Whether a descriptor waits until the socket can be written.
    is_congested: bool,
}

impl Rings {
    /// For who has opened the link. Without memory for them (`ulimit -f` may forbid any), there are none,
    /// and the socket does it all.
    pub(super) fn offered(doorbell: Doorbell) -> Self {
        let mut rings = Self::expected(doorbell);
        rings.is_decided = true;
        if let Ok((writer, reader, file)) = ring_pair() {
            rings.ends = Some((writer, reader));
            rings.offer = Some(file);
        }
        rings
    }

    /// For who has been connected to.
    pub(super) fn expected(doorbell: Doorbell) -> Self {
        Self {
            doorbell,
            ends: None,
            is_decided: false,
            offer: None,
            owes_doorbell: false,
            rope: None,
            sent: 0,
            received: 0,
            is_congested: false,
        }
    }

    /// Takes the rings that the other end has offered, if this one trusts it: they are the first two
    /// descriptors that have come. Who offers none has a socket, and nothing else.
    pub(super) fn meet(
        &mut self,
        socket: &Socket,
        descriptors: &mut VecDeque<OwnedFd>,
    ) -> io::Result<()> {
        if !std::mem::replace(&mut self.is_decided, true) && descriptors.len() >= 2 {
            let mut offered = descriptors.drain(..2);
            let (file, rope) = (offered.next(), offered.next());
            let (Some(file), Some(rope)) = (file, rope) else { return Ok(()) };
            self.ends = Some(map_ring_pair(&file).map_err(io::Error::other)?);
            self.open(rope)?;
            self.owes_doorbell = true;
        }
        if self.owes_doorbell {
            match socket.send_with(&CARRIER, &[self.doorbell.as_fd()]) {
                Ok(_) => self.owes_doorbell = false,
                Err(error) if is_transient(&error) => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// What is written goes into the ring from now on.
    fn open(&mut self, rope: OwnedFd) -> io::Result<()> {
        self.rope = Some(Rope::new(rope)?);
        if let Some((writer, _)) = &mut self.ends {
            writer.open(self.sent);
        }
        Ok(())
    }

    /// Whether what is to be written waits for the socket, and not for the other end to read.
    pub(super) fn wait_for_socket(&self) -> bool {
        self.rope.is_none() || self.is_congested
    }

    /// Whether messages take no other way than through memory.
    pub(super) fn are_in_use(&self) -> bool {
        self.rope.is_some() && self.is_reading()
    }

    /// Whether something can be read from the ring.
    pub(super) fn have_unread(&self) -> bool {
        self.is_reading() && self.ends.as_ref().is_some_and(|(_, reader)| !reader.is_empty())
    }

    /// Says that this process is about to sleep. It must look once more after that.
    pub(super) fn fall_asleep(&mut self) {
        if let Some((_, reader)) = &mut self.ends {
            reader.announce_sleep();
        }
    }

    pub(super) fn wake_up(&mut self) {
        if let Some((_, reader)) = &mut self.ends {
            reader.end_sleep();
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
        if self.rope.is_some() {
            return self.write(socket, bytes, descriptor);
        }
        let count = match (&self.offer, descriptor) {
            (None, None) => socket.send(bytes)?,
            (None, Some(descriptor)) => socket.send_with(bytes, &[descriptor])?,
            (Some(file), None) => {
                socket.send_with(bytes, &[file.as_fd(), self.doorbell.as_fd()])?
            }
            (Some(file), Some(descriptor)) => {
                socket.send_with(bytes, &[file.as_fd(), self.doorbell.as_fd(), descriptor])?
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
        let (Some((writer, _)), Some(rope)) = (&mut self.ends, &self.rope) else {
            return Err(io::ErrorKind::NotConnected.into());
        };
        // A descriptor goes first, and only if its frame can begin to follow.
        let has_room = descriptor.is_none() || writer.has_room_or_waits().map_err(lie)?;
        if let Some(descriptor) = descriptor.filter(|_| has_room) {
            let sent = socket.send_with(&CARRIER, &[descriptor]);
            self.is_congested = sent.as_ref().is_err_and(is_transient);
            sent?;
        }
        let mut count = if has_room { writer.write(bytes).map_err(lie)? } else { 0 };
        if count == 0 {
            if !writer.has_room_or_waits().map_err(lie)? {
                // Who has ended will not read.
                let kind = match is_hung_up(socket.as_fd()) {
                    true => io::ErrorKind::BrokenPipe,
                    false => io::ErrorKind::WouldBlock,
                };
                return Err(kind.into());
            }
            count = writer.write(bytes).map_err(lie)?;
        }
        if writer.take_sleeping_reader() {
            rope.ring();
        }
        Ok(count)
    }

    /// Receives bytes; over the socket, too, as long as some come that way.
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
        // Who has ended may have written just before.
        match self.read(buffer)? {
            0 if carriers > 0 => Err(io::ErrorKind::WouldBlock.into()),
            count => Ok(count),
        }
    }

    /// Receives descriptors, which have been sent before what has been read from the ring.
    pub(super) fn receive_carriers(
        &mut self,
        socket: &Socket,
        descriptors: &mut VecDeque<OwnedFd>,
    ) -> io::Result<usize> {
        if !self.is_reading() {
            return Ok(0);
        }
        let count = receive(socket, &mut [0; 64], descriptors)?;
        self.take_rope(descriptors)?;
        Ok(count)
    }

    fn receive_before(
        &mut self,
        socket: &Socket,
        buffer: &mut [u8],
        descriptors: &mut VecDeque<OwnedFd>,
    ) -> io::Result<usize> {
        let count = receive(socket, buffer, descriptors)?;
        self.take_rope(descriptors)?;
        if count == 0 {
            // Who has ended may have begun with the ring just before.
            return if self.is_reading() { self.read(buffer) } else { Ok(0) };
        }
        let opened = self.ends.as_ref().and_then(|(_, reader)| reader.opened());
        let before = opened.unwrap_or(u64::MAX).saturating_sub(self.received);
        // What follows are carriers.
        let count = count.min(usize::try_from(before).unwrap_or(usize::MAX));
        self.received += count as u64;
        if count == 0 { Err(io::ErrorKind::WouldBlock.into()) } else { Ok(count) }
    }

    /// The first descriptor that answers an offer is a doorbell.
    fn take_rope(&mut self, descriptors: &mut VecDeque<OwnedFd>) -> io::Result<()> {
        if self.rope.is_none()
            && self.ends.is_some()
            && let Some(rope) = descriptors.pop_front()
        {
            self.open(rope)?;
        }
        Ok(())
    }

    /// Whether what comes now comes through the ring.
    fn is_reading(&self) -> bool {
        self.ends.as_ref().is_some_and(|(_, reader)| reader.opened() == Some(self.received))
    }

    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let Some((_, reader)) = &mut self.ends else { return Ok(0) };
        let count = reader.read(buffer).map_err(lie)?;
        if count > 0 && reader.take_waiting_writer() {
            self.rope.iter().for_each(Rope::ring);
        }
        Ok(count)
    }
}

/// Receives once. Who has ended without reading everything has ended, too.
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

fn lie(error: hprm_store::RingError) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, error)
}

/// Whether it will go later.
fn is_transient(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted)
}

#[cfg(test)]
mod tests;
