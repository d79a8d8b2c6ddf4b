//! What a record says, and its fixed size.

use hprm_core::{PhysicalTime, Tag};
use hprm_federated::Frame;

/// A record as words, which is how rings and shares hold it.
pub type Words = [u64; 6];

/// What has happened.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[repr(u8)]
pub enum Kind {
    /// A reaction begins; the subject is the reaction.
    ReactionStart = 1,
    /// The reaction that has begun last in this lane ends.
    ReactionEnd,
    /// A message leaves a federate; the subject is the channel, the values are its bytes: inside the message, and in
    /// shared memory.
    Sent,
    /// A message has arrived at its federate.
    Received,
    /// The RTI forwards a message.
    Forwarded,
    /// A frame of the coordination leaves; the subject is the federate that it is of or for, the detail says which
    /// frame.
    FrameSent,
    /// A frame of the coordination has arrived.
    FrameReceived,
    /// The loop has had nothing to do from the record's time on; the detail says what it waited for, the values until
    /// when at most, and when it continued.
    Waited,
    /// An action was scheduled, to the tag; the subject is the action.
    Scheduled,
    /// A tracepoint of the program; the subject is its name, the first value is that of the tracepoint.
    Tracepoint,
    /// Tag zero is at the physical time that is the first value.
    Started,
    /// Records were lost since the one before, as many as the first value says: the ring was full.
    Lost,
    /// The clock of the process is set by the RTI's; records before this one have times of its machine. The values are the
    /// RTI's time minus that of the machine, and how far that may be from the truth; the detail is 1 if the clock follows
    /// the RTI's from then on.
    ClockSet,
}

impl Kind {
    const ALL: [Self; 13] = [
        Self::ReactionStart,
        Self::ReactionEnd,
        Self::Sent,
        Self::Received,
        Self::Forwarded,
        Self::FrameSent,
        Self::FrameReceived,
        Self::Waited,
        Self::Scheduled,
        Self::Tracepoint,
        Self::Started,
        Self::Lost,
        Self::ClockSet,
    ];
}

/// What else a record says, as bits.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct Flags(pub u8);

impl Flags {
    /// Nothing else.
    pub const NONE: Self = Self(0);
    /// The deadline handler runs, instead of the reaction.
    pub const DEADLINE: Self = Self(1);
    /// The tardy handler runs, instead of the reaction.
    pub const TARDY: Self = Self(2);
    /// Bytes were copied into shared memory for the message.
    pub const COPIED: Self = Self(4);
    /// The value goes to another thread of this process as it is.
    pub const IN_PROCESS: Self = Self(8);
    /// Another thread than those of the loop has scheduled it.
    pub const OUTSIDE: Self = Self(16);
    /// What was scheduled got no tag.
    pub const DROPPED: Self = Self(32);
    /// The tracepoint has a value.
    pub const VALUE: Self = Self(64);

    /// These bits and others.
    #[must_use]
    pub fn with(self, others: Self) -> Self {
        Self(self.0 | others.0)
    }

    /// Whether one of these bits is among them.
    #[must_use]
    pub fn has(self, others: Self) -> bool {
        self.0 & others.0 != 0
    }
}

/// A frame of the coordination that is recorded.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
#[repr(u8)]
pub enum FrameKind {
    /// Next event tag.
    Net = 1,
    /// Next event tag, by level.
    NetLevel,
    /// Latest tag confirmed.
    Ltc,
    /// Downstream next event tag.
    Dnet,
    /// Tag advance grant.
    Tag,
    /// Provisional tag advance grant.
    Ptag,
    /// How far a decentralized federate is.
    Progress,
    /// What is safe for a decentralized federate.
    Safe,
    /// A request to stop.
    StopRequest,
    /// The answer to it.
    StopReply,
    /// The last tag.
    StopGranted,
}

impl FrameKind {
    const ALL: [Self; 11] = [
        Self::Net,
        Self::NetLevel,
        Self::Ltc,
        Self::Dnet,
        Self::Tag,
        Self::Ptag,
        Self::Progress,
        Self::Safe,
        Self::StopRequest,
        Self::StopReply,
        Self::StopGranted,
    ];

