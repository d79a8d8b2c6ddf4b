//! What travels between a federate and the RTI, and between two federates.
//!
//! A frame is plain data. How it becomes bytes is in [`codec`](crate::codec); when it is sent and
//! what it causes is with the machines.

use std::fmt;
use std::str::FromStr;

use hprm_core::{ChannelId, Fact, FederateId, Nanos, Payload, PhysicalTime, Tag};
use serde::{Deserialize, Serialize};

use crate::Step;

/// The version of the frames and of their meaning; both ends of a link must have the same.
pub const PROTOCOL: u32 = 11;

/// What the members of a federation share, and what tells it from others. To a driver that lets
/// links prove their knowledge of it, it is a secret, and what frames carry is derived from it.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
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
    pub fn beside_rti(self) -> Self {
        Self(self.0 | 1)
    }

    /// The id of a federate that has joined over TCP. No other federate has the same, whatever it claims.
    #[must_use]
    pub fn elsewhere(self) -> Self {
        Self(self.0 & !1)
    }
}

/// A member of a federation, as the others see it.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub struct Peer {
    /// Which federate it is.
    pub federate: FederateId,
    /// Which of the processes that have been that federate, one after the other.
    pub life: u32,
    /// Where it runs.
    pub host: HostId,
    /// Where it accepts direct links, if it does.
    pub listen: Option<String>,
}

