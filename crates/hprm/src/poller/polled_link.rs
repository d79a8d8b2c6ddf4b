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

    /// Reads what the link holds, up to a limit, and gives each frame to `arrive`: to be called if it
    /// [may hold anything](Self::may_be_read). Returns whether the other end is still open.
    ///
    /// # Errors
    ///
    /// If the link cannot be read any further; `arrive` has got the frames before that.
    pub(crate) fn read(
        &mut self,
        mut arrive: impl FnMut(Frame, Option<OwnedFd>),
    ) -> Result<bool, Broken> {
        self.is_ready = false;
        for _ in 0..READS {
            let arrival = self.link.read();
            // Also if the read has failed: these frames came before that.
            while let Some((frame, descriptor)) = self.link.next_frame().map_err(Broken::Frame)? {
                arrive(frame, descriptor);
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
