//! The frames between a federate and the RTI, and between two federates.
//!
//! A frame is plain data. How it becomes bytes is in [`codec`](crate::codec); when it is sent and
//! what it causes is with the machines.

use std::fmt;
use std::str::FromStr;

use hprm_core::{ChannelId, Fact, FederateId, Nanos, Payload, PhysicalTime, Tag};
use serde::{Deserialize, Serialize};

use crate::{Posting, Step};

/// The version of the frames and of their meaning; both ends of a link must have the same.
pub const PROTOCOL: u32 = 19;

/// Identifies a federation. The driver keeps it secret if processes have to prove that they know it; then frames
/// carry an id that is derived from it.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct FederationId(pub u128);

impl fmt::Display for FederationId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:032x}", self.0)
    }
}

impl fmt::Debug for FederationId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("FederationId(..)")
    }
}

/// A text that is not a federation's id.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
#[error("a federation id has 32 hexadecimal digits")]
pub struct BadFederationId;

impl FromStr for FederationId {
    type Err = BadFederationId;

    fn from_str(text: &str) -> Result<Self, BadFederationId> {
        let is_hex = text.len() == 32 && text.bytes().all(|byte| byte.is_ascii_hexdigit());
        if !is_hex {
            return Err(BadFederationId);
        }
        u128::from_str_radix(text, 16).map(Self).map_err(|_| BadFederationId)
    }
}

/// Where a federate runs. Two federates with equal ids run under one kernel, in one namespace, and
/// can share memory.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug, Serialize, Deserialize)]
pub struct HostId(pub u128);

impl HostId {
    /// The id of a federate that has joined over a Unix socket.
    #[must_use]
    pub fn joined_over_unix_socket(self) -> Self {
        Self(self.0 | 1)
    }

    /// Whether the federate has joined over a Unix socket, so that the RTI can give it memory of others that have.
    #[must_use]
    pub fn has_joined_over_unix_socket(self) -> bool {
        self.0 & 1 == 1
    }

    /// The id of a federate that has joined over TCP. No other federate has the same, whatever it claims.
    #[must_use]
    pub fn joined_over_tcp(self) -> Self {
        Self(self.0 & !1)
    }
}

/// An attempt of a process to join: a process whose link to the RTI breaks early tries again.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug, Serialize, Deserialize)]
pub struct Attempt {
    /// A random number that no other process of the federation has. If federates are threads, each has its own.
    pub process: u64,
    /// How many attempts the process has made before.
    pub number: u32,
}

/// A member of a federation, as the others see it.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub struct Peer {
    /// Which federate it is.
    pub federate: FederateId,
    /// Which process of that federate it is: a transient federate that joins again is a new process, with
    /// another number.
    pub incarnation: u32,
    /// How many processes have joined as that federate so far, this one included.
    pub life: u32,
    /// Where it runs.
    pub host: HostId,
    /// Where it accepts direct links, and on which machine it gets shipments, if it does: words, of which
    /// [`machine_in`] and [`addresses_in`] tell the two apart.
    pub listen: Option<String>,
}

/// What stands before the name of the machine on which a federate gets shipments.
const SHIPMENTS: &str = "shipments:";

/// What a federate says in `listen` if it gets shipments through the agent of that machine.
#[must_use]
pub fn shipments_to(machine: &str) -> String {
    format!("{SHIPMENTS}{machine}")
}

/// The machine on which a federate gets shipments that says this in `listen`, if it does.
#[must_use]
pub fn machine_in(listen: &str) -> Option<&str> {
    listen.split_whitespace().find_map(|word| word.strip_prefix(SHIPMENTS))
}

/// What stands before an address at which an agent accepts links for a federate.
const AGENT: &str = "agent:";

/// Whether federates of other machines reach a federate that says this in `listen`, through agents.
#[must_use]
pub fn is_reached_through_agent(listen: &str) -> bool {
    listen.split_whitespace().any(|word| word.starts_with(AGENT))
}