/// Why a federate may not join, or a peer may not link.
///
/// A process of another version reads this too: a reason keeps its place.
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
                "check the federation id: the secret must be the same everywhere"
            }
            Self::WrongProgram { .. } => "run the same files with the same properties everywhere",
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
    /// Federate to RTI, first on a link: let me join. Its layout is the same in all versions, so that
    /// one can refuse another.
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
        /// Where it accepts direct links, if it does.
        listen: Option<String>,
    },
    /// RTI to federate, last on a link: no.
    Refused {
        /// Why.
        reason: Refusal,
    },
    /// RTI to all, once every federate has joined.
    Peers {
        /// All federates.
        peers: Vec<Peer>,
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
    /// The answer: whatever I send at a later tag than this one goes to that federate too. And, under
    /// decentralized coordination, the answer to `Joined`: from now on I wait for it.
    Met {
        /// The federate that is joining.
        federate: FederateId,
        /// Which of its processes.
        life: u32,
        /// The latest tag that may have been processed without it.
        after: Tag,
    },
    /// RTI to the neighbours of a transient federate: it joins. Under decentralized coordination it
    /// starts when those have answered to which it sends, and perhaps at a later tag.
    Joined {
        /// That federate.
        federate: FederateId,
        /// It sends nothing before this tag.
        first: Tag,
    },
    /// RTI to a federate: leave at this tag, because you asked, or another instance of you takes over.
    /// Federate to RTI: I want to leave, at which tag may I? Not before this one.
    Depart {
        /// Its last tag, if it has not passed that tag yet.
        tag: Tag,
    },
    /// Federate to RTI: nothing happens here before this tag, unless a message arrives.
    NextEventTag {
        /// The earliest tag with something to do.
        tag: Tag,
    },
    /// The same from a federate that goes through tags level by level.
    NextEventLevel {
        /// The earliest step with something to do.
        step: Step,
        /// How many messages it knew of when it said so.
        received: u64,
    },
    /// Federate to RTI: this tag is complete and its messages are sent.
    LatestTagConfirmed {
        /// The completed tag.
        tag: Tag,
    },
    /// RTI to federate: no other federate waits for what this one does up to this tag, so it may skip its
    /// reports; `NEVER` if it has to report everything. A message that it sends ends this, too.
    DownstreamNextEventTag {
        /// The latest tag that need not be reported.
        tag: Tag,
        /// How many messages from that federate the RTI knew of. If there are more, this frame is void.
        sent: u64,
    },
    /// RTI to federate: every message up to this tag is before this frame.
    TagAdvanceGrant {
        /// The latest tag that it may process.
        tag: Tag,
    },
    /// RTI to a federate that goes through tags level by level: every message that is read up to
    /// this step is before this frame.
    ProvisionalTagAdvanceGrant {
        /// The latest step that it may process.
        through: Step,
    },
    /// A value in transit.
    Message {
        /// The connection that it takes.
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
        /// The owner's number for it.
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
    /// The receiver of a channel to its sender: so much more of what came on it has been processed.
    Processed {
        /// The channel.
        channel: ChannelId,
        /// How many messages.
        messages: u64,
        /// How much they count.
        bytes: u64,
    },
    /// Federate to RTI: end at this tag or soon after. RTI to the others: a federate or the user asks
    /// that.
    StopRequest {
        /// The earliest tag that suits.
        tag: Tag,
    },
    /// The answer: this one suits me, and I stay before it until you have decided.
    StopReply {
        /// The earliest tag that suits.
        tag: Tag,
    },
    /// RTI to all: this is the last tag.
    StopGranted {
        /// The last tag.
        tag: Tag,
    },
    /// Federate to RTI, decentralized: how far it is. From these the RTI finds out that a wait is
    /// useless.
    Progress {
        /// The earliest step with something to do.
        next: Step,
        /// Counts that have changed since the last such frame, of logical channels at this federate.
        counts: Vec<Count>,
    },
    /// RTI to federate, decentralized: every message that is read up to this step has arrived.
    Safe {
        /// The latest step for which that is so.
        through: Step,
    },
    /// On a direct link, between federates that go through tags level by level: no message comes on
    /// this channel at this tag, nor before.
    PortAbsent {
        /// The channel.
        channel: ChannelId,
        /// The tag.
        tag: Tag,
    },
    /// RTI to a federate that has sent nothing for a while: asks for a `Pong`.
    Ping,
    /// The answer.
    Pong,
    /// The sender has completed its last tag: nothing follows on this link. On a direct link it may
    /// also have left.
    Resign,
    /// Federate to RTI: I leave before the last tag, and the others go on without me.
    Leave {
        /// The last tag that it has processed, or that it was processing.
        tag: Tag,
    },
    /// RTI to the neighbours of a federate: it has ended, in order or not.
    Gone {
        /// That federate.
        federate: FederateId,
        /// Whether in order: then all that it has sent on a direct link ends with `Resign`.
        in_order: bool,
    },
    /// Federate to RTI: I cannot go on. RTI to all: this federate could not, end too.
    Failed {
        /// The federate that cannot go on.
        federate: FederateId,
        /// Why, for people.
        message: String,
        /// The exit code of its process.
        code: i32,
    },
    /// Federate to RTI, at any time: what does your clock show?
    ClockRequest {
        /// What the federate's clock shows.
        asked: PhysicalTime,
    },
    /// The answer.
    ClockReply {
        /// As in the question.
        asked: PhysicalTime,
        /// What the RTI's clock showed when the question came.
        received: PhysicalTime,
        /// And when this left.
        sent: PhysicalTime,
    },
    /// RTI to a federate whose fingerprint is another one: what is your program like?
    ProgramRequest,
    /// The answer.
    ProgramReply {
        /// The name of the federate there.
        name: String,
        /// All facts of its program.
        facts: Vec<Fact>,
    },
}

impl Frame {
    /// The name of its kind, for messages.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Hello { .. } => "Hello",
            Self::Refused { .. } => "Refused",
            Self::Peers { .. } => "Peers",
            Self::PeerHello { .. } => "PeerHello",
            Self::PeerWelcome { .. } => "PeerWelcome",
            Self::Loaded => "Loaded",
            Self::Ready { .. } => "Ready",
            Self::Start { .. } => "Start",
            Self::Joining { .. } => "Joining",
            Self::Met { .. } => "Met",
            Self::Joined { .. } => "Joined",
            Self::Depart { .. } => "Depart",
            Self::NextEventTag { .. } => "NextEventTag",
            Self::NextEventLevel { .. } => "NextEventLevel",
            Self::LatestTagConfirmed { .. } => "LatestTagConfirmed",
            Self::DownstreamNextEventTag { .. } => "DownstreamNextEventTag",
            Self::TagAdvanceGrant { .. } => "TagAdvanceGrant",
            Self::ProvisionalTagAdvanceGrant { .. } => "ProvisionalTagAdvanceGrant",
            Self::Message { .. } => "Message",
            Self::Segment { .. } => "Segment",
            Self::Retired { .. } => "Retired",
            Self::Release { .. } => "Release",
            Self::Processed { .. } => "Processed",
            Self::StopRequest { .. } => "StopRequest",
            Self::StopReply { .. } => "StopReply",
            Self::StopGranted { .. } => "StopGranted",
            Self::Progress { .. } => "Progress",
            Self::Safe { .. } => "Safe",
            Self::PortAbsent { .. } => "PortAbsent",
            Self::Ping => "Ping",
            Self::Pong => "Pong",
            Self::Resign => "Resign",
            Self::Leave { .. } => "Leave",
            Self::Gone { .. } => "Gone",
            Self::Failed { .. } => "Failed",
            Self::ClockRequest { .. } => "ClockRequest",
            Self::ClockReply { .. } => "ClockReply",
            Self::ProgramRequest => "ProgramRequest",
            Self::ProgramReply { .. } => "ProgramReply",
        }
    }
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
