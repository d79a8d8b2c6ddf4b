//! The other end of the connection: a process that watches what a federate sends.

use std::io;
use std::os::fd::{AsFd, BorrowedFd};
use std::sync::Arc;
use std::time::Duration;

use hprm_codec::{Dynamic, Memory, Pickle, outline};
use hprm_core::{ChannelId, FederateId, Nanos, Part, Payload, PhysicalTime, Tag};
use hprm_store::{Object, Store, StoreLimits};

use super::records::{Ask, Content, Seen, Told};
use super::{Tally, Wish};
use crate::records::{self, Received, RecordSocket};
use crate::wait::wait_for;
use crate::{Clock, nanoseconds};

/// How long a federate may take to answer: it may be busy in a reaction.
const ANSWER: Duration = Duration::from_secs(10);

/// Why nothing can be watched, or not any more.
#[derive(Debug, thiserror::Error)]
pub enum WatchError {
    /// No process listens for watchers there.
    #[error("it does not listen for watchers")]
    NotListening,
    /// The process is another user's.
    #[error("it is a process of another user")]
    OtherUser,
    /// It has too many watchers.
    #[error("it is watched by as many processes as can be")]
    Full,
    /// It is of another version of HPRM.
    #[error("it runs another version of HPRM")]
    OtherVersion,
    /// It has not answered for long.
    #[error("it does not answer: a reaction may take long")]
    Silent,
    /// It has ended.
    #[error("it has ended")]
    Ended,
    /// The system does not allow it.
    #[error("{0}")]
    System(#[from] io::Error),
}

/// A connection to a federate of which some channels are watched.
#[derive(Debug)]
pub struct Watching {
    socket: Arc<RecordSocket>,
    federate: FederateId,
    store: Store,
    /// Long records that have been read and are not released yet.
    tickets: Vec<u64>,
}

/// A message that a federate has sent, and its value: as it came, or decoded.
#[derive(Debug)]
pub struct Sight<V = Dynamic> {
    /// The channel on which it was sent.
    pub channel: ChannelId,
    /// The sender's tag.
    pub tag: Tag,
    /// The receiver's tag; none if that is the time of arrival.
    pub arrives: Option<Tag>,
    /// The time of tag zero.
    pub start: PhysicalTime,
    /// When it was sent.
    pub at: PhysicalTime,
    /// How many bytes its value has.
    pub bytes: u64,
    /// How many messages this process has missed so far, because it was too slow.
    pub dropped: u64,
    /// Its value. Arrays lie in the memory of the federate, which holds them until this is dropped.
    pub value: Result<V, Unseen>,
}

/// A value as receivers get it.
#[derive(Clone, Debug)]
pub struct Arrived {
    /// What describes it.
    pub head: Vec<u8>,
    /// Its buffers.
    pub parts: Vec<ArrivedPart>,
}

/// A buffer of a value.
#[derive(Clone, Debug)]
pub enum ArrivedPart {
    /// Bytes that came inside of the message.
    Inline(Arc<Vec<u8>>),
    /// Memory of the federate.
    Object(Held),
}

/// Memory of the federate, which is read in place, and does not change as long as this lives.
#[derive(Clone, Debug)]
pub struct Held {
    object: Object,
    /// The end of the connection would release the object.
    _socket: Arc<RecordSocket>,
}

impl Held {
    /// The bytes.
    #[must_use]
    pub fn as_bytes(&self) -> &[u8] {
        self.object.as_bytes()
    }
}

impl Memory for Held {
    fn bytes(&self) -> &[u8] {
        self.as_bytes()
    }
}

/// Why a value cannot be shown.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Unseen {
    /// It is too large for a watcher.
    TooLarge,
    /// It is not sent as bytes, and has no encoding, for this reason.
    Unencodable(String),
    /// It is a pickle.
    Pickle {
        /// What it names first: `module.Class`.
        names: Option<String>,
    },
    /// Only Python can read it, for this reason.
    Unreadable(String),
}

