//! The RTI's decisions as texts: `tests/rti/*.txt`.
//!
//! A text has a program as in `fixture`, then a line for each input, and below it, indented, what the
//! RTI sends. A federate `reaches` a level of a tag, or its `end`, `knowing` so many messages. A tag is
//! `time.microstep`, or the time alone; `before 10` is the last tag before 10. `at 10` is the clock. Of
//! a transient federate that is `not there` at the start, each `joins` makes a new instance. In an
//! `eager` federation the RTI sends a DNET whenever it can. The whole text is written anew from its
//! inputs and must come out the same.

use std::fmt::Write as _;
use std::sync::Arc;

use hprm_core::{ChannelId, FederateId, Payload, PhysicalTime, Program, Table, Tag};

use super::{DnetMode, LinkId, Rti, RtiInput, RtiOutput};
use crate::fixture::{federate, program};
use crate::{Attempt, Count, FederationId, Frame, HostId, PROTOCOL, Step, Topology};

struct Scenario {
    program: Program,
    rti: Rti,
    now: PhysicalTime,
    /// The latest link of each federate, and its former one.
    links: Table<FederateId, (u32, u32)>,
    next_link: u32,
}

impl Scenario {
    fn new(text: &str) -> Self {
        let program = program(text);
        let federation = FederationId(1);
        let mode = match text.lines().any(|line| line == "eager") {
            true => DnetMode::Eager,
            false => DnetMode::Usual,
        };
        let fingerprint = Arc::new(program.fingerprint());
        let rti = Rti::new(Topology::new(&program), federation, fingerprint, 0).dnet_mode(mode);
        let links = Table::filled(program.federates.len(), (0, 0));
        let now = PhysicalTime(0);
        let mut scenario = Self { program, rti, now, links, next_link: 0 };
        let there = |name: &str| !text.lines().any(|line| line == format!("not there: {name}"));
        let federates = scenario.program.federates.iter();
        let federates = federates.filter(|(_, federate)| there(&federate.name));
        let federates: Vec<_> = federates.map(|(id, _)| id).collect();
        federates.iter().for_each(|federate| scenario.hello(*federate));
        for federate in federates {
            scenario.input(federate, Frame::Ready { now });
        }
        while scenario.rti.poll().is_some() {}
        scenario
    }

    /// Opens a link and asks to join.
    fn hello(&mut self, federate: FederateId) {
        let (host, listen, protocol, federation) = (HostId(1), None, PROTOCOL, FederationId(1));
        self.links[federate] = (self.next_link, self.links[federate].0);
        self.next_link += 1;
        let fingerprint = self.program.fingerprint().digest();
        let attempt = Attempt { process: self.links[federate].0.into(), number: 0 };
        let hello = Frame::Hello {
            protocol,
            federation,
            fingerprint,
            federate,
            host,
            listen,
            attempt,
            launched: false,
        };
        self.input(federate, hello);
    }

    fn input(&mut self, from: FederateId, frame: Frame) {
        self.input_on(self.links[from].0, frame);
    }

    fn input_on(&mut self, link: u32, frame: Frame) {
        let link = LinkId(link);
        self.rti.handle(self.now, RtiInput::Frame { link, frame }).unwrap();
    }

    /// Time passes.
    fn at(&mut self, time: &str) {
        self.now = PhysicalTime(time.parse().unwrap());
        if self.rti.next_wakeup().is_some_and(|at| at <= self.now) {
            self.rti.handle(self.now, RtiInput::Wake).unwrap();
        }
    }

    fn line(&mut self, line: &str) {
        let words: Vec<_> = line.split_whitespace().collect();
        if let ["at", time] = words[..] {
            return self.at(time);
        }
        let from = federate(&self.program, words[0]);
        let frame = match words[1..] {
            ["next", at] => Frame::NextEventTag { tag: tag(at) },
            ["reaches", at, level, "knowing", received] => {
                let level = if level == "end" { u32::MAX } else { level.parse().unwrap() };
                let step = Step { tag: tag(at), level };
                Frame::NextEventLevel { step, received: received.parse().unwrap() }
            }
            ["completes", at] => Frame::LatestTagConfirmed { tag: tag(at) },
            ["sends", to, at] => {
                let (channel, payload) = (self.channel(from, to), Payload::default());
                Frame::Message { channel, tag: tag(at), payload }
            }
            ["reports", at, ref counts @ ..] => {
                let counts = counts.iter().map(|count| self.count(count)).collect();
                Frame::Progress { next: Step::begin(tag(at)), counts }
            }
            ["asks-stop", at] => Frame::StopRequest { tag: tag(at) },
            ["replies", at] => Frame::StopReply { tag: tag(at) },
            ["resigns"] => Frame::Resign,
            ["leaves"] => Frame::Leave { tag: Tag::NEVER },
            ["leaves", "after", at] => Frame::Leave { tag: tag(at) },
            ["wants", "to", "leave", "after", at] => Frame::Depart { tag: tag(at) },
            // The one that was there before.
            ["old", "leaves"] => {
                let frame = Frame::Leave { tag: Tag::NEVER };
                return self.input_on(self.links[from].1, frame);
            }
            ["old", "wants", "to", "leave", "after", at] => {
                return self.input_on(self.links[from].1, Frame::Depart { tag: tag(at) });
            }
            ["joins"] => return self.hello(from),
            ["has", "loaded"] => Frame::Loaded,
            ["is", "ready"] => Frame::Ready { now: self.now },
            ["meets", peer, "after", at] => {
                let federate = federate(&self.program, peer);
                Frame::Met { federate, incarnation: self.links[federate].0, after: tag(at) }
            }
            ["crashes"] => {
                let link = LinkId(self.links[from].0);
                return self.rti.handle(self.now, RtiInput::Closed { link }).unwrap();
            }
            _ => panic!("what does {line} mean?"),
        };
        self.input(from, frame);
    }

