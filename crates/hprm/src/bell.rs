//! A descriptor that one thread rings and another waits on.

use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

use rustix::io::{read, write};
use rustix::pipe::{PipeFlags, pipe_with};

/// Wakes a loop that waits on it. Silence it before looking for what the ringer has left.
///
/// A pipe, so that whoever can only write a byte can ring it too: a signal handler.
#[derive(Debug)]
pub(crate) struct Bell {
    ear: OwnedFd,
    rope: OwnedFd,
}

impl Bell {
    pub(crate) fn new() -> io::Result<Self> {
        let (ear, rope) = pipe_with(PipeFlags::NONBLOCK | PipeFlags::CLOEXEC)?;
        Ok(Self { ear, rope })
    }

    pub(crate) fn ring(&self) {
        // Fails only when the pipe is full, and then the bell has been ringing for long.
        let _ = write(&self.rope, &[0]);
    }

    pub(crate) fn silence(&self) {
        // Fails only when nobody has rung. What does not fit goes on ringing.
        let _ = read(&self.ear, &mut [0; 256]);
    }

    /// Where a byte rings it.
    pub(crate) fn rope(&self) -> BorrowedFd<'_> {
        self.rope.as_fd()
    }
}

impl AsFd for Bell {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.ear.as_fd()
    }
}
