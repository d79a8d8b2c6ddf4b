//! One end of a link between machines: a relayed link, and what is at this end (`near.rs`).

use std::collections::VecDeque;
use std::io;

use hprm::agent::Answer;
use hprm::printable;
use hprm_core::PhysicalTime;
use hprm_federated::relay::{Bytes, End, Input, Output, Relay};

use crate::carrier::{FRAME, Way};
use crate::near::Near;
use crate::telling::tell;

/// See the module.
pub(crate) struct Link {
    /// Which life of this end it is, and the machine of that life, which begins when the link is open.
    epoch: u64,
    relay: Relay,
    way: Way,
    /// Which link it is, for people.
    what: String,
    /// The process at this end, as long as it is there.
    near: Option<Near>,
    /// Whether the process at the other end is known to be there.
    is_open: bool,
    /// Whether it sends no more.
    has_finished: bool,
    /// What this end's process has not taken, and how much of the first of it it has.
    unread: VecDeque<Bytes>,
    taken: usize,
    /// Whether it takes nothing any more.
    is_deaf: bool,
    /// Whether the other end sends no more, and whether the process knows.
    is_finished: bool,
    has_told: bool,
    ended: Option<End>,
    /// Whether something has come of which nothing has been made yet.
    is_behind: bool,
}

impl Link {
    /// A link whose other end may not be there yet, with the number of the life of this one.
    pub(crate) fn new(epoch: u64, way: Way, what: String, near: Near) -> Self {
        Self {
            epoch,
            // Nothing leaves it before the link is open, but that it never will be.
            relay: Relay::new(epoch, PhysicalTime::FOREVER),
            way,
            what,
            near: Some(near),
            is_open: false,
            has_finished: false,
            unread: VecDeque::new(),
            taken: 0,
            is_deaf: false,
            is_finished: false,
            has_told: false,
            ended: None,
            is_behind: false,
        }
    }

    /// The process at the other end is there. Silence counts from now on, however long it took to open the link.
    pub(crate) fn opened(&mut self, now: PhysicalTime) {
        if self.ended.is_none() {
            self.is_open = true;
            self.relay = Relay::new(self.epoch, now);
        }
    }

    /// Ends what is at this end, and touches nothing of Zenoh, which has failed.
    pub(crate) fn leave_carrier(self) {
        std::mem::forget(self.way);
    }

    /// Sends another way from now on.
    pub(crate) fn redirect(&mut self, way: Way) {
        self.way = way;
    }

    /// Whether the process at the other end is known to be there.
    pub(crate) fn is_open(&self) -> bool {
        self.is_open
    }

    /// Tells the process at this end, which has asked for the link, whether it is open.
    pub(crate) fn answer(&mut self, opened: &Answer) {
        self.near.iter_mut().for_each(|near| near.answer(opened));
    }

    /// Waits at this end for what there is to read and to write.
    pub(crate) fn wait_for_near(&mut self) -> io::Result<()> {
        let reads = self.is_open && !self.has_finished && self.relay.room() > 0;
        let writes = self.is_open && !self.unread.is_empty();
        self.near.as_mut().map_or(Ok(()), |near| near.wait_for(reads, writes))
    }

    /// How much is on its way to the other end, in bytes, each frame counted as some thousand at least.
    pub(crate) fn in_flight(&self) -> u64 {
        self.relay.in_flight()
    }

    pub(crate) fn next_wakeup(&self) -> PhysicalTime {
        match self.is_open || self.ended.is_some() {
            true => self.relay.next_wakeup(),
            false => PhysicalTime::FOREVER,
        }
    }

    /// Whether nothing of the link is left.
    pub(crate) fn is_over(&self, now: PhysicalTime) -> bool {
        self.relay.is_over(now) && self.near.is_none()
    }

    /// Takes what has happened to the link, and does what follows. Before it is open, the other agent may not know it, and
    /// would say so to whatever it is sent.
    pub(crate) fn handle(&mut self, now: PhysicalTime, input: Input) {
        if !self.is_open && self.ended.is_none() && !matches!(input, Input::Abort(_)) {
            return;
        }
        self.take(now, input);
        self.proceed(now);
    }