/// What has been counted in some time.
#[derive(Clone, PartialEq, Debug)]
pub struct Counts {
    /// How long that was.
    pub span: Nanos,
    /// What was counted for each channel.
    pub tallies: Vec<(ChannelId, Tally)>,
}

impl Watching {
    /// Watches these channels of a federate from now on.
    pub(super) fn new(
        socket: RecordSocket,
        federate: FederateId,
        channels: Vec<ChannelId>,
        wish: Wish,
    ) -> Result<Self, WatchError> {
        ask(&socket, &Ask::Watch { channels, wish })?;
        loop {
            let (record, _) = next_of(&socket, Some(ANSWER))?;
            if told(&record)? == Told::Watching {
                break;
            }
        }
        // This process makes no objects; the number only has to be another one than that of the federate.
        let me = FederateId(if federate.0 == 0 { 1 } else { 0 });
        let store = Store::new(me, StoreLimits::default());
        Ok(Self { socket: Arc::new(socket), federate, store, tickets: Vec::new() })
    }

    /// Waits for the next message of a channel that is watched with [`Wish::Values`]. What was seen before should be
    /// dropped by now: only a few messages can be held.
    ///
    /// # Errors
    ///
    /// [`WatchError::Ended`] when the federate has ended.
    pub fn next_sight(&mut self) -> Result<Sight, WatchError> {
        loop {
            if let Some(sight) = self.sight_by(None)? {
                return Ok(sight.decoded());
            }
        }
    }

    /// The next message, with its value as it came, if it comes until then; none if it does not, or a signal comes.
    ///
    /// # Errors
    ///
    /// [`WatchError::Ended`] when the federate has ended.
    pub(super) fn sight_by(
        &mut self,
        until: Option<PhysicalTime>,
    ) -> Result<Option<Sight<Arrived>>, WatchError> {
        loop {
            self.release()?;
            if !wait_for(self.socket.as_fd(), until) {
                return Ok(None);
            }
            let (record, descriptor) = received(&self.socket)?;
            match told(&record)? {
                Told::Segment { segment, len } => {
                    let descriptor = descriptor.ok_or(WatchError::OtherVersion)?;
                    let attached = self.store.attach(self.federate, segment, len, descriptor);
                    attached.map_err(|error| io::Error::other(error.to_string()))?;
                }
                Told::Retired { segments } => {
                    segments.iter().for_each(|it| self.store.detach(self.federate, *it));
                }
                Told::Message(seen) => return Ok(Some(self.sight(seen))),
                _ => {}
            }
        }
    }

    /// What has been counted for the channels, which are watched with [`Wish::Counts`], from the last call to the end
    /// of this one, which takes that long.
    ///
    /// # Errors
    ///
    /// [`WatchError::Ended`] when the federate has ended.
    pub fn counts(&mut self, window: Duration) -> Result<Counts, WatchError> {
        let until = Clock::now().plus(nanoseconds(window));
        // Nothing comes during this time but the end.
        while Clock::now() < until {
            if wait_for(self.socket.as_fd(), Some(until)) {
                next_of(&self.socket, None)?;
            }
        }
        ask(&self.socket, &Ask::Counts)?;
        loop {
            let (record, _) = next_of(&self.socket, None)?;
            if let Told::Counts { span, tallies } = told(&record)? {
                return Ok(Counts { span, tallies });
            }
        }
    }

    /// Releases what this process does not read any more, as [`Self::next_sight`] does.
    ///
    /// # Errors
    ///
    /// [`WatchError::Ended`] when the federate has ended.
    pub fn release(&mut self) -> Result<(), WatchError> {
        let mut serials: Vec<u64> =
            self.store.drain_releases().iter().map(|it| it.serial).collect();
        serials.append(&mut self.tickets);
        if serials.is_empty() { Ok(()) } else { ask(&self.socket, &Ask::Release { serials }) }
    }

