//! Following a process to its end: forwarding what it writes, then telling how it ended.
//!
//! One thread for each process waits for both its pipes and for its end at once. A process that
//! the followed one has left behind may hold the pipes open; that delays nothing.

use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::process::{ChildStderr, ChildStdout};

use rustix::event::{PollFd, PollFlags, poll};
use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};
use rustix::io::Errno;
use rustix::process::{Pid, PidfdFlags, WaitId, WaitIdOptions, pidfd_open, waitid};

use super::output::Lines;
use crate::console;
use crate::supervisor::{FederateEnding, Signal};

/// Bytes that are read at once: what a pipe holds.
const CHUNK: usize = 64 * 1024;

/// A process that other code has started and will reap.
#[derive(Debug)]
pub(super) struct Followed {
    pid: Pid,
    /// Readable once the process has ended.
    end: OwnedFd,
    streams: Vec<Stream>,
    /// Why the standard output of this process can no longer be written to.
    broken: Option<io::Error>,
}

/// Where a line goes.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Target {
    Output,
    Error,
}

#[derive(Debug)]
struct Stream {
    /// None once the other end is closed.
    pipe: Option<OwnedFd>,
    lines: Lines,
    target: Target,
}

impl Followed {
    /// Prepares to follow the process `pid`, which is called `name`, and what it writes to pipes.
    ///
    /// # Errors
    ///
    /// If the system cannot watch processes (Linux before 5.3), or has no descriptor left.
    pub(super) fn new(
        pid: Pid,
        name: &str,
        (output, error): (Option<ChildStdout>, Option<ChildStderr>),
    ) -> io::Result<Self> {
        let stream = |pipe: OwnedFd, target| -> io::Result<Stream> {
            fcntl_setfl(&pipe, fcntl_getfl(&pipe)? | OFlags::NONBLOCK)?;
            Ok(Stream { pipe: Some(pipe), lines: Lines::of(name), target })
        };
        let output = output.map(|pipe| stream(pipe.into(), Target::Output));
        let error = error.map(|pipe| stream(pipe.into(), Target::Error));
        let streams = output.into_iter().chain(error).collect::<io::Result<_>>()?;
        let end = pidfd_open(pid, PidfdFlags::empty())?;
        Ok(Self { pid, end, streams, broken: None })
    }

    /// Forwards everything until the process ends, and returns how it did. It still has to be
    /// reaped. Calls `broken` once if the output goes nowhere.
    pub(super) fn follow(mut self, broken: impl FnOnce(&io::Error)) -> FederateEnding {
        let mut broken = Some(broken);
        let mut buffer = vec![0; CHUNK];
        loop {
            // Asked before reading: what an ended process wrote is all there.
            let ended = self.wait();
            for stream in &mut self.streams {
                while stream.forward(&mut buffer, &mut self.broken) && ended {}
            }
            if let Some(error) = &self.broken
                && let Some(broken) = broken.take()
            {
                broken(error);
            }
            if ended {
                break;
            }
        }
        for stream in &mut self.streams {
            stream.finish(&mut self.broken);
        }
        self.ending()
    }

    /// Waits until there is something to read or the process has ended, and returns whether it has.
    fn wait(&self) -> bool {
        let fds = self.streams.iter().filter_map(|stream| stream.pipe.as_ref());
        let fds = std::iter::once(&self.end).chain(fds);
        let mut fds: Vec<_> = fds.map(|fd| PollFd::new(fd, PollFlags::IN)).collect();
        match poll(&mut fds, None) {
            Ok(_) => !fds[0].revents().is_empty(),
            Err(Errno::INTR) => false,
            Err(error) => unreachable!("poll of open descriptors: {error}"),
        }
    }

    fn ending(&self) -> FederateEnding {
        let options = WaitIdOptions::EXITED | WaitIdOptions::NOWAIT;
        loop {
            match waitid(WaitId::Pid(self.pid), options) {
                Ok(Some(status)) => {
                    let signal =
                        status.terminating_signal().map(|it| FederateEnding::Signal(Signal(it)));
                    let code = status.exit_status().map(FederateEnding::Code);
                    return signal.or(code).expect("an end is one of the two");
                }
                Ok(None) | Err(Errno::INTR) => {}
                // It was reaped elsewhere; nothing is known but that it has ended.
                Err(_) => return FederateEnding::Code(1),
            }
        }
    }
}

impl Stream {
    /// Forwards one chunk. Returns whether there may be more at once.
    fn forward(&mut self, buffer: &mut [u8], broken: &mut Option<io::Error>) -> bool {
        let Some(pipe) = &self.pipe else { return false };
        match read(pipe.as_fd(), buffer) {
            Ok(0) => {
                self.pipe = None;
                self.finish(broken);
                false
            }
            Ok(len) => {
                let lines = self.lines.take(&buffer[..len]);
                self.target.write(&lines, broken);
                true
            }
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => false,
            Err(_) => {
                self.pipe = None;
                false
            }
        }
    }

    fn finish(&mut self, broken: &mut Option<io::Error>) {
        let rest = self.lines.end();
        self.target.write(&rest, broken);
    }
}

impl Target {
    fn write(self, lines: &[u8], broken: &mut Option<io::Error>) {
        if lines.is_empty() {
            return;
        }
        match self {
            Self::Output if broken.is_some() => {}
            Self::Output => *broken = console::print(lines).err(),
            Self::Error => console::print_error(lines),
        }
    }
}

fn read(pipe: BorrowedFd<'_>, buffer: &mut [u8]) -> io::Result<usize> {
    loop {
        match rustix::io::read(pipe, &mut *buffer) {
            Err(Errno::INTR) => {}
            Ok(len) => return Ok(len),
            Err(error) => return Err(error.into()),
        }
    }
}
