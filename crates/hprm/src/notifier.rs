//! Wakes up a loop when another process has written to memory that they share, or another thread of this one has.
//!
//! Each loop has one notifier, however many processes notify it. Each of them needs a [`RemoteNotifier`],
//! which is sent over a socket.

use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::sync::Arc;

use rustix::event::{EventfdFlags, eventfd};
use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};
use rustix::io::{read, write};

/// The notifier of a loop. Clones share one.
///
/// An eventfd, because it is one number, however often it is notified.
#[derive(Clone, Debug)]
pub(crate) struct Notifier(Arc<OwnedFd>);

/// Notifies the loop of another process.
#[derive(Debug)]
pub(crate) struct RemoteNotifier(OwnedFd);

impl Notifier {
    pub(crate) fn new() -> io::Result<Self> {
        Ok(Self(Arc::new(eventfd(0, EventfdFlags::NONBLOCK | EventfdFlags::CLOEXEC)?)))
    }

    /// From this process.
    pub(crate) fn notify(&self) {
        add_one(&self.0);
    }

    /// To be called before the loop looks for what the other process has written.
    pub(crate) fn clear(&self) {
        // Fails only when it was not notified.
        let _ = read(&*self.0, &mut [0; 8]);
    }
}

impl AsFd for Notifier {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}

impl RemoteNotifier {
    /// The descriptor that the other process has sent.
    pub(crate) fn new(fd: OwnedFd) -> io::Result<Self> {
        // Whatever descriptor it is: a notification must not block.
        fcntl_setfl(&fd, fcntl_getfl(&fd)? | OFlags::NONBLOCK)?;
        Ok(Self(fd))
    }

    pub(crate) fn notify(&self) {
        // If it is no notifier, the process that sent it does not wake up.
        add_one(&self.0);
    }
}

fn add_one(fd: impl AsFd) {
    // Fails otherwise only when it was notified very often, and then the loop wakes up anyway.
    let _ = write(fd, &1_u64.to_ne_bytes());
}
