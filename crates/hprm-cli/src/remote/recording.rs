//! What a federate of another machine records for the trace of its run: the starter sends it while it comes, and the
//! stand-in writes it where those of this machine have theirs.
//!
//! It travels during the run, so that the trace has what was recorded until a moment before a machine is gone. The stand-in
//! also asks again and again what the clock there shows. What becomes of all that is up to the library (`hprm::recorder`).

use std::io;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use hprm::recorder::{Outbox, RemoteShare, SHARE_LIMIT, TraceRequest};
use hprm::{Clock, nanoseconds};
use hprm_core::{FederateId, PhysicalTime};

use super::protocol::Told;
use crate::message::{self, Error};

/// How long a record waits at most until it is sent.
const PERIOD: Duration = Duration::from_millis(100);

/// How many bytes are sent at once: messages of the federation wait for no more where the network is slow.
const PIECE: usize = 16 << 10;

/// How often clocks are compared: so many times before the federate starts, when nothing else is on its way, and then once in
/// that time.
const ROUNDS: u32 = 8;
const PAUSE: Duration = Duration::from_secs(1);

/// The sending of what a federate records, on a thread of its own.
pub(super) struct Sending {
    /// Ends the thread once all is sent, when it is dropped.
    stop: Sender<()>,
    thread: JoinHandle<()>,
}

impl Sending {
    /// Begins to send, by `tell`.
    pub(super) fn start(
        outbox: Outbox,
        tell: impl Fn(&Told) -> io::Result<()> + Send + 'static,
    ) -> Self {
        let (stop, stopped) = channel();
        let thread = thread::spawn(move || {
            let mut outgoing = Outgoing { outbox, tell, left: SHARE_LIMIT, beat: Instant::now() };
            loop {
                let is_last = stopped.recv_timeout(PERIOD) == Err(RecvTimeoutError::Disconnected);
                // Without a link, the federate is about to be ended.
                if outgoing.send().is_err() || is_last {
                    return;
                }
            }
        });
        Self { stop, thread }
    }

    /// Sends what there still is; the federate has ended.
    pub(super) fn finish(self) {
        let Self { stop, thread } = self;
        drop(stop);
        // What has not been sent, the stand-in misses.
        let _ = thread.join();
    }
}

/// What the thread does.
struct Outgoing<T> {
    outbox: Outbox,
    tell: T,
    /// How many more bytes a stand-in takes.
    left: u64,
    /// When something was sent last.
    beat: Instant,
}

impl<T: Fn(&Told) -> io::Result<()>> Outgoing<T> {
    /// Sends what has come. What is too much is taken away all the same, so that it needs no room.
    fn send(&mut self) -> io::Result<()> {
        let mut buffer = vec![0; PIECE];
        loop {
            let count = self.outbox.take(&mut buffer)?;
            let sent = count.min(usize::try_from(self.left).unwrap_or(usize::MAX));
            self.left -= sent as u64;
            // Where nothing comes, the stand-in still is to compare clocks.
            if sent > 0 || self.beat.elapsed() >= PAUSE {
                (self.tell)(&Told::Recorded(buffer[..sent].to_vec()))?;
                self.beat = Instant::now();
            }
            if count == 0 {
                return Ok(());
            }
        }
    }
}

/// The writing of what a federate has recorded on another machine.
pub(super) struct Writing {
    request: TraceRequest,
    federate: FederateId,
    name: String,
    machine: String,
    /// Once something is known; none again if it cannot be written.
    share: Option<RemoteShare>,
    /// When the other clock was asked for last, by the one here.
    asked: i64,
}

impl Writing {
    /// For a federate on `machine`, if this process is asked for a share of a trace.
    pub(super) fn wanted(federate: (u16, &str), machine: &str) -> Option<Self> {
        let request = TraceRequest::of_this_process().filter(|request| request.is_share)?;
        let (federate, name) = (FederateId(federate.0), federate.1.to_owned());
        let machine = machine.to_owned();
        Some(Self { request, federate, name, machine, share: None, asked: 0 })
    }

    /// How many records the federate is to keep for each thread at most.
    pub(super) fn capacity(&self) -> u64 {
        self.request.capacity as u64
    }

