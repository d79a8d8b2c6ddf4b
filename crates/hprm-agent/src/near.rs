//! What is at this end of a link: a process behind a socket, or the shipping service, which is a thread of this one.

use std::io::{self, Write};
use std::net::Shutdown;
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;

use hprm::agent::Answer;
use hprm::{Pipe, WantedLink};
use hprm_federated::relay::Bytes;
use rustix::buffer::spare_capacity;
use rustix::event::epoll::EventFlags;

use crate::local::answer;
use crate::waiting::{Registration, Watch};

/// See the module.
pub(crate) struct Near {
    what: What,
    /// Where the loop waits for what can be read, and for room; a socket has one descriptor for both, and the first of these.
    registrations: [Registration; 2],
}

enum What {
    Process(UnixStream),
    Shipping {
        pipe: Pipe,
        /// The answer that the service waits for, and its end of the pipe, which it gets once the link is open.
        opening: Option<(WantedLink, Pipe)>,
    },
}

impl Near {
    fn new(what: What, watch: &Watch) -> Self {
        Self { what, registrations: [watch.register(), watch.register()] }
    }

    /// A process behind a socket.
    pub(crate) fn process(socket: UnixStream, watch: &Watch) -> Self {
        Self::new(What::Process(socket), watch)
    }

    /// A link that another machine has opened to the shipping service here.
    pub(crate) fn shipping(pipe: Pipe, watch: &Watch) -> Self {
        Self::new(What::Shipping { pipe, opening: None }, watch)
    }

    /// One that the service wants, and what it gets once the link is open.
    pub(crate) fn wanted(pipe: Pipe, watch: &Watch, opening: (WantedLink, Pipe)) -> Self {
        Self::new(What::Shipping { pipe, opening: Some(opening) }, watch)
    }

    /// Says whether the link is open that was asked for.
    pub(crate) fn answer(&mut self, text: &Answer) {
        match &mut self.what {
            What::Process(socket) => answer(socket, text),
            What::Shipping { opening, .. } => {
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

    /// Waits for what can be read, and for room to write, or for neither: not even for the end of the process, which would be told
    /// again and again.
    pub(crate) fn wait_for(&mut self, reads: bool, writes: bool) -> io::Result<()> {
        let flags = |flag: EventFlags, waits: bool| if waits { flag } else { EventFlags::empty() };
        let [first, second] = &mut self.registrations;
        match &self.what {
            What::Process(socket) => {
                let both = flags(EventFlags::IN, reads) | flags(EventFlags::OUT, writes);
                first.set(socket.as_fd(), both)
            }
            What::Shipping { pipe, .. } => {
                first.set(pipe.to_take(), flags(EventFlags::IN, reads))?;
                second.set(pipe.to_give(), flags(EventFlags::IN, writes))
            }
        }
    }

    /// Reads what has come from there, at most so many bytes. None if nothing more will.
    pub(crate) fn read(&self, most: usize) -> io::Result<Option<Bytes>> {
        match &self.what {
            What::Process(socket) => {
                // It is read into what leaves, and as long as a frame may be: how much there is, is not known before.
                let mut frame = Vec::with_capacity(most);
                let len = rustix::io::read(socket, spare_capacity(&mut frame))?;
                frame.shrink_to_fit();
                Ok((len > 0).then(|| frame.into()))
            }
            What::Shipping { pipe, .. } => pipe.take(most),
        }
    }

    /// Whether it is likely that a read of so many bytes, for which there was that room, was all that is there.
    pub(crate) fn is_read_by(&self, len: usize, room: usize) -> bool {
        // The service's pieces have all lengths, and to look for the next one costs nothing.
        matches!(self.what, What::Process(_)) && len < room / 2
    }

    /// Writes what comes after so many bytes of a frame. Returns how much of that was written.
    pub(crate) fn write(&self, frame: &Bytes, taken: usize) -> io::Result<usize> {
        match &self.what {
            What::Process(socket) => (&*socket).write(&frame[taken..]),
            What::Shipping { pipe, .. } => {
                // It takes all or nothing.
                pipe.give(frame)?;
                Ok(frame.len() - taken)
            }
        }
    }

    /// Nothing more will be written.
    pub(crate) fn finish(&self) {
        match &self.what {
            // The process may be gone already.
            What::Process(socket) => drop(socket.shutdown(Shutdown::Write)),
            What::Shipping { pipe, .. } => pipe.finish(),
        }
    }
}

impl Drop for Near {
    /// The other end of a pipe may have its descriptors still.
    fn drop(&mut self) {
        // It fails only where nothing is waited for.
        let _ = self.wait_for(false, false);
    }
}
