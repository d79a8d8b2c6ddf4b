//! A relayed link: frames of bytes in order, each once, with an end that both sides learn, over a carrier that loses,
//! duplicates, reorders and pauses.
//!
//! A [`Relay`] is one end of it: a machine without a socket. What it promises is what all links promise: the frames
//! that one end takes come out at the other in order and without a gap, and after the last one the end. If that cannot
//! be, the link ends at both sides with a reason. There is never a silent gap.
//!
//! - Frames have numbers. Every packet says which have arrived, so any packet may be lost, and what is missing is sent
//!   again (`outgoing.rs`, `pace.rs`). Where nothing goes that way, a packet of its own says so: at once of much, and otherwise
//!   after a moment ([`PUT_OFF`]).
//! - Every packet says how much more its sender takes, in frames and in bytes ([`WINDOW_FRAMES`], [`WINDOW_BYTES`]), so
//!   the memory of both ends is bounded, however slow the reader is (`incoming.rs`).
//! - Each life of an end has an epoch, a random number. An end that meets another epoch than before has lost frames,
//!   so the link ends.
//! - After a break of the carrier the link goes on, because both ends know what is missing. If nothing has come for
//!   [`SILENCE`], and a question has stayed without an answer for [`ANSWER`], the other end counts as gone.
//!
//! Packets that cannot be read are dropped and counted: they change nothing, and what they carried is sent again. A
//! packet that no end sends which obeys these rules ([`Violation`]) ends the link, because what the other end believes
//! is not known then.

mod bytes;
mod incoming;
mod outgoing;
mod pace;
mod packet;
#[cfg(test)]
mod tests;

use std::collections::VecDeque;

use hprm_core::{Nanos, PhysicalTime};

pub use bytes::Bytes;
use incoming::Incoming;
use outgoing::{Item, Outgoing};
use packet::{Body, Header, Reason};
pub use packet::{FRAME_LIMIT, Packet};

/// The most frames, and bytes of them, that wait at either end: enough for 400 MB a second with a round trip of 10 ms.
pub const WINDOW_FRAMES: u64 = 1024;
/// See [`WINDOW_FRAMES`].
pub const WINDOW_BYTES: u64 = 4 << 20;

/// After so long without a packet an end asks the other one whether it is there.
pub const KEEPALIVE: Nanos = 1_000_000_000;

/// An end that may send nothing asks so often whether that has changed: the packet that says so may be lost.
const CREDIT: Nanos = 200_000_000;

/// For so long an answer may wait for a frame that goes the same way: to tell that a frame has come takes as long as to carry
/// one, and the process that gets the frame has better use for the processor.
const PUT_OFF: Nanos = 1_000_000;

/// How long nothing may come before the other end counts as gone: longer than a machine pauses that is suspended for a
/// moment, or a network that finds another way.
pub const SILENCE: Nanos = 20_000_000_000;

/// How long a question may stay without an answer: an end that was itself paused finds old silences, which say nothing.
pub const ANSWER: Nanos = 2_000_000_000;

/// By when both ends know that the carrier is dead, or the other end is gone. One of them learns it from its own silence;
/// the other one too, or it is told. A question leaves a moment late, and its answer may have been lost.
pub const TOLD: Nanos = SILENCE + ANSWER + 2 * KEEPALIVE;

/// An end that has ended answers for so long what still comes from the other one, which may not know.
const LINGER: Nanos = SILENCE;

/// A machine that is called so much later than it has asked for was paused itself.
const PAUSED: Nanos = 500_000_000;

/// What has happened.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub enum Input {
    /// A frame to be sent. It must be no longer than [`Relay::room`].
    Frame(Bytes),
    /// No more frames will be sent from this end. Those of the other end still come.
    Finish,
    /// The link is to end at once, whatever is on its way; the text says why, for people.
    Abort(String),
    /// The carrier brings a packet.
    Packet(Bytes),
    /// The reader has taken a frame of so many bytes.
    Taken(usize),
    /// The carrier works, as far as it tells; so it does at first.
    CarrierUp,
    /// The carrier says that it carries nothing at the moment.
    CarrierDown,
    /// Time has passed, and everything that has come has been handed over.
    Wake,
}

/// What is to be done.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub enum Output {
    /// Hand a packet to the carrier.
    Packet(Packet),
    /// Hand a frame to the reader. [`Input::Taken`] says when it has been taken.
    Frame(Bytes),
    /// The other end sends no more frames: all of them have been handed on.
    Finished,
    /// The link has ended. Nothing but packets comes after it.
    Ended(End),
}

