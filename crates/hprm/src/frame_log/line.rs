//! What a line of the frame log says: when, between which two, which kind of frame, and what matters of it.
//!
//! Columns stand two spaces apart, so that people and `cut` can tell them from words. No line has a value or a secret.

use std::fmt;

use hprm_core::{ChannelId, FederateId, PhysicalTime, Program, Tag};
use hprm_federated::{Frame, Step};

use super::Party;

/// A day in nanoseconds.
const DAY: i64 = 86_400_000_000_000;

/// In which direction a frame goes, seen from the one that writes the line.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Way {
    To(Party),
    From(Party),
}

impl Way {
    /// The other end.
    pub(super) fn party(self) -> Party {
        match self {
            Self::To(party) | Self::From(party) => party,
        }
    }
}

/// A line, without its end.
#[derive(Clone, Copy)]
pub(super) struct Line<'a> {
    pub(super) at: PhysicalTime,
    /// When the federation starts, if that is known.
    pub(super) start: Option<PhysicalTime>,
    pub(super) me: Party,
    pub(super) way: Way,
    pub(super) frame: &'a Frame,
    pub(super) program: &'a Program,
    /// Whether messages only refer to values.
    pub(super) in_process: bool,
}

impl fmt::Display for Line<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let word = if matches!(self.way, Way::To(_)) { "to" } else { "from" };
        let (me, other) = (self.name(self.me), self.name(self.way.party()));
        write!(f, "{}  {me} {word} {other}  {}", self.time(), self.frame.name())?;
        self.content(f)
    }
}

impl Line<'_> {
    /// The seconds since the start of the federation; before that is known, the time of day in UTC.
    fn time(&self) -> String {
        match self.start {
            #[expect(clippy::cast_precision_loss, reason = "of the digits, six are shown")]
            Some(start) => format!("{:+.6}", self.at.since(start) as f64 / 1e9),
            None => {
                let micros = self.at.0.rem_euclid(DAY) / 1_000;
                let (seconds, micros) = (micros / 1_000_000, micros % 1_000_000);
                let (hours, minutes) = (seconds / 3_600, seconds / 60 % 60);
                format!("{hours:02}:{minutes:02}:{:02}.{micros:06}", seconds % 60)
            }
        }
    }

    fn name(&self, party: Party) -> &str {
        match party {
            Party::Rti => "rti",
            Party::Federate(federate) => self.federate(federate),
            Party::Unknown => "?",
        }
    }

    /// A federate's name. A process with another program may state any number before it is refused.
    fn federate(&self, federate: FederateId) -> &str {
        let known = federate.index() < self.program.federates.len();
        if known { &self.program.federates[federate].name } else { "?" }
    }

    /// The ends of a channel, without the name of the main reactor.
    fn channel(&self, channel: ChannelId) -> String {
        let program = self.program;
        if channel.index() >= program.channels.len() {
            return "?".to_owned();
        }
        let connection = &program.connections[program.channels[channel].connection];
        let [from, to] = [connection.from, connection.to].map(|port| {
            let name = program.port_name(port);
            name.split_once('.').map_or(name.clone(), |(_, rest)| rest.to_owned())
        });
        format!("{from} -> {to}")
    }

    /// What matters of the frame.
    fn content(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.frame {
            Frame::Message { channel, tag, payload } => {
                match self.program.channels.get(*channel).is_some_and(|it| it.physical) {
                    true => write!(f, "  physical")?,
                    false => write!(f, "  {tag}")?,
                }
                write!(f, "  {}", self.channel(*channel))?;
                match self.in_process {
                    true => write!(f, "  by reference"),
                    false => write!(f, "  {} bytes", payload.byte_count()),
                }
            }
            Frame::PortAbsent { channel, tag } => write!(f, "  {tag}  {}", self.channel(*channel)),
            Frame::Processed { channel, messages, bytes } => {
                write!(f, "  {}  {messages} messages, {bytes} bytes", self.channel(*channel))
            }
            Frame::Segment { owner, len, .. } => {
                write!(f, "  of {}  {len} bytes", self.federate(*owner))
            }
            Frame::Retired { owner, segments, .. } => {
                write!(f, "  of {}  {} segments", self.federate(*owner), segments.len())
            }
            Frame::Release { owner, serials, .. } => {
                write!(f, "  of {}  {} objects", self.federate(*owner), serials.len())
            }
            Frame::Hello { federate, .. } | Frame::Gone { federate, .. } => {
                write!(f, "  {}", self.federate(*federate))
            }
            Frame::Joining { peer } => write!(f, "  {}", self.federate(peer.federate)),
            Frame::Refused { reason } => write!(f, "  {reason:?}"),
            Frame::Failed { federate, code, .. } => {
                write!(f, "  {}  exit code {code}", self.federate(*federate))
            }
            frame => self.tags(f, frame),
        }
    }

    /// The tag of a frame that has little else.
    fn tags(&self, f: &mut fmt::Formatter<'_>, frame: &Frame) -> fmt::Result {
        match frame {
            Frame::Start { first: tag, .. }
            | Frame::Depart { tag }
            | Frame::NextEventTag { tag }
            | Frame::LatestTagConfirmed { tag }
            | Frame::DownstreamNextEventTag { tag, .. }
            | Frame::TagAdvanceGrant { tag }
            | Frame::StopRequest { tag }
            | Frame::StopReply { tag }
            | Frame::StopGranted { tag }
            | Frame::Leave { tag } => write!(f, "  {tag}"),
            Frame::Joined { federate, first: tag } | Frame::Met { federate, after: tag, .. } => {
                write!(f, "  {tag}  {}", self.federate(*federate))
            }
            Frame::NextEventLevel { step, .. }
            | Frame::ProvisionalTagAdvanceGrant { through: step }
            | Frame::Progress { next: step, .. }
            | Frame::Safe { through: step } => write!(f, "  {}", Shown(*step)),
            _ => Ok(()),
        }
    }
}