    fn channel(&self, from: FederateId, to: &str) -> ChannelId {
        let to = federate(&self.program, to);
        let mut channels = self.program.channels.iter();
        channels.find(|(_, c)| c.from == from && c.to == to).unwrap().0
    }

    /// `a>b=3`.
    fn count(&self, text: &str) -> Count {
        let (channel, messages) = text.split_once('=').unwrap();
        let (from, to) = channel.split_once('>').unwrap();
        let channel = self.channel(federate(&self.program, from), to);
        Count { channel, messages: messages.parse().unwrap() }
    }

    fn outputs(&mut self, text: &mut String) {
        let name = |id: FederateId| self.program.federates[id].name.clone();
        while let Some(output) = self.rti.poll() {
            let line = match output {
                RtiOutput::Send { link, frame } => {
                    let mut links = self.links.iter();
                    let of = |(_, links): &(_, &(u32, u32))| links.0 == link.0 || links.1 == link.0;
                    let to = name(links.find(of).unwrap().0);
                    let what = match frame {
                        Frame::TagAdvanceGrant { tag } => format!("may process {}", show(tag)),
                        Frame::ProvisionalTagAdvanceGrant {
                            through: Step { tag, level: u32::MAX },
                        } => {
                            format!("may process {}", show(tag))
                        }
                        Frame::ProvisionalTagAdvanceGrant { through: Step { tag, level } } => {
                            format!("may process {} up to level {level}", show(tag))
                        }
                        Frame::Safe { through } => {
                            format!("is safe through {}", show(through.whole()))
                        }
                        Frame::DownstreamNextEventTag { tag: Tag::NEVER, .. } => {
                            "reports everything".to_owned()
                        }
                        Frame::DownstreamNextEventTag { tag, .. } => {
                            format!("skips reports through {}", show(tag))
                        }
                        Frame::Message { tag, .. } => format!("gets a message for {}", show(tag)),
                        Frame::StopRequest { tag } => format!("is asked to stop at {}", show(tag)),
                        Frame::StopGranted { tag } => format!("stops at {}", show(tag)),
                        Frame::Gone { federate, .. } => {
                            format!("is told that {} is gone", name(federate))
                        }
                        Frame::Joining { peer } => {
                            format!("is told that {} is joining", name(peer.federate))
                        }
                        Frame::Joined { federate, first } => {
                            format!("is told that {} begins at {}", name(federate), show(first))
                        }
                        Frame::Depart { tag } => format!("must leave at {}", show(tag)),
                        Frame::Start { first, .. } => format!("begins at {}", show(first)),
                        Frame::Refused { reason } => format!("is refused: {reason}"),
                        Frame::Peers { peers, .. } => {
                            let peers: Vec<_> = peers.iter().map(|p| name(p.federate)).collect();
                            format!("is told of {}", peers.join(", "))
                        }
                        frame => panic!("no words for {frame:?}"),
                    };
                    format!("{to} {what}")
                }
                RtiOutput::Finished => "finished".to_owned(),
                RtiOutput::Joined { .. }
                | RtiOutput::Entered { .. }
                | RtiOutput::Close { .. }
                | RtiOutput::Refused { .. } => continue,
                RtiOutput::Withdrawn { federate, failure } => match failure {
                    Some((message, _)) => format!("{} withdraws: {message}", name(federate)),
                    None => format!("{} withdraws", name(federate)),
                },
                RtiOutput::Dropped { federate, message, .. } => {
                    format!("{} is dropped: {message}", name(federate))
                }
                output => panic!("no words for {output:?}"),
            };
            writeln!(text, "  {line}").unwrap();
        }
    }
}

fn tag(text: &str) -> Tag {
    let (time, microstep) = text.split_once('.').unwrap_or((text, "0"));
    match time {
        "forever" => Tag::FOREVER,
        time => Tag::new(time.parse().unwrap(), microstep.parse().unwrap()),
    }
}

fn show(tag: Tag) -> String {
    match tag {
        Tag::FOREVER => "forever".to_owned(),
        Tag { time, microstep: u32::MAX } => format!("before {}", time + 1),
        Tag { time, microstep: 0 } => format!("{time}"),
        Tag { time, microstep } => format!("{time}.{microstep}"),
    }
}

fn check(text: &str) {
    let (head, body) = text.split_once("---\n").unwrap();
    let mut scenario = Scenario::new(head);
    let mut again = String::new();
    for line in body.lines().filter(|line| !line.starts_with("  ")) {
        writeln!(again, "{line}").unwrap();
        if !line.is_empty() && !line.starts_with('#') {
            scenario.line(line);
            scenario.outputs(&mut again);
        }
    }
    assert_eq!(again, body);
}

macro_rules! scenarios {
    ($($name:ident)*) => {$(
        #[test]
        fn $name() {
            check(include_str!(concat!("../../tests/rti/", stringify!($name), ".txt")));
        }
    )*};
}

scenarios! {
    chain zero_delay_cycle diamond cycle dnet resign stop stop_twice stop_late patience
    departure transient transient_swap transient_cycle transient_end transient_withdraws transient_agrees
    transient_receiver transient_told_once
}