/// Why a link has ended.
#[derive(Clone, PartialEq, Eq, Hash, Debug, thiserror::Error)]
pub enum End {
    /// Both ends have finished, and each has all frames.
    #[error("both ends have finished")]
    Finished,
    /// This end has been told to end.
    #[error("{0}")]
    Aborted(String),
    /// The other end has been told to end.
    #[error("the other end has closed the link: {0}")]
    PeerAborted(String),
    /// The other end is not the one that was there before: it has been started again.
    #[error("the other end has been started again, and knows nothing of what was sent before")]
    Restarted,
    /// The other end does not know the link.
    #[error("the other end does not know this link, or not any more")]
    Unknown,
    /// The other end has not answered.
    #[error("the other end has not answered for {}", crate::show_silence(*.0))]
    Silent(Nanos),
    /// The other end says that nothing has reached it.
    #[error("nothing has reached the other end for too long")]
    Unheard,
    /// The other end has sent what it must not.
    #[error("the other end breaks the rules of the link: {0}")]
    Broken(Violation),
    /// The other end says so of this one.
    #[error("the other end says that this one breaks the rules of the link")]
    Blamed,
}

/// A packet that no end sends which obeys the rules, whatever the carrier does.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, thiserror::Error)]
pub enum Violation {
    /// It says that frames have arrived that were never sent.
    #[error("it acknowledges frames that were never sent")]
    Acknowledged,
    /// It brings more than it was allowed.
    #[error("it sends more than it may")]
    Credit,
    /// It brings frames after the last one.
    #[error("it sends frames after the last one")]
    AfterEnd,
}

/// A frame for which there is no room, or after the last one. The machine is as it was.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, thiserror::Error)]
#[error("the link takes no frame of {0} bytes now")]
pub struct NoRoom(pub usize);

/// What has come that was of no use.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Default)]
pub struct Dropped {
    /// Packets that cannot be read: cut, too long, or of another version.
    pub unreadable: u64,
    /// Frames that had come before.
    pub duplicates: u64,
}

/// One end of a relayed link.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub struct Relay {
    epoch: u64,
    peer: Option<u64>,
    outgoing: Outgoing,
    incoming: Incoming,
    outputs: VecDeque<Output>,
    now: PhysicalTime,
    carrier_up: bool,
    /// When a packet came last, and since when a question has been without an answer.
    received_at: PhysicalTime,
    asked: Option<PhysicalTime>,
    last_asked: PhysicalTime,
    /// Whether the next question leaves at once.
    must_ask: bool,
    must_answer: bool,
    /// When an answer leaves at the latest that waits for a frame to go with.
    answer_at: PhysicalTime,
    /// Once it has ended: until when it answers, and what it says.
    ended: Option<(PhysicalTime, Reason)>,
    dropped: Dropped,
}

impl Relay {
    /// An end whose life has that number, which must be random: no two lives of an end have the same.
    #[must_use]
    pub fn new(epoch: u64, now: PhysicalTime) -> Self {
        Self {
            epoch: epoch.max(1),
            peer: None,
            outgoing: Outgoing::new(),
            incoming: Incoming::new(),
            outputs: VecDeque::new(),
            now,
            carrier_up: true,
            received_at: now,
            asked: None,
            last_asked: now,
            must_ask: true,
            must_answer: false,
            answer_at: PhysicalTime::FOREVER,
            ended: None,
            dropped: Dropped::default(),
        }
    }

    /// The answer to a packet of a link that this process does not know: it tells the other end.
    #[must_use]
    pub fn refusal(packet: &[u8]) -> Option<Vec<u8>> {
        let (header, _) = Header::decode(packet)?;
        let is_reset = matches!(header.body, Body::Reset(_));
        let answer = || Header::between(u64::MAX, header.from, Body::Reset(Reason::Unknown));
        (!is_reset).then(|| answer().encode())
    }

    /// How long a frame may be that is given now; zero if none may be.
    #[must_use]
    pub fn room(&self) -> usize {
        if self.ended.is_some() { 0 } else { self.outgoing.room() }
    }

    /// How much is on its way to the other end, in bytes: each frame counts as some thousand at least.
    #[must_use]
    pub fn in_flight(&self) -> u64 {
        if self.ended.is_some() { 0 } else { self.outgoing.flight() }
    }

    /// What has come that was of no use.
    #[must_use]
    pub fn dropped(&self) -> Dropped {
        self.dropped
    }