/// A step as a tag, with the level if it is not after all reactions of the tag.
struct Shown(Step);

impl fmt::Display for Shown {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Step { tag, level } = self.0;
        match level == u32::MAX || tag == Tag::NEVER {
            true => write!(f, "{tag}"),
            false => write!(f, "{tag} level {level}"),
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use hprm_core::{
        Delay, Direction, Effect, Nanos, Payload, ProgramBuilder, Properties, ReactionSpec, Trigger,
    };

    use super::*;

    const CAMERA: Party = Party::Federate(FederateId(0));

    /// `camera.image -> detector.image`.
    pub(in crate::frame_log) fn two_federates() -> Program {
        let mut b = ProgramBuilder::new("Main", Properties::default());
        let [camera, detector] = ["camera", "detector"].map(|name| {
            let reactor = b.reactor(b.main(), name);
            b.federate(reactor, name, Nanos::MAX, None);
            reactor
        });
        let out = b.port(camera, "image", Direction::Output);
        let input = b.port(detector, "image", Direction::Input);
        b.connect(out, input, Delay::None);
        let triggers = vec![Trigger::Startup];
        let effects = vec![Effect::Port(out)];
        b.reaction(camera, ReactionSpec { triggers, effects, ..ReactionSpec::default() });
        let triggers = vec![Trigger::Port(input)];
        b.reaction(detector, ReactionSpec { triggers, ..ReactionSpec::default() });
        b.build().expect("a program")
    }

    fn line(way: Way, frame: &Frame, start: Option<i64>) -> String {
        let program = two_federates();
        let (at, start) = (PhysicalTime(DAY + 3_723_000_004_000), start.map(PhysicalTime));
        Line { at, start, me: CAMERA, way, frame, program: &program, in_process: false }.to_string()
    }

    #[test]
    fn a_message_shows_its_tag_its_channel_and_its_size() {
        let payload = Payload { head: vec![0; 42], ..Payload::default() };
        let tag = Tag { time: 10, microstep: 1 };
        let message = Frame::Message { channel: ChannelId(0), tag, payload };
        let to = Way::To(Party::Federate(FederateId(1)));
        assert_eq!(
            line(to, &message, Some(DAY + 3_722_500_000_000)),
            "+0.500004  camera to detector  Message  (10 ns, 1)  camera.image -> detector.image  42 bytes"
        );
    }

    #[test]
    fn before_the_start_is_known_a_line_has_the_time_of_day() {
        assert_eq!(
            line(Way::From(Party::Rti), &Frame::Ping, None),
            "01:02:03.000004  camera from rti  Ping"
        );
    }

    #[test]
    fn what_another_program_states_is_no_panic() {
        let federate = FederateId(7);
        let gone = Frame::Gone { federate, in_order: true };
        assert!(line(Way::From(Party::Unknown), &gone, None).ends_with("camera from ?  Gone  ?"));
        let absent = Frame::PortAbsent { channel: ChannelId(9), tag: Tag::NEVER };
        assert!(line(Way::From(Party::Rti), &absent, None).ends_with("PortAbsent  never  ?"));
    }
}