/// The addresses at which a federate accepts direct links that says this in `listen`.
pub fn addresses_in(listen: &str) -> impl Iterator<Item = &str> {
    listen.split_whitespace().filter(|word| !word.starts_with(SHIPMENTS))
}

/// Why a federate may not join, or a peer may not link.
///
/// Processes of other versions read this too, so the order of the reasons must not change.
#[derive(
    Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Debug, Serialize, Deserialize, thiserror::Error,
)]
#[non_exhaustive]
pub enum Refusal {
    /// Another federation's secret.
    #[error("this is another federation")]
    WrongFederation,
    /// Another program, or another version of it.
    #[error("its program differs from that of the federation{}", listed(differences))]
    WrongProgram {
        /// In what, in sentences.
        differences: Vec<String>,
    },
    /// Another version of the protocol.
    #[error("another version of the protocol")]
    WrongProtocol,
    /// The program has no such federate, or none that links to this one.
    #[error("the program has no such federate here")]
    UnknownFederate,
    /// That federate has joined already.
    #[error("this federate has already joined: is it running twice?")]
    Duplicate,
    /// The federation has started, or failed.
    #[error("the federation has already started or ended")]
    TooLate,
    /// The RTI has been asked to stop before the start.
    #[error("the RTI has been stopped before the federation started")]
    Stopped,
    /// Other federates have not joined in time.
    #[error("the federation has not started: {0}")]
    Missing(Missing),
}

impl Refusal {
    /// What to do about it.
    #[must_use]
    pub fn hint(&self) -> Option<&'static str> {
        Some(match self {
            Self::WrongFederation => {
                "check what --federation-file names: the secret must be the same everywhere"
            }
            Self::WrongProgram { .. } => {
                "run the same files with the same properties everywhere; constructors must make the same in each \
                 process, so without random numbers, the time or the environment"
            }
            Self::WrongProtocol => "run the same version of hprm everywhere",
            _ => return None,
        })
    }
}

/// Which federates are not there after the join timeout. There is at least one.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Debug, Serialize, Deserialize)]
pub struct Missing {
    /// Federates that have never joined.
    pub never: Vec<String>,
    /// Federates that have joined, and whose links have ended since.
    pub left: Vec<String>,
    /// The join timeout, in nanoseconds.
    pub limit: Nanos,
}

impl fmt::Display for Missing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { never, left, limit } = self;
        let federates = |names: &[String]| {
            let plural = if names.len() == 1 { "" } else { "s" };
            format!("federate{plural} {}", names.join(", "))
        };
        if !never.is_empty() {
            write!(f, "{} did not join", federates(never))?;
        }
        if !left.is_empty() {
            let and = if never.is_empty() { "" } else { ", and " };
            let left = federates(left);
            write!(f, "{and}{left} left before the start and did not join again")?;
        }
        #[expect(clippy::cast_precision_loss, reason = "it is for people")]
        let seconds = *limit as f64 / 1e9;
        write!(f, " within {seconds} s")
    }
}

/// Each on a line of its own.
fn listed(sentences: &[String]) -> String {
    sentences.iter().map(|sentence| format!("\n  - {sentence}")).collect()
}

/// How many messages a channel has carried, as one of its ends counts them.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug, Serialize, Deserialize)]
pub struct Count {
    /// The channel.
    pub channel: ChannelId,
    /// Messages sent, if the sender says it; received, if the receiver says it.
    pub messages: u64,
}