    /// Whether the link has ended, and the other end had time to learn of it: the machine may go.
    #[must_use]
    pub fn is_over(&self, now: PhysicalTime) -> bool {
        self.ended.as_ref().is_some_and(|(until, _)| now >= *until)
    }

    /// When the machine is to be told the time, at the latest.
    #[must_use]
    pub fn next_wakeup(&self) -> PhysicalTime {
        if let Some((until, _)) = self.ended {
            return until;
        }
        let due = self.question_due().min(self.death_due());
        if !self.carrier_up {
            return due;
        }
        let resend = self.outgoing.timeout().unwrap_or(PhysicalTime::FOREVER);
        due.min(resend).min(self.answer_at)
    }

    /// Takes what has happened.
    ///
    /// # Errors
    ///
    /// A frame for which there is no room.
    pub fn handle(&mut self, now: PhysicalTime, input: Input) -> Result<(), NoRoom> {
        let was_paused = now.since(self.next_wakeup()) > PAUSED;
        self.now = now;
        if was_paused {
            // What the other end has answered meanwhile may wait behind this input.
            self.asked = None;
            self.must_ask = true;
        }
        let is_wake = input == Input::Wake;
        match input {
            Input::Frame(bytes) if bytes.len() > self.room() || self.room() == 0 => {
                return Err(NoRoom(bytes.len()));
            }
            Input::Frame(bytes) => self.outgoing.give(Item::Frame(bytes)),
            Input::Finish if self.ended.is_none() && !self.outgoing.is_finished() => {
                self.outgoing.give(Item::Finish);
            }
            Input::Abort(why) => {
                let reason = Reason::aborted(&why);
                self.end(End::Aborted(why), reason);
            }
            Input::Packet(packet) => self.packet(packet),
            Input::Taken(bytes) => self.must_answer |= self.incoming.take(bytes as u64),
            Input::CarrierDown => self.carrier_up = false,
            Input::CarrierUp => self.carrier_works(),
            Input::Finish | Input::Wake => {}
        }
        self.pass_time(is_wake);
        Ok(())
    }

    /// What is to be done next for the process at this end, and is no packet. Packets can say what the process has taken of it.
    pub fn poll_near(&mut self) -> Option<Output> {
        self.outputs.pop_front()
    }

    /// What is to be done next. One answer is enough for all packets that have come before.
    pub fn poll(&mut self) -> Option<Output> {
        if let Some(output) = self.poll_near() {
            return Some(output);
        }
        if let Some((_, reason)) = &self.ended {
            if !self.carrier_up || !std::mem::take(&mut self.must_answer) {
                return None;
            }
            let to = self.peer.unwrap_or_default();
            let is_finished = self.is_finished();
            let body = if is_finished { Body::Nothing } else { Body::Reset(reason.clone()) };
            let mut header = Header::between(self.epoch, to, body);
            self.incoming.tell(&mut header);
            return Some(Output::Packet(Packet::new(&header, None)));
        }
        self.next_packet().map(Output::Packet)
    }

    fn next_packet(&mut self) -> Option<Packet> {
        let asks = self.question_due() <= self.now;
        if asks {
            // That nothing can leave at the moment makes no difference to whether an answer comes.
            (self.last_asked, self.must_ask) = (self.now, false);
            self.asked.get_or_insert(self.now);
        }
        if !self.carrier_up {
            return None;
        }
        let item = self.outgoing.send(self.now);
        let answers = self.must_answer || self.answer_at <= self.now;
        if item.is_none() && !asks && !answers {
            return None;
        }
        (self.must_answer, self.answer_at) = (false, PhysicalTime::FOREVER);
        let to = self.peer.unwrap_or_default();
        let mut header = Header::between(self.epoch, to, Body::Nothing);
        header.asks = asks;
        self.incoming.tell(&mut header);
        let Some((number, item)) = item else { return Some(Packet::new(&header, None)) };
        Some(match item {
            Item::Frame(bytes) => {
                let len = u32::try_from(bytes.len()).expect("a frame has a limit");
                header.body = Body::Frame { number, len };
                Packet::new(&header, Some(bytes.clone()))
            }
            Item::Finish => {
                header.body = Body::Finish { number };
                Packet::new(&header, None)
            }
        })
    }

    /// When this end asks the other one for an answer: after a silence, and earlier while it may send nothing.
    fn question_due(&self) -> PhysicalTime {
        let silent = self.received_at.max(self.last_asked).plus(KEEPALIVE);
        match (self.must_ask, self.outgoing.waits_for_credit()) {
            (true, _) => self.now,
            (false, true) => silent.min(self.last_asked.plus(CREDIT)),
            (false, false) => silent,
        }
    }