    fn sight(&mut self, seen: Seen) -> Sight<Arrived> {
        let Seen { channel, tag, arrives, start, at, bytes, dropped, ticket, value } = seen;
        self.tickets.extend(ticket);
        let value = match value {
            Content::Payload(payload) => self.open(payload),
            Content::TooLarge => Err(Unseen::TooLarge),
            Content::Unencodable(reason) => Err(Unseen::Unencodable(reason)),
        };
        Sight { channel, tag, arrives, start, at, bytes, dropped, value }
    }

    /// What has come, without a copy of what lies in the federate's store.
    fn open(&mut self, payload: Payload) -> Result<Arrived, Unseen> {
        let mut parts = Vec::with_capacity(payload.parts.len());
        for part in payload.parts {
            parts.push(match part {
                Part::Inline(bytes) => ArrivedPart::Inline(Arc::new(bytes)),
                Part::Object(object) => {
                    let opened = self.store.open(object);
                    let object = opened.map_err(|error| unreadable(&error))?;
                    ArrivedPart::Object(Held { object, _socket: Arc::clone(&self.socket) })
                }
                // Federates show what they send before it becomes one.
                Part::Shipped(_) => return Err(Unseen::TooLarge),
            });
        }
        Ok(Arrived { head: payload.head, parts })
    }
}

impl AsFd for Watching {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.socket.as_fd()
    }
}

impl Sight<Arrived> {
    /// The same with its value decoded. Large arrays are not copied.
    pub(super) fn decoded(self) -> Sight {
        let Self { channel, tag, arrives, start, at, bytes, dropped, value } = self;
        let value = value.and_then(|arrived| arrived.decoded());
        Sight { channel, tag, arrives, start, at, bytes, dropped, value }
    }
}

impl Arrived {
    fn decoded(self) -> Result<Dynamic, Unseen> {
        let parts: Vec<Arc<dyn Memory>> = self.parts.into_iter().map(memory).collect();
        if let Some(Pickle { names }) = Pickle::of(&self.head, &parts) {
            return Err(Unseen::Pickle { names });
        }
        outline(&self.head, &parts).map_err(|error| unreadable(&error))
    }

    /// What the pickle names first, `module.Class`, if this is a pickle; and none in it, if that cannot be told.
    #[must_use]
    pub fn pickle(&self) -> Option<Option<String>> {
        let parts: Vec<Arc<dyn Memory>> = self.parts.iter().cloned().map(memory).collect();
        Pickle::of(&self.head, &parts).map(|it| it.names)
    }
}

fn memory(part: ArrivedPart) -> Arc<dyn Memory> {
    match part {
        ArrivedPart::Inline(bytes) => bytes,
        ArrivedPart::Object(held) => Arc::new(held),
    }
}

fn unreadable(error: &dyn std::fmt::Display) -> Unseen {
    Unseen::Unreadable(error.to_string())
}

/// The next record of a federate, for which this process waits no longer than `limit`.
pub(super) fn next_of(
    socket: &RecordSocket,
    limit: Option<Duration>,
) -> Result<Received, WatchError> {
    let until = limit.map(|limit| Clock::now().plus(nanoseconds(limit)));
    while !wait_for(socket.as_fd(), until) {
        if until.is_some_and(|until| Clock::now() >= until) {
            return Err(WatchError::Silent);
        }
    }
    received(socket)
}

/// The record that has come.
fn received(socket: &RecordSocket) -> Result<Received, WatchError> {
    match socket.receive() {
        Ok(received) => received.ok_or(WatchError::Ended),
        Err(error) => Err(gone_or(error)),
    }
}

fn ask(socket: &RecordSocket, ask: &Ask) -> Result<(), WatchError> {
    socket.send(&records::encode(ask), None).map_err(gone_or)
}

fn gone_or(error: io::Error) -> WatchError {
    match error.kind() {
        io::ErrorKind::BrokenPipe | io::ErrorKind::ConnectionReset => WatchError::Ended,
        _ => WatchError::System(error),
    }
}

fn told(record: &[u8]) -> Result<Told, WatchError> {
    records::decode(record).ok_or(WatchError::OtherVersion)
}