/// A message of the protocol.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Frame {
    /// Federate to RTI, first on a link: the federate asks to join. The layout is the same in all versions, so
    /// that an RTI can refuse a federate of another version.
    Hello {
        /// [`PROTOCOL`].
        protocol: u32,
        /// The federation that it wants to join.
        federation: FederationId,
        /// The [digest](hprm_core::Fingerprint::digest) of its program's fingerprint.
        fingerprint: u64,
        /// Which federate it is.
        federate: FederateId,
        /// Where it runs.
        host: HostId,
        /// Where it accepts direct links, and on which machine it gets shipments, if it does.
        listen: Option<String>,
        /// Which process asks, and for which time.
        attempt: Attempt,
        /// Whether the launcher of the federation has started it, and no user.
        launched: bool,
    },
    /// RTI to federate, last on a link: the federate may not join.
    Refused {
        /// Why.
        reason: Refusal,
    },
    /// RTI to all, once every federate has joined.
    Peers {
        /// All federates.
        peers: Vec<Peer>,
        /// Whether they coordinate themselves by boards: in memory, where they have joined over Unix sockets, and
        /// otherwise by [`Frame::Posting`].
        boards: bool,
    },
    /// First on a direct link, from the side that opened it.
    PeerHello {
        /// [`PROTOCOL`].
        protocol: u32,
        /// The federation of that side.
        federation: FederationId,
        /// The federate that has opened the link.
        from: FederateId,
    },
    /// The answer on a direct link.
    PeerWelcome {
        /// The federate that has accepted the link.
        federate: FederateId,
    },
    /// Federate to RTI: the program is loaded. The RTI introduces a federate that joins late to the
    /// others then.
    Loaded,
    /// Federate to RTI: the program is loaded and direct links are up.
    Ready {
        /// The reading of its clock.
        now: PhysicalTime,
    },
    /// RTI to all, or to a federate that joins late: tag zero is at this time.
    Start {
        /// The physical time of tag zero.
        at: PhysicalTime,
        /// The tag at which the receiver starts: zero, unless it joins late.
        first: Tag,
    },
    /// RTI to the neighbours of a transient federate: it is about to join.
    Joining {
        /// That federate, and where it is.
        peer: Peer,
    },
    /// The answer of a neighbour to `Joining`: from the tag after `after` on, it sends its messages to that
    /// federate too. Under decentralized coordination also the answer to `Joined`: from now on, the neighbour
    /// waits for messages of that federate. And the answer to `Departing`.
    Met {
        /// The federate that is joining, or leaving.
        federate: FederateId,
        /// Which process of that federate it is.
        incarnation: u32,
        /// The latest tag that may have been processed without it.
        after: Tag,
    },
    /// RTI to the neighbours of a transient federate: the federate joins. Under decentralized coordination it
    /// starts when its receivers have answered, and perhaps at a later tag.
    Joined {
        /// That federate.
        federate: FederateId,
        /// It sends nothing before this tag.
        first: Tag,
    },
    /// RTI to federate: the federate must leave at this tag, because it has asked to, or because its successor
    /// joins. Federate to RTI: the federate asks at which tag it may leave, at this one at the earliest;
    /// or it has been told a tag that it has passed.
    Depart {
        /// Its last tag, if it has not passed that tag yet.
        tag: Tag,
    },
    /// From each federate to all others, before the start, where they read boards. The frame comes with a descriptor:
    /// of the owner's board, or of what wakes up the owner.
    Board {
        /// The federate that shows itself there.
        owner: FederateId,
        /// The federate that reads it.
        reader: FederateId,
        /// Whether the descriptor wakes up the owner.
        notifier: bool,
    },
    /// From each federate to others that do not share its memory, where federates read boards: what its board shows.
    Posting {
        /// The federate that shows it.
        owner: FederateId,
        /// The federate that reads it.
        reader: FederateId,
        /// What is shown, but that `waits` may be a step whose tag is not due yet.
        posting: Posting,
    },
    /// RTI to the federates downstream of one that asks to leave, where federates read boards: once its board says
    /// so, they answer with `Met`. To that federate itself: it is to ask, because its successor joins.
    Departing {
        /// The federate that asks to leave.
        federate: FederateId,
        /// Which process of that federate it is.
        incarnation: u32,
    },
    /// Federate to RTI: nothing happens here before this tag, unless a message arrives.
    NextEventTag {
        /// The earliest tag with something to do.
        tag: Tag,
    },
    /// As [`Frame::NextEventTag`], from a federate that goes through tags level by level.
    NextEventLevel {
        /// The earliest step with something to do.
        step: Step,
        /// How many messages the federate had received when it sent this.
        received: u64,
    },
    /// Federate to RTI: this tag is complete and its messages are sent.
    LatestTagConfirmed {
        /// The completed tag.
        tag: Tag,
    },
    /// RTI to federate: no other federate waits for reports of this one up to this tag, so it may skip them;
    /// `NEVER` if it must skip none. It must report again, too, when it has sent a message.
    DownstreamNextEventTag {
        /// The latest tag that need not be reported.
        tag: Tag,
        /// How many messages of that federate the RTI had received. If the federate has sent more, it ignores
        /// this frame.
        sent: u64,
    },
    /// RTI to federate: the federate may process tags up to this one. All messages up to it were sent before
    /// this frame.
    TagAdvanceGrant {
        /// The latest tag that it may process.
        tag: Tag,
    },
    /// As [`Frame::TagAdvanceGrant`], to a federate that goes through tags level by level: all messages that
    /// reactions up to this step read were sent before this frame.
    ProvisionalTagAdvanceGrant {
        /// The latest step that it may process.
        through: Step,
    },
    /// A value that a federate sends to another one.
    Message {
        /// The channel on which it is sent.
        channel: ChannelId,
        /// Its tag at the receiver; meaningless if the channel is physical.
        tag: Tag,
        /// The value.
        payload: Payload,
    },
    /// A segment of a store for a reader to map. Its descriptor travels beside this frame.
    Segment {
        /// The federate that owns the segment.
        owner: FederateId,
        /// The federate that is to map it.
        reader: FederateId,
        /// The number that the owner has given it.
        segment: u32,
        /// Its length in bytes.
        len: u64,
    },
    /// Segments that their owner does not use any more: a reader may unmap them.
    Retired {
        /// The federate that owns the segments.
        owner: FederateId,
        /// The federate that has mapped them.
        reader: FederateId,
        /// The owner's numbers for them.
        segments: Vec<u32>,
    },
    /// Objects that a reader no longer uses.
    Release {
        /// The federate that owns the objects.
        owner: FederateId,
        /// The federate that used them.
        reader: FederateId,
        /// The owner's numbers for them.
        serials: Vec<u64>,
    },
    /// The receiver of a channel to its sender: the receiver has processed this much since its last such frame.
    Processed {
        /// The channel.
        channel: ChannelId,
        /// How many messages.
        messages: u64,
        /// How many bytes they count for in flow control.
        bytes: u64,
    },
    /// Federate to RTI: the federate asks that the federation stops at this tag or soon after. RTI to the other
    /// federates: a federate or the user has asked for that.
    StopRequest {
        /// The earliest tag that the sender accepts as the last one.
        tag: Tag,
    },
    /// The answer of a federate to `StopRequest`. The federate begins neither this tag nor a later one before
    /// `StopGranted` comes.
    StopReply {
        /// The earliest tag that the federate accepts as the last one.
        tag: Tag,
    },
    /// RTI to all: this is the last tag.
    StopGranted {
        /// The last tag.
        tag: Tag,
    },
    /// Federate to RTI, under decentralized coordination: how far the federate is. From these frames the RTI
    /// finds out which waits are not necessary, because no message can come any more.
    Progress {
        /// The earliest step with something to do.
        next: Step,
        /// Counts that have changed since the last such frame, of logical channels at this federate.
        counts: Vec<Count>,
    },
    /// RTI to federate, under decentralized coordination: all messages that reactions up to this step read have
    /// arrived.
    Safe {
        /// The latest step for which that is so.
        through: Step,
    },
    /// On a direct link, between federates that go through tags level by level: no message with this tag or an
    /// earlier one will be sent on this channel.
    PortAbsent {
        /// The channel.
        channel: ChannelId,
        /// The tag.
        tag: Tag,
    },
    /// RTI to a federate that has sent nothing for a while: asks for a `Pong`.
    Ping,
    /// The answer to `Ping`.
    Pong,
    /// The last frame of a federate that ends in order. On the link to the RTI it says that the federate has
    /// completed the last tag of the program; on a direct link the federate may also have left earlier.
    Resign,
    /// Federate to RTI, its last frame: the federate leaves before the last tag, and the others continue.
    Leave {
        /// The last tag that it has processed, or that it was processing.
        tag: Tag,
    },
    /// RTI to the neighbours of a federate: it has ended, in order or not.
    Gone {
        /// That federate.
        federate: FederateId,
        /// Whether it has ended in order. Then its last frame on each direct link is `Resign`.
        in_order: bool,
    },
    /// Federate to RTI: the federate cannot continue. RTI to all: that federate could not continue, and all end.
    Failed {
        /// The federate that cannot go on.
        federate: FederateId,
        /// Why, for people.
        message: String,
        /// The exit code of its process.
        code: i32,
    },
    /// Federate to RTI, at any time: asks for the time of the RTI's clock.
    ClockRequest {
        /// What the federate's clock shows.
        asked: PhysicalTime,
    },
    /// The answer to `ClockRequest`.
    ClockReply {
        /// As in the request.
        asked: PhysicalTime,
        /// What the RTI's clock showed when the request came.
        received: PhysicalTime,
        /// What the RTI's clock showed when this frame left.
        sent: PhysicalTime,
    },
    /// RTI to a federate whose fingerprint differs from the RTI's: asks for the facts of its program.
    ProgramRequest,
    /// The answer to `ProgramRequest`.
    ProgramReply {
        /// The name of the federate there.
        name: String,
        /// All facts of its program.
        facts: Vec<Fact>,
    },
}