    /// When the other end counts as gone, if nothing comes.
    fn death_due(&self) -> PhysicalTime {
        match self.asked {
            Some(asked) => self.received_at.plus(SILENCE).max(asked.plus(ANSWER)),
            None => PhysicalTime::FOREVER,
        }
    }

    /// Does what is due. Nothing counts as lost before everything has been handed over that has come: answers to it may be among that.
    fn pass_time(&mut self, all_has_come: bool) {
        if self.ended.is_some() {
            return;
        }
        if self.death_due() <= self.now {
            let silence = self.now.since(self.received_at);
            return self.end(End::Silent(silence), Reason::Silent);
        }
        if self.carrier_up && all_has_come {
            self.outgoing.time_out(self.now);
        }
        if self.is_finished() {
            self.end(End::Finished, Reason::Unknown);
        }
    }

    /// Whether both ends have everything.
    fn is_finished(&self) -> bool {
        self.outgoing.is_done() && self.incoming.is_done()
    }

    /// The link ends here. The other end is told, and is told again whenever it sends something.
    fn end(&mut self, end: End, reason: Reason) {
        if self.ended.is_none() {
            self.outputs.push_back(Output::Ended(end));
            self.ended = Some((self.now.plus(LINGER), reason));
            self.must_answer = true;
        }
        if !self.is_finished() {
            // It may be much, and is of no use any more.
            (self.outgoing, self.incoming) = (Outgoing::new(), Incoming::new());
        }
    }

    /// The carrier says so, or brings something.
    fn carrier_works(&mut self) {
        if !self.carrier_up {
            self.carrier_up = true;
            self.outgoing.resume();
            self.must_ask = true;
        }
    }

    fn packet(&mut self, packet: Bytes) {
        let Some((header, bytes)) = Header::decode(&packet) else {
            self.dropped.unreadable += 1;
            return;
        };
        let frame = packet.len() - bytes.len()..packet.len();
        if let Body::Reset(reason) = header.body {
            let is_peer = self.peer.is_none_or(|peer| peer == header.from);
            if header.to == self.epoch || header.to == 0 && is_peer {
                self.reset(reason);
            }
            return;
        }
        if self.ended.is_some() {
            self.peer.get_or_insert(header.from);
            self.must_answer |= header.asks || header.body != Body::Nothing;
            return;
        }
        // Either end may be the one that was started again.
        let to_another = header.to != 0 && header.to != self.epoch;
        let from_another = self.peer.is_some_and(|peer| peer != header.from);
        if to_another || from_another {
            self.peer = Some(header.from);
            return self.end(End::Restarted, Reason::Restarted);
        }
        self.peer = Some(header.from);
        self.received_at = self.now;
        self.asked = None;
        self.carrier_works();
        self.must_answer |= header.asks;
        if let Err(violation) = self.take(header, packet.part(frame)) {
            self.end(End::Broken(violation), Reason::Broken);
        }
    }

    fn take(&mut self, header: Header, bytes: Bytes) -> Result<(), Violation> {
        self.outgoing.acknowledge(&header, self.now)?;
        let (number, item) = match header.body {
            Body::Frame { number, .. } => (number, Item::Frame(bytes)),
            Body::Finish { number } => (number, Item::Finish),
            Body::Nothing | Body::Reset(_) => return Ok(()),
        };
        let is_new = self.incoming.receive(number, item)?;
        self.dropped.duplicates += u64::from(!is_new);
        while let Some(item) = self.incoming.pass() {
            self.outputs.push_back(match item {
                Item::Frame(bytes) => Output::Frame(bytes),
                Item::Finish => Output::Finished,
            });
        }
        match is_new && !self.incoming.has_much_to_tell() {
            true => self.answer_at = self.answer_at.min(self.now.plus(PUT_OFF)),
            false => self.must_answer = true,
        }
        Ok(())
    }

    /// The link has ended at the other end.
    fn reset(&mut self, reason: Reason) {
        let end = match reason {
            Reason::Aborted(why) => End::PeerAborted(why),
            Reason::Restarted => End::Restarted,
            Reason::Silent => End::Unheard,
            Reason::Broken => End::Blamed,
            Reason::Unknown => End::Unknown,
        };
        self.end(end, Reason::Unknown);
        // It knows.
        self.must_answer = false;
    }
}
