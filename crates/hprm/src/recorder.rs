//! The recorder: one stream of records of what happens in a run, in physical time.
//!
//! ```text
//! loop, workers, RTI -> one ring for each thread -> collector -> share (a file)   -> Perfetto, when the run is over
//!                                                            \-> any other reader
//! ```
//!
//! The loops record what they do: reactions, messages, frames of the coordination, waits. A record has a fixed size,
//! and goes into memory that is there already; a ring that is full counts what it loses. The collector, a thread,
//! empties the rings and hands the records to its readers. One of them writes the share of this process; the
//! launcher makes one file of the shares. That of a federate on another machine is taken away there as it grows (`outbox`),
//! and arrives here (`remote`); how it travels is up to the command. The logical trace is another thing: it has values, and no physical time.

mod collector;
mod comparisons;
mod convert;
mod lanes;
mod names;
mod outbox;
mod perfetto;
mod record;
mod remote;
mod request;
mod ring;
mod share;
mod shares;
mod times;
mod user;

use std::sync::Arc;

use hprm_core::{
    ActionId, Body, ChannelId, FederateId, Nanos, Part, Payload, PhysicalTime, ReactionId,
    Scheduled, Tag,
};
use hprm_federated::Frame;

pub use collector::{Collected, Reader};
pub use lanes::{DEFAULT_CAPACITY, Lanes};
pub use names::{ChannelName, Member, Names};
pub use outbox::Outbox;
pub use perfetto::{
    Broken, DebugAnnotation, DebugAnnotationName, EventCategory, EventName, InternedData,
    ProcessDescriptor, ThreadDescriptor, TracePacket, TrackDescriptor, TrackEvent, packets,
};
pub use record::{Flags, FrameKind, Kind, Record, Wait, Words};
pub use remote::{RemoteShare, SHARE_LIMIT};
pub(crate) use request::LoopRecording;
pub use request::{TRACE, TraceRequest, cut_recordings};
pub use share::{Content, ShareReader};
pub use shares::Shares;
pub use user::Tracepoints;

/// Where a loop and its workers record; of no use if the run is not traced, and then it costs one branch.
#[derive(Clone, Debug, Default)]
pub struct Recorder(Option<Arc<Lanes>>);

impl Recorder {
    pub(crate) fn on(lanes: Arc<Lanes>) -> Self {
        Self(Some(lanes))
    }

    /// Whether the run is traced.
    #[inline]
    #[must_use]
    pub fn is_on(&self) -> bool {
        self.0.is_some()
    }

    /// Records what `make` says, in the lane of a thread: 0 is that of the loop.
    #[inline]
    pub(crate) fn record(&self, lane: usize, make: impl FnOnce() -> Record) {
        if let Some(lanes) = &self.0 {
            lanes.push(lane, make());
        }
    }

    /// A reaction begins.
    #[inline]
    pub(crate) fn reaction(&self, lane: usize, reaction: ReactionId, body: Body, tag: Tag) {
        self.record(lane, || Record::new(Kind::ReactionStart, flags_of(body), reaction.0, tag));
    }

    /// The reaction that has begun last in this lane ends.
    #[inline]
    pub(crate) fn reaction_end(&self, lane: usize, reaction: ReactionId, tag: Tag) {
        self.record(lane, || Record::new(Kind::ReactionEnd, Flags::NONE, reaction.0, tag));
    }

    /// An action was scheduled, or should have been.
    #[cold]
    pub(crate) fn scheduled(&self, (action, outcome): (ActionId, Scheduled), flags: Flags) {
        self.record(0, || match outcome {
            Scheduled::At(tag) => Record::new(Kind::Scheduled, flags, action.0, tag),
            _ => Record::new(Kind::Scheduled, flags.with(Flags::DROPPED), action.0, Tag::NEVER),
        });
    }

    /// The RTI forwards a message.
    pub(crate) fn forwarded(&self, message: (ChannelId, Tag), payload: Size) {
        self.record(0, || of_message(Kind::Forwarded, message, payload));
    }

