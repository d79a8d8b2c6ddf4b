//! What is at this end of a link: a process behind a socket, or the shipping service, which is a thread of this one.

use std::io::{self, Write};
use std::net::Shutdown;
use std::os::unix::net::UnixStream;

use hprm::agent::Answer;
use hprm::{Pipe, WantedLink};
use hprm_federated::relay::Bytes;
use rustix::buffer::spare_capacity;
use rustix::event::{PollFd, PollFlags};

use crate::local::answer;

/// See the module.
pub(crate) enum Near {
    Process(UnixStream),
    Shipping {
        pipe: Pipe,
        /// The answer that the service waits for, and its end of the pipe, which it gets once the link is open.
        opening: Option<(WantedLink, Pipe)>,
    },
}

impl Near {
    /// A link that another machine has opened to the shipping service here.
    pub(crate) fn shipping(pipe: Pipe) -> Self {
        Self::Shipping { pipe, opening: None }
    }

    /// One that the service wants.
    pub(crate) fn wanted(pipe: Pipe, wanted: WantedLink, theirs: Pipe) -> Self {
        Self::Shipping { pipe, opening: Some((wanted, theirs)) }
    }

    /// Says whether the link is open that was asked for.
    pub(crate) fn answer(&mut self, text: &Answer) {
        match self {
            Self::Process(socket) => answer(socket, text),
            Self::Shipping { opening, .. } => {
                let Some((wanted, theirs)) = opening.take() else { return };
                wanted.answer(match text {
                    Answer::Done(_) => Ok(theirs),
                    Answer::Absent(why) | Answer::Refused(why) => {
                        Err(io::Error::other(why.clone()))
                    }
                });
            }
        }
    }

    /// What to wait for, to read and to write.
    pub(crate) fn interests(&self, reads: bool, writes: bool) -> [Option<PollFd<'_>>; 2] {
        match self {
            Self::Process(socket) => {
                let mut flags = PollFlags::empty();
                flags.set(PollFlags::IN, reads);
                flags.set(PollFlags::OUT, writes);
                // Without a flag, the end of the process would be told again and again.
                [(!flags.is_empty()).then(|| PollFd::new(socket, flags)), None]
            }
            Self::Shipping { pipe, .. } => {
                let wait = |fd| PollFd::from_borrowed_fd(fd, PollFlags::IN);
                [reads.then(|| wait(pipe.to_take())), writes.then(|| wait(pipe.to_give()))]
            }
        }
    }

    /// Reads what has come from there, at most so many bytes. None if nothing more will.
    pub(crate) fn read(&self, most: usize) -> io::Result<Option<Bytes>> {
        match self {
            Self::Process(socket) => {
                // It is read into what leaves, and as long as a frame may be: how much there is, is not known before.
                let mut frame = Vec::with_capacity(most);
                let len = rustix::io::read(socket, spare_capacity(&mut frame))?;
                frame.shrink_to_fit();
                Ok((len > 0).then(|| frame.into()))
            }
            Self::Shipping { pipe, .. } => pipe.take(most),
        }
    }

    /// Whether it is likely that a read of so many bytes, for which there was that room, was all that is there.
    pub(crate) fn is_read_by(&self, len: usize, room: usize) -> bool {
        // The service's pieces have all lengths, and to look for the next one costs nothing.
        matches!(self, Self::Process(_)) && len < room / 2
    }

    /// Writes what comes after so many bytes of a frame. Returns how much of that was written.
    pub(crate) fn write(&self, frame: &Bytes, taken: usize) -> io::Result<usize> {
        match self {
            Self::Process(socket) => (&*socket).write(&frame[taken..]),
            Self::Shipping { pipe, .. } => {
                // It takes all or nothing.
                pipe.give(frame)?;
                Ok(frame.len() - taken)
            }
        }
    }

    /// Nothing more will be written.
    pub(crate) fn finish(&self) {
        match self {
            // The process may be gone already.
            Self::Process(socket) => drop(socket.shutdown(Shutdown::Write)),
            Self::Shipping { pipe, .. } => pipe.finish(),
        }
    }
}
