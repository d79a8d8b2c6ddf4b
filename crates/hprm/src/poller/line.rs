//! One link, and reading what it holds. What its frames mean is up to the loops.

use std::io;
use std::os::fd::OwnedFd;

use hprm_federated::Frame;
use hprm_federated::codec::CodecError;

use crate::link::descriptors::is_shortage;
use crate::link::{Arrival, READS};
use crate::wire::Wire;

/// A link, and what is known of it without asking the kernel.
#[derive(Debug)]
pub(crate) struct Line {
    pub(crate) wire: Wire,
    /// Whether there may be something to read.
    is_ready: bool,
}

/// Why a link is not read any further.
#[derive(Debug)]
pub(crate) enum Broken {
    /// The link is of no use any more.
    Link(io::Error),
    /// What has come is no frame, or there is no memory for it.
    Frame(CodecError),
    /// This process lacks memory, or descriptors.
    Shortage(io::Error),
}

impl Line {
    pub(crate) fn new(wire: Wire) -> Self {
        // What came while it was opened is not news to the kernel.
        Self { wire, is_ready: true }
    }

    /// Whether there is something to read, or may be.
    pub(crate) fn may_be_read(&self) -> bool {
        self.is_ready || self.wire.has_unread()
    }

    /// Notes that there is something to read, perhaps.
    pub(crate) fn note(&mut self, is_ready: bool) {
        self.is_ready |= is_ready;
    }

    /// Reads what the link holds, up to a limit, if it may hold anything. Returns whether the other end is
    /// still open.
    ///
    /// # Errors
    ///
    /// If it cannot be read any further; what had come before has arrived.
    pub(crate) fn read(
        &mut self,
        mut arrive: impl FnMut(Frame, Option<OwnedFd>),
    ) -> Result<bool, Broken> {
        if !self.may_be_read() {
            return Ok(true);
        }
        self.is_ready = false;
        for _ in 0..READS {
            let arrival = self.wire.read().map_err(Broken::reading)?;
            while let Some((frame, descriptor)) = self.wire.next_frame().map_err(Broken::Frame)? {
                arrive(frame, descriptor);
            }
            match arrival {
                Arrival::Bytes => {}
                Arrival::Rest | Arrival::Nothing => return Ok(true),
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