    /// A message leaves, since what has been recorded last: the reaction that has sent it has ended then.
    #[inline]
    pub(crate) fn sent(&self, message: (ChannelId, Tag), payload: Size) {
        if let Some(lanes) = &self.0 {
            lanes.push_during(0, of_message(Kind::Sent, message, payload), [lanes.latest(); 2]);
        }
    }

    /// A message has arrived, and was read at this time.
    #[inline]
    pub(crate) fn received(&self, message: (ChannelId, Tag), payload: Size, at: PhysicalTime) {
        if let Some(lanes) = &self.0 {
            lanes.push_during(0, of_message(Kind::Received, message, payload), [at; 2]);
        }
    }

    /// A frame of the coordination leaves or arrives; it is of `federate`, or for it.
    pub(crate) fn frame(&self, kind: Kind, federate: FederateId, frame: &Frame) {
        if self.is_on()
            && let Some((which, tag)) = FrameKind::of(frame)
        {
            let subject = u32::from(federate.0);
            self.record(0, || {
                Record::new(kind, Flags::NONE, subject, tag).with_detail(which as u8)
            });
        }
    }

    /// The loop continues after a wait.
    #[inline]
    pub(crate) fn waited(&self, waiting: Waiting, now: PhysicalTime) {
        if let Some(lanes) = &self.0 {
            let Waiting { what, tag, since, until } = waiting;
            let values = [until.unwrap_or(PhysicalTime(0)), now].map(|it| it.0.cast_unsigned());
            let record = Record::new(Kind::Waited, Flags::NONE, 0, tag).with_detail(what as u8);
            lanes.push_during(0, record.with_values(values), [since, now]);
        }
    }

    /// The clock is set, by an offset that may be wrong by `error`. What follows may have earlier times.
    #[cold]
    pub(crate) fn clock_set(&self, offset: Nanos, error: Nanos, is_kept: bool) {
        let Some(lanes) = &self.0 else { return };
        lanes.forget_time(0);
        let record = Record::new(Kind::ClockSet, Flags::NONE, 0, Tag::NEVER);
        let values = [offset, error].map(i64::cast_unsigned);
        lanes.push(0, record.with_detail(is_kept.into()).with_values(values));
    }

    /// Tag zero is at this time.
    pub(crate) fn started(&self, at: PhysicalTime) {
        self.record(0, || {
            let record = Record::new(Kind::Started, Flags::NONE, 0, Tag::NEVER);
            record.with_values([at.0.cast_unsigned(), 0])
        });
    }
}

/// What a loop waits for, and since when.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Waiting {
    pub(crate) what: Wait,
    /// For which tag.
    pub(crate) tag: Tag,
    pub(crate) since: PhysicalTime,
    /// Until when, if that is known.
    pub(crate) until: Option<PhysicalTime>,
}

/// How large a message is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Size {
    /// Bytes that travel with the message.
    inside: u64,
    /// Bytes in shared memory, to which the message refers.
    shared: u64,
    flags: Flags,
}

impl Size {
    /// Of a message between threads, whose value stays where it is.
    pub(crate) const REFERENCE: Self = Self { inside: 0, shared: 0, flags: Flags::IN_PROCESS };

    pub(crate) fn of(payload: &Payload, flags: Flags) -> Self {
        let (mut inside, mut shared) = (payload.head.len() as u64, 0);
        for part in &payload.parts {
            match part {
                Part::Inline(bytes) => inside += bytes.len() as u64,
                Part::Object(object) => shared += object.len,
                Part::Shipped(shipment) => shared += shipment.len,
            }
        }
        Self { inside, shared, flags }
    }
}

fn of_message(kind: Kind, (channel, tag): (ChannelId, Tag), payload: Size) -> Record {
    let Size { inside, shared, flags } = payload;
    Record::new(kind, flags, channel.0, tag).with_values([inside, shared])
}

/// What else a reaction's record says.
fn flags_of(body: Body) -> Flags {
    match body {
        Body::Main => Flags::NONE,
        Body::Deadline => Flags::DEADLINE,
        Body::Tardy => Flags::TARDY,
    }
}
