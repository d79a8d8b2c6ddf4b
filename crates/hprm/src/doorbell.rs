//! What wakes a loop when another process has left something for it in memory that they share.
//!
//! Each loop has one doorbell, however many others ring it. Whoever rings needs a [`Rope`], which
//! travels over a socket.

use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::sync::Arc;

use rustix::event::{EventfdFlags, eventfd};
use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};
use rustix::io::{read, write};

/// The doorbell of a loop. Clones are one doorbell.
///
/// An eventfd, because it is one number, however often it is rung.
#[derive(Clone, Debug)]
pub(crate) struct Doorbell(Arc<OwnedFd>);

/// What rings the doorbell of another process.
#[derive(Debug)]
pub(crate) struct Rope(OwnedFd);

impl Doorbell {
    pub(crate) fn new() -> io::Result<Self> {
        Ok(Self(Arc::new(eventfd(0, EventfdFlags::NONBLOCK | EventfdFlags::CLOEXEC)?)))
    }

    /// Before looking for what the ringer has left.
    pub(crate) fn silence(&self) {
        // Fails only when nobody has rung.
        let _ = read(&*self.0, &mut [0; 8]);
    }
}

impl AsFd for Doorbell {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}

impl Rope {
    /// What the other process has sent.
    pub(crate) fn new(fd: OwnedFd) -> io::Result<Self> {
        // Whatever it is: to ring must not block.
        fcntl_setfl(&fd, fcntl_getfl(&fd)? | OFlags::NONBLOCK)?;
        Ok(Self(fd))
    }

    pub(crate) fn ring(&self) {
        // Fails only when it has been rung very often, and then it rings; or if it is no doorbell,
        // and then whoever sent it wants to sleep.
        let _ = write(&self.0, &1_u64.to_ne_bytes());
    }
}
