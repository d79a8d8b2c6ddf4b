//! A notifier between threads.

use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

use rustix::io::{read, write};
use rustix::pipe::{PipeFlags, pipe_with};

/// Wakes up a loop that waits on it. To be cleared before the loop looks for events.
#[derive(Debug)]
pub(crate) struct PipeNotifier {
    reader: OwnedFd,
    writer: OwnedFd,
}

impl PipeNotifier {
    pub(crate) fn new() -> io::Result<Self> {
        let (reader, writer) = pipe_with(PipeFlags::NONBLOCK | PipeFlags::CLOEXEC)?;
        Ok(Self { reader, writer })
    }

    pub(crate) fn notify(&self) {
        // Fails only when the pipe is full, and then the loop has been notified already.
        let _ = write(&self.writer, &[0]);
    }

    pub(crate) fn clear(&self) {
        // Fails only when it was not notified. Bytes that do not fit notify again.
        let _ = read(&self.reader, &mut [0; 256]);
    }
}

impl AsFd for PipeNotifier {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.reader.as_fd()
    }
}
