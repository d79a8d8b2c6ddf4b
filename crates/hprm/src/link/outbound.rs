//! What is to be written to a link: frames in order, each with the descriptor that it travels with.
//!
//! Short frames become bytes at once, in one buffer, so that one write takes many of them. A long message stays
//! as it is until the frames before it have left, and then becomes bytes part by part: memory never holds it
//! twice.

use std::collections::{BTreeMap, VecDeque};
use std::io;
use std::os::fd::{AsFd, OwnedFd};

use hprm_core::limits::EAGER_BUFFER;
use hprm_federated::Frame;
use hprm_federated::codec::{self, Outgoing};

use super::stream::Stream;
use super::stream_link::no_memory;

/// Frames that have not left yet.
#[derive(Debug, Default)]
pub(super) struct Outbound {
    buffer: Vec<u8>,
    written: usize,
    /// Whether the other end took no more the last time.
    clogged: bool,
    /// Descriptors, by the position of the frame that they travel with.
    descriptors: BTreeMap<usize, OwnedFd>,
    /// The message whose parts follow what is in the buffer.
    long: Option<Box<Outgoing>>,
    /// The frames that follow that message.
    waiting: VecDeque<(Frame, Option<OwnedFd>)>,
}

impl Outbound {
    /// Makes room for eager messages.
    pub(super) fn prepare(&mut self) {
        self.buffer.reserve(EAGER_BUFFER);
    }

    /// Appends a frame. If there is no memory for it now, it waits until others have left.
    pub(super) fn queue(&mut self, frame: Frame, descriptor: Option<OwnedFd>) {
        self.compact();
        if self.long.is_some() || !self.waiting.is_empty() {
            self.waiting.push_back((frame, descriptor));
            return;
        }
        if Outgoing::is_for(&frame) {
            self.long = Outgoing::cut(frame).ok().map(Box::new);
            return;
        }
        let start = self.buffer.len();
        match codec::encode(&frame, &mut self.buffer) {
            Ok(()) => self.travels(start, descriptor),
            Err(_) => self.waiting.push_back((frame, descriptor)),
        }
    }

    /// Notes the descriptor that travels with the frame at a position, if one does.
    fn travels(&mut self, start: usize, descriptor: Option<OwnedFd>) {
        if let Some(descriptor) = descriptor {
            self.descriptors.insert(start, descriptor);
        }
    }

    /// Makes bytes of what is next, if all before it has left. Returns whether there is anything to
    /// write.
    ///
    /// # Errors
    ///
    /// If there is no memory for it.
    pub(super) fn fill(&mut self) -> io::Result<bool> {
        if self.written < self.buffer.len() {
            return Ok(true);
        }
        self.start_over();
        while self.buffer.len() < EAGER_BUFFER {
            if let Some(long) = &mut self.long {
                if !long.write(&mut self.buffer).map_err(no_memory)? {
                    self.long = None;
                }
                continue;
            }
            let Some((frame, descriptor)) = self.waiting.pop_front() else { break };
            match Outgoing::cut(frame) {
                Ok(long) => self.long = Some(Box::new(long)),
                Err(frame) => {
                    let start = self.buffer.len();
                    codec::encode(&frame, &mut self.buffer).map_err(no_memory)?;
                    self.travels(start, descriptor);
                }
            }
        }
        Ok(!self.buffer.is_empty())
    }

    /// Whether there is anything to write.
    pub(super) fn is_some(&self) -> bool {
        self.written < self.buffer.len() || self.is_long() || !self.waiting.is_empty()
    }

    /// Whether a long message is leaving.
    pub(super) fn is_long(&self) -> bool {
        self.long.is_some()
    }

    /// How many bytes there are, unless the other end took no more the last time.
    pub(super) fn writable_len(&self) -> usize {
        match self.clogged {
            true => 0,
            false => self.buffer.len() - self.written + usize::from(self.is_long()) * EAGER_BUFFER,
        }
    }

    /// Writes once.
    pub(super) fn write(&mut self, stream: &mut Stream) -> io::Result<usize> {
        if self.descriptors.is_empty() {
            let sent = stream.send(&self.buffer[self.written..]);
            self.clogged = is_full(&sent);
            let count = sent?;
            self.written += count;
            return Ok(count);
        }
        self.write_to_descriptor(stream)
    }

    /// The same where a frame has a descriptor: it goes with the first byte of its frame, so a write starts or ends
    /// there.
    fn write_to_descriptor(&mut self, stream: &mut Stream) -> io::Result<usize> {
        let next = self.descriptors.range(self.written + 1..).next();
        let until = next.map_or(self.buffer.len(), |(at, _)| *at);
        let bytes = &self.buffer[self.written..until];
        let sent = match self.descriptors.get(&self.written) {
            Some(descriptor) => stream.send_with(bytes, descriptor.as_fd()),
            None => stream.send(bytes),
        };
        self.clogged = is_full(&sent);
        let count = sent?;
        if count > 0 {
            self.descriptors.remove(&self.written);
        }
        self.written += count;
        Ok(count)
    }

    /// Removes what has left, once that is the larger half: for a reader that always lags a little, the buffer
    /// would otherwise keep all of it.
    fn compact(&mut self) {
        if self.written > EAGER_BUFFER && self.written > self.buffer.len() / 2 {
            self.buffer.drain(..self.written);
            let descriptors = std::mem::take(&mut self.descriptors).into_iter();
            self.descriptors = descriptors.map(|(at, fd)| (at - self.written, fd)).collect();
            self.written = 0;
        }
    }

    /// Discards everything.
    pub(super) fn clear(&mut self) {
        self.long = None;
        self.waiting.clear();
        self.clogged = false;
        self.start_over();
    }

    /// Discards the bytes.
    fn start_over(&mut self) {
        // Most messages have none, and to clear a map that is empty takes it apart all the same.
        if !self.descriptors.is_empty() {
            self.descriptors.clear();
        }
        self.buffer.clear();
        self.written = 0;
        if self.buffer.capacity() > 8 * EAGER_BUFFER {
            self.buffer = Vec::with_capacity(EAGER_BUFFER);
        }
    }
}

/// Whether the other end takes no more at the moment.
fn is_full(sent: &io::Result<usize>) -> bool {
    sent.as_ref().is_err_and(|it| it.kind() == io::ErrorKind::WouldBlock)
}