    /// Takes a packet. What follows is done when all packets have been taken that are there: one answer is enough.
    pub(crate) fn packet(&mut self, now: PhysicalTime, packet: Bytes) {
        if self.is_open || self.ended.is_some() {
            self.take(now, Input::Packet(packet));
            self.is_behind = true;
        }
    }

    /// Does what follows from packets.
    pub(crate) fn catch_up(&mut self, now: PhysicalTime) {
        if std::mem::take(&mut self.is_behind) {
            self.proceed(now);
        }
    }

    fn take(&mut self, now: PhysicalTime, input: Input) {
        // Only frames can be refused, and those are no longer than there is room.
        let _ = self.relay.handle(now, input);
    }

    /// The agent ends, and tells the other end.
    pub(crate) fn abort_at_last(&mut self, now: PhysicalTime, why: String) {
        self.way.insist();
        self.handle(now, Input::Abort(why));
    }

    /// The process at this end may have written something, or takes more. What is read of it is taken from `most`, the bytes
    /// that may be.
    pub(crate) fn near_ready(&mut self, now: PhysicalTime, most: &mut u64) {
        self.read(now, most);
        self.proceed(now);
    }

    /// Reads what the process sends, as far as the link takes it.
    fn read(&mut self, now: PhysicalTime, most: &mut u64) {
        while !self.has_finished && self.relay.room() > 0 && *most > 0 {
            let Some(near) = self.near.as_ref() else { return };
            let room = self.relay.room().min(FRAME);
            match near.read(room) {
                Ok(None) => self.finish(now),
                Ok(Some(frame)) => {
                    let was_all = near.is_read_by(frame.len(), room);
                    *most = most.saturating_sub(frame.len() as u64);
                    self.handle(now, Input::Frame(frame));
                    if was_all {
                        // There was no more of it, or the next wait says so.
                        return;
                    }
                }
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                // The process has ended, and has not read all that it was sent.
                Err(_) => self.finish(now),
            }
        }
    }

    fn finish(&mut self, now: PhysicalTime) {
        self.has_finished = true;
        self.handle(now, Input::Finish);
    }

    /// Does what the machine says, first what the process waits for. The answer to the other end then tells what it has taken.
    fn proceed(&mut self, now: PhysicalTime) {
        while let Some(output) = self.relay.poll_near() {
            self.obey(output);
        }
        self.write(now);
        while let Some(output) = self.relay.poll() {
            self.obey(output);
        }
        self.end_near();
    }

    fn obey(&mut self, output: Output) {
        match output {
            Output::Packet(packet) => self.way.send(packet),
            Output::Frame(frame) => self.unread.push_back(frame),
            Output::Finished => self.is_finished = true,
            Output::Ended(end) => self.ended = Some(end),
        }
    }

    /// Tells the process what has ended.
    fn end_near(&mut self) {
        match &self.ended {
            Some(End::Finished) if self.unread.is_empty() => self.near = None,
            Some(End::Finished) => {}
            Some(end) => {
                if self.near.take().is_some() && self.is_open {
                    // The other end may say anything.
                    let why = end.to_string();
                    tell(&format!("the link {} has ended: {}", self.what, printable(&why)));
                }
                self.unread.clear();
            }
            None if self.is_finished && self.unread.is_empty() && !self.has_told => {
                self.has_told = true;
                self.near.iter().for_each(Near::finish);
            }
            None => {}
        }
    }

    /// Writes to the process, and tells the machine what that has taken.
    fn write(&mut self, now: PhysicalTime) {
        while self.is_open
            && let Some(frame) = self.unread.front()
        {
            let written = match self.near.as_ref().filter(|_| !self.is_deaf) {
                Some(near) => near.write(frame, self.taken),
                None => Ok(frame.len() - self.taken),
            };
            match written {
                Ok(count) => {
                    self.taken += count;
                    self.took(now);
                }
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => break,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                // The process has ended; what it has sent before still leaves.
                Err(_) => self.is_deaf = true,
            }
        }
    }

    /// A frame has been taken as far as `taken` says.
    fn took(&mut self, now: PhysicalTime) {
        let len = self.unread.front().map_or(0, |frame| frame.len());
        if self.taken < len {
            return;
        }
        self.unread.pop_front();
        self.taken = 0;
        let _ = self.relay.handle(now, Input::Taken(len));
    }
}
