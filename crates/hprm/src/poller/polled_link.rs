//! One link that a loop polls, and how the loop reads it. The loops decide what its frames mean.

use std::io;
use std::os::fd::{AsFd, OwnedFd};

use hprm_federated::Frame;
use hprm_federated::codec::CodecError;

use crate::link::descriptors::is_shortage;
use crate::link::{Arrival, Link, READS};
use crate::wait::{Interest, Source, SourceId};

/// A link, and whether it may be ready, which the loop knows without asking the kernel.
#[derive(Debug)]
pub(crate) struct PolledLink {
    pub(crate) link: Link,
    id: SourceId,
    /// Whether there may be something to read.
    is_ready: bool,
}

/// What takes the frames that a link brings. A closure does, if it has nothing to gain from what sort they are.
pub(crate) trait Arrivals {
    /// A frame has come, with the descriptor that it carries.
    fn frame(&mut self, frame: Frame, descriptor: Option<OwnedFd>);

    /// A plain message has come, which most frames are.
    #[inline]
    fn message(&mut self, message: Frame) {
        self.frame(message, None);
    }
}

impl<F: FnMut(Frame, Option<OwnedFd>)> Arrivals for F {
    fn frame(&mut self, frame: Frame, descriptor: Option<OwnedFd>) {
        self(frame, descriptor);
    }
}

/// Why a link is not read any further.
#[derive(Debug)]
pub(crate) enum Broken {
    /// The link cannot be used any more.
    Link(io::Error),
    /// What has come is not a frame, or there is no memory for it.
    Frame(CodecError),
    /// This process lacks memory, or descriptors.
    Shortage(io::Error),
}

impl PolledLink {
    pub(crate) fn new(link: Link) -> Self {
        // The kernel does not report again what came while the link was opened.
        Self { link, id: SourceId::new(), is_ready: true }
    }

    /// Whether there may be something to read.
    #[inline]
    pub(crate) fn may_be_read(&self) -> bool {
        self.is_ready || self.link.has_unread()
    }

    /// What to wait for.
    pub(crate) fn source(&self) -> Source<'_> {
        let interest = Interest { fd: self.link.as_fd(), write: self.link.waits_for_socket() };
        Source::new(self.id, interest)
    }

    /// Notes whether the kernel, or the loop, has found that there may be something to read.
    pub(crate) fn note(&mut self, is_ready: bool) {
        self.is_ready |= is_ready;
    }

    /// Reads what the link holds, up to a limit, and tells each frame: to be called if it
    /// [may hold anything](Self::may_be_read). Returns whether the other end is still open.
    ///
    /// # Errors
    ///
    /// If the link cannot be read any further; `arrivals` has got the frames before that.
    pub(crate) fn read(&mut self, mut arrivals: impl Arrivals) -> Result<bool, Broken> {
        self.is_ready = false;
        for _ in 0..READS {
            let arrival = self.link.read();
            // Also if the read has failed: these frames came before that.
            loop {
                // Apart, because a message that is made where it goes is not moved.
                while let Some(message) = self.link.next_plain_message() {
                    arrivals.message(message);
                }
                let next = self.link.next_frame().map_err(Broken::Frame)?;
                let Some((frame, descriptor)) = next else { break };
                arrivals.frame(frame, descriptor);
            }
            match arrival.map_err(Broken::reading)? {
                Arrival::Bytes => {}
                Arrival::LastBytes | Arrival::Nothing => return Ok(true),
                Arrival::Closed => return Ok(false),
            }
        }
        self.is_ready = true;
        Ok(true)
    }
}

impl Broken {
    fn reading(error: io::Error) -> Self {
        if error.kind() == io::ErrorKind::OutOfMemory || is_shortage(&error) {
            Self::Shortage(error)
        } else {
            Self::Link(error)
        }
    }
}