    /// The one that a detail means.
    #[must_use]
    pub fn of_detail(detail: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| *kind as u8 == detail)
    }

    /// What the field calls it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Net => "NET",
            Self::NetLevel => "NET by level",
            Self::Ltc => "LTC",
            Self::Dnet => "DNET",
            Self::Tag => "TAG",
            Self::Ptag => "PTAG",
            Self::Progress => "progress",
            Self::Safe => "safe",
            Self::StopRequest => "stop request",
            Self::StopReply => "stop reply",
            Self::StopGranted => "stop granted",
        }
    }

    /// What is recorded of a frame; nothing of those that are not about tags.
    #[must_use]
    pub fn of(frame: &Frame) -> Option<(Self, Tag)> {
        Some(match frame {
            Frame::NextEventTag { tag } => (Self::Net, *tag),
            Frame::NextEventLevel { step, .. } => (Self::NetLevel, step.tag),
            Frame::LatestTagConfirmed { tag } => (Self::Ltc, *tag),
            Frame::DownstreamNextEventTag { tag, .. } => (Self::Dnet, *tag),
            Frame::TagAdvanceGrant { tag } => (Self::Tag, *tag),
            Frame::ProvisionalTagAdvanceGrant { through } => (Self::Ptag, through.tag),
            Frame::Progress { next, .. } => (Self::Progress, next.tag),
            Frame::Safe { through } => (Self::Safe, through.tag),
            Frame::StopRequest { tag } => (Self::StopRequest, *tag),
            Frame::StopReply { tag } => (Self::StopReply, *tag),
            Frame::StopGranted { tag } => (Self::StopGranted, *tag),
            _ => return None,
        })
    }
}

/// What a loop waits for.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[repr(u8)]
pub enum Wait {
    /// The start of the federation.
    Start = 1,
    /// Physical time, for the next tag.
    Time,
    /// A grant of the RTI, or a message, for the next tag.
    Permission,
    /// Anything to do.
    Events,
}

impl Wait {
    /// For people.
    #[must_use]
    pub fn name(detail: u8) -> &'static str {
        match detail {
            1 => "wait for the start",
            2 => "wait for physical time",
            3 => "wait for permission",
            _ => "wait for events",
        }
    }
}

/// What has happened, when.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Record {
    /// What.
    pub kind: Kind,
    /// What else.
    pub flags: Flags,
    /// Which frame, or what is waited for.
    pub detail: u8,
    /// To which reaction, channel, action, federate or name.
    pub subject: u32,
    /// When, in the time of the federation.
    pub time: PhysicalTime,
    /// The tag that it is about.
    pub tag: Tag,
    /// What the kind says.
    pub values: [u64; 2],
}

impl Record {
    /// One without values, and without its time.
    #[must_use]
    pub fn new(kind: Kind, flags: Flags, subject: u32, tag: Tag) -> Self {
        Self { kind, flags, detail: 0, subject, time: PhysicalTime(0), tag, values: [0, 0] }
    }

    /// The same with a detail.
    #[must_use]
    pub fn with_detail(self, detail: u8) -> Self {
        Self { detail, ..self }
    }

    /// The same with values.
    #[must_use]
    pub fn with_values(self, values: [u64; 2]) -> Self {
        Self { values, ..self }
    }

    /// As words.
    #[inline]
    #[must_use]
    pub fn words(&self) -> Words {
        let first = self.kind as u64
            | u64::from(self.flags.0) << 8
            | u64::from(self.detail) << 16
            | u64::from(self.subject) << 32;
        let [a, b] = self.values;
        [
            first,
            self.time.0.cast_unsigned(),
            self.tag.time.cast_unsigned(),
            u64::from(self.tag.microstep),
            a,
            b,
        ]
    }

    /// Of words; none if they are no record.
    #[must_use]
    pub fn of_words([first, time, tag, microstep, a, b]: Words) -> Option<Self> {
        let byte = |shift: u32| (first >> shift & 0xff) as u8;
        Some(Self {
            kind: Kind::ALL.into_iter().find(|kind| *kind as u8 == byte(0))?,
            flags: Flags(byte(8)),
            detail: byte(16),
            subject: (first >> 32) as u32,
            time: PhysicalTime(time.cast_signed()),
            tag: Tag { time: tag.cast_signed(), microstep: u32::try_from(microstep).ok()? },
            values: [a, b],
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn words_give_the_record_back(
            kind in 0..Kind::ALL.len(), flags: u8, detail: u8, subject: u32, time: i64,
            tag: (i64, u32), values: [u64; 2],
        ) {
            let record = Record {
                kind: Kind::ALL[kind],
                flags: Flags(flags),
                detail,
                subject,
                time: PhysicalTime(time),
                tag: Tag { time: tag.0, microstep: tag.1 },
                values,
            };
            prop_assert_eq!(Record::of_words(record.words()), Some(record));
        }

        #[test]
        fn any_words_give_a_record_or_none(words: Words) {
            if let Some(record) = Record::of_words(words) {
                prop_assert_eq!(Record::of_words(record.words()), Some(record));
            }
        }
    }
}