/// What the descriptor is for that a frame carries.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub enum Carried {
    /// A segment of a store.
    Segment(u32),
    /// The board of a federate.
    Board,
    /// What wakes up a federate.
    Notifier,
}

impl Frame {
    /// From and to which federate the frame carries a descriptor, if it does, and what that is for.
    #[must_use]
    pub fn carries(&self) -> Option<(FederateId, FederateId, Carried)> {
        match *self {
            Self::Segment { owner, reader, segment, .. } => {
                Some((owner, reader, Carried::Segment(segment)))
            }
            Self::Board { owner, reader, notifier: false } => Some((owner, reader, Carried::Board)),
            Self::Board { owner, reader, notifier: true } => {
                Some((owner, reader, Carried::Notifier))
            }
            _ => None,
        }
    }
}

/// Writes the names of all kinds, and which frame has which.
macro_rules! kinds {
    ($($kind:ident),* $(,)?) => {
        impl Frame {
            /// The names of all kinds of frames.
            pub const KINDS: &'static [&'static str] = &[$(stringify!($kind)),*];

            /// The name of its kind, for messages.
            #[must_use]
            pub fn name(&self) -> &'static str {
                match self {
                    $(Self::$kind { .. } => stringify!($kind),)*
                }
            }
        }
    };
}