    /// Begins, and compares the clocks: `ask` asks for the time there, and returns it.
    ///
    /// # Errors
    ///
    /// As `ask` does.
    pub(super) fn begin<E>(&mut self, mut ask: impl FnMut(i64) -> Result<i64, E>) -> Result<(), E> {
        let federate = (self.federate, &*self.name);
        match RemoteShare::create(&self.request, federate, &self.machine) {
            Ok(share) => self.share = Some(share),
            Err(error) => self.give_up(&error),
        }
        for _ in 0..ROUNDS {
            self.asked = Clock::local().0;
            let shown = ask(self.asked)?;
            self.answered(self.asked, shown);
        }
        Ok(())
    }

    /// More has come of what the federate records.
    pub(super) fn take(&mut self, bytes: &[u8]) {
        self.write(|share| share.add(bytes));
    }

    /// The time here, if it is time to ask for that there.
    pub(super) fn question(&mut self) -> Option<i64> {
        let now = Clock::local();
        let is_due = now.since(PhysicalTime(self.asked)) >= nanoseconds(PAUSE);
        let question = is_due.then_some(now.0).filter(|_| self.share.is_some())?;
        self.asked = question;
        Some(question)
    }

    /// The clock there has shown something.
    pub(super) fn answered(&mut self, asked: i64, shown: i64) {
        if asked == self.asked {
            let now = Clock::local().0;
            self.write(|share| share.compare([asked, shown, now]));
        }
    }

    /// Nothing more comes.
    pub(super) fn end(&mut self, is_whole: bool) {
        self.write(|share| share.end(is_whole));
    }

    fn write(&mut self, what: impl FnOnce(&mut RemoteShare) -> io::Result<()>) {
        let Some(share) = &mut self.share else { return };
        if let Err(error) = what(share) {
            self.share = None;
            self.give_up(&error);
        }
    }

    /// The run goes on: it does not depend on its trace.
    fn give_up(&self, error: &io::Error) {
        let Self { name, machine, .. } = self;
        let why = message::reason(error);
        Error::new(format!("cannot write what {name} on {machine} records for the trace: {why}"))
            .show_as_warning();
    }
}

#[cfg(test)]
mod tests {
    use std::fs::File;
    use std::io::Write;
    use std::sync::mpsc::Receiver;

    use super::*;

    fn recorded(told: &Receiver<Told>) -> Vec<u8> {
        let bytes = told.iter().map(|told| match told {
            Told::Recorded(bytes) => bytes,
            other => panic!("{other:?}"),
        });
        bytes.collect::<Vec<_>>().concat()
    }

    #[test]
    fn what_was_recorded_is_sent_while_it_comes_and_at_the_end() {
        let folder = tempfile::tempdir().unwrap();
        let outbox = Outbox::create(folder.path().join("trace")).unwrap();
        let request = outbox.request(8);
        let (tell, told) = channel();
        let sending = Sending::start(outbox, move |it: &Told| {
            tell.send(it.clone()).map_err(|_| io::ErrorKind::BrokenPipe.into())
        });
        let mut share = File::create(request.path.join("federate-0")).unwrap();
        share.write_all(&[1; 100_000]).unwrap();
        let first = told.recv_timeout(Duration::from_secs(30)).unwrap();
        let Told::Recorded(first) = first else { panic!("{first:?}") };
        assert!((1..=PIECE).contains(&first.len()));
        share.write_all(&[2; 100_000]).unwrap();
        sending.finish();
        let all = [first, recorded(&told)].concat();
        assert_eq!(all, [[1; 100_000], [2; 100_000]].concat());
    }

    #[test]
    fn what_is_too_much_is_not_sent() {
        let folder = tempfile::tempdir().unwrap();
        let outbox = Outbox::create(folder.path().join("trace")).unwrap();
        let mut share = File::create(outbox.request(8).path.join("federate-0")).unwrap();
        share.write_all(&[1; 100_000]).unwrap();
        let (tell, told) = channel();
        let tell = move |it: &Told| {
            let _ = tell.send(it.clone());
            Ok(())
        };
        let mut outgoing = Outgoing { outbox, tell, left: 50_000, beat: Instant::now() };
        outgoing.send().unwrap();
        share.write_all(&[1; 100_000]).unwrap();
        outgoing.send().unwrap();
        assert_eq!((outgoing.left, outgoing.outbox.take(&mut [0; 9]).unwrap()), (0, 0));
        drop(outgoing);
        assert_eq!(recorded(&told).len(), 50_000);
    }
}