kinds! {
    Hello, Refused, Peers, PeerHello, PeerWelcome, Loaded, Ready, Start, Joining, Met, Joined,
    Depart, Board, Posting, Departing, NextEventTag, NextEventLevel, LatestTagConfirmed, DownstreamNextEventTag,
    TagAdvanceGrant, ProvisionalTagAdvanceGrant, Message, Segment, Retired, Release, Processed,
    StopRequest, StopReply, StopGranted, Progress, Safe, PortAbsent, Ping, Pong, Resign, Leave,
    Gone, Failed, ClockRequest, ClockReply, ProgramRequest, ProgramReply,
}

#[cfg(test)]
mod tests {
    use super::FederationId;

    #[test]
    fn a_federation_id_is_read_as_it_is_written() {
        let id = FederationId(0x0123_4567_89ab_cdef);
        let text = id.to_string();
        assert_eq!(text, "00000000000000000123456789abcdef");
        assert_eq!(text.parse(), Ok(id));
        for bad in
            ["", "12", "+0000000000000000123456789abcdef", "0000000000000000012345678-abcdef"]
        {
            assert!(bad.parse::<FederationId>().is_err(), "{bad}");
        }
    }

    #[test]
    fn a_secret_does_not_show_in_debug_output() {
        assert!(!format!("{:?}", FederationId(0xabc)).contains("abc"));
    }
}
