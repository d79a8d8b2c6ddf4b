//! The RTI: which federates belong to the federation, when it starts and ends, and which frames it sends
//! them.
//!
//! This file has the machine's state, and passes each input to the code for it. Joining and starting are in
//! `join`, advancing in `advance`, the counts of direct messages under decentralized coordination in `traffic`,
//! agreeing on a last tag in `ending`, federates that join late in `arriving`, processes that ask to join
//! again in `attempts`, federates that leave where others read boards in `departures`, and federates that do not answer in `watch`. What people may see of it is in `overview`. The RTI never looks into a payload.

mod advance;
mod arriving;
mod attempts;
mod departures;
mod ending;
mod join;
mod overview;
#[cfg(test)]
mod scenarios;
#[cfg(test)]
mod tests;
mod traffic;
mod watch;

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;

use hprm_core::{
    ChannelId, Coordination, FederateId, Fingerprint, Nanos, Payload, PhysicalTime, Table, Tag,
};

use self::advance::Advance;
pub use self::advance::DnetMode;
use self::arriving::Arrivals;
use self::attempts::Attempts;
use self::departures::Departures;
use self::ending::Negotiation;
use self::join::{Candidate, Member};
use self::traffic::Traffic;
use self::watch::Watch;
pub use self::watch::{HangTimeout, show_silence};
use crate::boards::readings;
use crate::{Fault, FederationId, Frame, Missing, Refusal, Step, Topology, log};

/// A connection that the driver has accepted. The driver never uses a number twice.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub struct LinkId(pub u32);

/// What has happened to the RTI.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub enum RtiInput {
    /// A frame on a link.
    Frame {
        /// The link.
        link: LinkId,
        /// The frame.
        frame: Frame,
    },
    /// Chunks of a long message were read from a link or written to it, so the federate at its other end is not
    /// silent.
    ChunksMoved {
        /// The link.
        link: LinkId,
    },
    /// A link has ended.
    Closed {
        /// The link.
        link: LinkId,
    },
    /// A link cannot be used: its bytes are no frame, or break the protocol, or the RTI has no memory for them.
    /// The driver closes the link.
    Broken {
        /// The link.
        link: LinkId,
        /// What is wrong: the failure of the federate at the other end.
        message: String,
    },
    /// The user, or a program that is no federate, asks the federation to stop.
    RequestStop,
    /// Time has passed: [`Rti::next_wakeup`] has come.
    Wake,
}

/// What the RTI wants done.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub enum RtiOutput {
    /// Send a frame. The descriptor of a segment goes with its frame.
    Send {
        /// The link.
        link: LinkId,
        /// The frame.
        frame: Frame,
    },
    /// Close a link, once what was sent on it has left.
    Close {
        /// The link.
        link: LinkId,
    },
    /// The RTI has asked the process at the other end of a link for its program. The driver must accept a long
    /// answer: the process belongs to the federation.
    ProgramRequested {
        /// The link.
        link: LinkId,
    },
    /// A federate may not join.
    Refused {
        /// Its name, or its number if the program has no such federate.
        name: String,
        /// Why.
        reason: Refusal,
    },
    /// A federate belongs to the federation now.
    Joined {
        /// The federate.
        federate: FederateId,
        /// Its link.
        link: LinkId,
        /// Whether the launcher of the federation has started its process.
        launched: bool,
    },
    /// A federate's link has ended before all had joined. It may join again; the others wait for it.
    Left {
        /// The federate.
        federate: FederateId,
    },
    /// A federate has loaded its program, before the federation starts.
    Loaded {
        /// The federate.
        federate: FederateId,
    },
    /// A federate takes part that has joined the running federation.
    Entered {
        /// The federate.
        federate: FederateId,
    },
    /// A process that has joined the running federation does not take part after all. If another process is that federate,
    /// nothing changes about that one.
    Withdrawn {
        /// The federate.
        federate: FederateId,
        /// Why, for people, and the exit code of its process, if it could not continue.
        failure: Option<(String, i32)>,
    },
    /// All federates are ready, and know the time of tag zero.
    Started {
        /// The physical time of tag zero.
        at: PhysicalTime,
    },
    /// A federate has not answered for a while.
    Silent {
        /// The federate.
        federate: FederateId,
        /// For how long, in nanoseconds.
        silence: Nanos,
    },
    /// A federate that was reported as silent answers again.
    Answers {
        /// The federate.
        federate: FederateId,
        /// After how long, in nanoseconds.
        silence: Nanos,
    },
    /// A transient federate could not continue. The others continue without it.
    Dropped {
        /// The federate.
        federate: FederateId,
        /// Why, for people.
        message: String,
        /// The exit code of its process.
        code: i32,
    },
    /// A federate could not continue, and the RTI has told the others to end. The RTI reports only the first
    /// failure.
    Failed {
        /// The federate.
        federate: FederateId,
        /// Why, for people.
        message: String,
        /// The exit code of its process.
        code: i32,
    },
    /// Not all federates have joined in time. The RTI has refused those that had joined.
    Missing(Missing),
    /// All federates have ended.
    Finished,
}

/// How far the start of the federation has come.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
enum Phase {
    /// The RTI waits for federates to join.
    Joining,
    /// All have joined, and load their programs.
    Loading,
    /// The program runs.
    Running,
}

/// The RTI's machine.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub struct Rti {
    topology: Arc<Topology>,
    federation: FederationId,
    fingerprint: Arc<Fingerprint>,
    start_delay: Nanos,
    phase: Phase,
    members: Table<FederateId, Member>,
    /// Transient federates that have not started yet, while the others run.
    arrivals: Arrivals,
    links: BTreeMap<LinkId, FederateId>,
    attempts: Attempts,
    /// Links whose federates have been asked for their programs.
    candidates: BTreeMap<LinkId, Candidate>,
    /// Links that will be closed: the RTI has refused their processes, or those have given them up. The RTI
    /// ignores their frames.
    refused: BTreeSet<LinkId>,
    /// The physical time of tag zero.
    start: PhysicalTime,
    /// The physical time of the latest input. The RTI needs it only if federates join late or leave early.
    now: PhysicalTime,
    /// Whether federates may coordinate themselves by boards, and whether they do.
    allows_boards: bool,
    boards: bool,
    /// How many processes have joined as each federate.
    lives: Table<FederateId, u32>,
    /// Federates that have asked to leave, while the RTI asks others what they have done.
    departures: Departures,
    advance: Advance,
    traffic: Traffic,
    /// When the join timeout ends, and how long it is; none if the RTI waits without a limit.
    join_limit: Option<(PhysicalTime, Nanos)>,
    /// Federates that have joined, and whose links have ended before all had joined.
    left_early: BTreeSet<FederateId>,
    /// None, if the RTI does not watch for silent federates.
    watch: Option<Watch>,
    stop: Negotiation,
    /// Whether a federate has processed the last tag of the program.
    ended: bool,
    /// The latest of the last tags of the federates that have left; the program ends after it.
    latest_departure: Tag,
    /// Whether the federation has failed: a federate could not continue, or the start was called off.
    failed: bool,
    /// Whether the RTI has reported that all federates have ended.
    finished: bool,
    outputs: VecDeque<RtiOutput>,
}

impl Rti {
    /// The RTI of a federation that no federate has joined yet. The program starts `start_delay` after
    /// the latest federate has become ready.
    #[must_use]
    pub fn new(
        topology: Topology,
        federation: FederationId,
        fingerprint: Arc<Fingerprint>,
        start_delay: Nanos,
    ) -> Self {
        Self {
            federation,
            fingerprint,
            start_delay,
            phase: Phase::Joining,
            members: topology.federates().map(|_| Member::Absent).collect(),
            arrivals: Arrivals::default(),
            links: BTreeMap::new(),
            attempts: Attempts::default(),
            candidates: BTreeMap::new(),
            refused: BTreeSet::new(),
            start: PhysicalTime(0),
            now: PhysicalTime(0),
            allows_boards: false,
            boards: false,
            lives: Table::filled(topology.federates().count(), 0),
            departures: Departures::default(),
            advance: Advance::new(&topology),
            traffic: Traffic::new(&topology),
            join_limit: None,
            left_early: BTreeSet::new(),
            watch: None,
            stop: Negotiation::Idle,
            ended: false,
            latest_departure: Tag::NEVER,
            failed: false,
            finished: false,
            outputs: VecDeque::new(),
            topology: Arc::new(topology),
        }
    }

    /// Makes the RTI send downstream next event tags at other times than usual.
    #[must_use]
    pub fn dnet_mode(mut self, mode: DnetMode) -> Self {
        self.advance.set_dnet_mode(&self.topology, mode);
        self
    }

    /// The federates that must know of a process that joins as a federate, or ends: its neighbours; and where there are
    /// boards, those of which one reads the other's.
    fn concerned_by(&self, federate: FederateId) -> Vec<FederateId> {
        let mut concerned = self.topology.neighbours(federate).clone();
        if self.boards && self.topology.is_transient(federate) {
            let readings = readings(&self.topology).into_iter();
            concerned.extend(readings.filter_map(|it| it.partner_of(federate)));
        }
        concerned.into_iter().collect()
    }

    /// Lets federates that share memory coordinate themselves by boards there, where the program permits it; not if
    /// transient federates may `join_from_elsewhere`, perhaps from where the others do not reach them.
    #[must_use]
    pub fn with_boards(mut self, join_from_elsewhere: bool) -> Self {
        self.allows_boards = !(join_from_elsewhere && self.topology.has_transients());
        self
    }

    /// How many descriptors federates give one another so that each has the boards it reads; none for a program whose federates
    /// read no boards.
    #[must_use]
    pub fn board_descriptors(&self) -> usize {
        let readings =
            if self.has_use_for_boards() { readings(&self.topology) } else { Vec::new() };
        readings.into_iter().map(|it| it.descriptors().count()).sum()
    }

    /// Whether federates may join late.
    #[must_use]
    pub fn takes_transients(&self) -> bool {
        self.topology.has_transients()
    }

    /// Whether the federates coordinate themselves by boards, so that none waits for this RTI before a tag.
    #[must_use]
    pub fn leaves_it_to_boards(&self) -> bool {
        self.boards
    }

    /// Tells the RTI what has happened.
    ///
    /// # Errors
    ///
    /// If the input breaks the protocol. Nothing has changed; the link should be closed, and
    /// [`RtiInput::Closed`] reported.
    pub fn handle(&mut self, now: PhysicalTime, input: RtiInput) -> Result<(), Fault> {
        let leaves = matches!(input, RtiInput::Frame { frame: Frame::Depart { .. }, .. });
        if self.topology.has_transients() || leaves {
            self.now = now;
        }
        if log::is_on() {
            log::rti_input(&self.links, &input);
        }
        match input {
            RtiInput::ChunksMoved { link } => {
                if let Some(federate) = self.links.get(&link) {
                    self.note_frame(*federate, now);
                }
                Ok(())
            }
            RtiInput::Closed { link } => {
                self.closed(link, None);
                Ok(())
            }
            RtiInput::Broken { link, message } => {
                self.closed(link, Some(message));
                Ok(())
            }
            RtiInput::Wake => {
                self.apply_join_limit(now);
                self.check_for_silence(now);
                self.apply_arrival_limits();
                self.send_grants();
                Ok(())
            }
            RtiInput::RequestStop => {
                self.request_stop();
                Ok(())
            }
            RtiInput::Frame { link, frame: Frame::ClockRequest { asked } }
                if self.links.contains_key(&link) || self.candidates.contains_key(&link) =>
            {
                let frame = Frame::ClockReply { asked, received: now, sent: now };
                self.outputs.push_back(RtiOutput::Send { link, frame });
                Ok(())
            }
            RtiInput::Frame { link, frame } => match self.links.get(&link) {
                None if self.refused.contains(&link) => Ok(()),
                None if self.candidates.contains_key(&link) => self.candidate_frame(link, frame),
                None => self.hello(link, frame),
                Some(federate) if self.arrivals.is_link_of(*federate, link) => {
                    self.arrival_frame(*federate, frame)
                }
                Some(federate) => {
                    let federate = *federate;
                    self.note_frame(federate, now);
                    self.frame(federate, frame)
                }
            },
        }
    }

    /// A link cannot be used any more; if it has not just ended, `message` says why.
    fn closed(&mut self, link: LinkId, message: Option<String>) {
        self.refused.remove(&link);
        self.attempts.remove(link);
        self.candidates.remove(&link);
        let Some(federate) = self.links.remove(&link) else { return };
        if self.arrivals.is_link_of(federate, link) {
            self.arrival_lost(federate, message);
        } else if self.members[federate].link() == Some(link) {
            match message {
                Some(message) => self.broken(federate, message),
                None => self.lost(federate),
            }
        }
    }

    /// What the RTI wants done next, if anything.
    pub fn poll(&mut self) -> Option<RtiOutput> {
        let output = self.outputs.pop_front();
        if log::is_on() {
            output.iter().for_each(|output| log::rti_output(&self.links, output));
        }
        output
    }

    /// When the RTI wants an [`RtiInput::Wake`], if nothing happens before.
    #[must_use]
    pub fn next_wakeup(&self) -> Option<PhysicalTime> {
        // While reports lag behind messages, the RTI grants nothing, so it need not wake up for a grant that is due.
        let grants_nothing = self.failed || self.traffic.lags();
        let due = self.advance.next_due().filter(|_| !grants_nothing);
        let grant = due.map(|tag| tag.due(self.start));
        let arrival = self.arrivals.next_wakeup();
        let joined = self.join_limit.filter(|_| self.is_joining()).map(|(until, _)| until);
        [grant, arrival, self.next_silence(), joined].into_iter().flatten().min()
    }

    /// A frame from a member. Each arm checks the frame before it changes the state.
    fn frame(&mut self, from: FederateId, frame: Frame) -> Result<(), Fault> {
        let unexpected = Err(Fault::Unexpected { frame: frame.name() });
        let running = self.phase == Phase::Running;
        if !self.members[from].is_live() {
            return unexpected;
        }
        match frame {
            Frame::Loaded if !running => Ok(()),
            Frame::Pong if running => Ok(()),
            Frame::Ready { now } if self.phase == Phase::Loading => self.ready(from, now),
            Frame::Met { federate, incarnation, after } if running => {
                match self.departures.is_asked_by(federate) {
                    true => self.departure_answered(from, federate, incarnation, after),
                    false => self.neighbour_answered(from, federate, incarnation, after),
                }
                Ok(())
            }
            Frame::Failed { message, code, .. } => {
                self.fail(from, message, code);
                Ok(())
            }
            Frame::Board { .. }
            | Frame::Posting { .. }
            | Frame::Segment { .. }
            | Frame::Retired { .. }
            | Frame::Release { .. }
            | Frame::Processed { .. } => self.forwarded_frame(from, frame),
            Frame::Message { channel, tag, payload } if running => {
                self.message(from, channel, tag, payload)
            }
            Frame::NextEventTag { tag } if running && self.is_centralized() => {
                self.next_event(from, Step::begin(tag), 0);
                Ok(())
            }
            Frame::NextEventLevel { step, received } if running && self.is_centralized() => {
                self.next_event(from, step, received);
                Ok(())
            }
            Frame::LatestTagConfirmed { tag } if running && self.is_centralized() => {
                self.advance.complete(&self.topology, from, tag);
                self.send_grants();
                Ok(())
            }
            Frame::Progress { next, counts } if running && !self.is_centralized() => {
                self.traffic.count(&self.topology, from, &counts)?;
                self.next_event(from, next, 0);
                Ok(())
            }
            Frame::StopRequest { tag } if running => {
                self.stop_request(from, tag);
                Ok(())
            }
            Frame::StopReply { tag } if running => self.stop_reply(from, tag),
            Frame::Resign if running => {
                self.resigned(from);
                Ok(())
            }
            Frame::Depart { tag } if running => {
                match self.boards {
                    true => self.ask_before_departure(from, tag),
                    false => self.tell_to_leave(from, tag),
                }
                Ok(())
            }
            Frame::Leave { tag } if running => {
                self.left(from, tag);
                Ok(())
            }
            _ => unexpected,
        }
    }

    /// A frame from one federate to another, which the RTI only forwards.
    fn forwarded_frame(&mut self, from: FederateId, frame: Frame) -> Result<(), Fault> {
        let running = self.phase == Phase::Running;
        match frame {
            Frame::Board { owner, reader, .. }
                if owner == from
                    && self.boards
                    && (!running || self.topology.is_transient(reader)) =>
            {
                self.route(from, reader, frame)
            }
            Frame::Posting { owner, reader, .. } if owner == from && self.boards && running => {
                self.route(from, reader, frame)
            }
            Frame::Segment { owner, reader, .. } if owner == from => {
                self.route(from, reader, frame)
            }
            Frame::Retired { owner, reader, .. } if owner == from => {
                self.route(from, reader, frame)
            }
            Frame::Release { owner, reader, .. } if reader == from => {
                self.route(from, owner, frame)
            }
            Frame::Processed { channel, .. } if running => {
                let sender = self.topology.channel(channel, None, Some(from))?.from;
                self.route(from, sender, frame)
            }
            frame => Err(Fault::Unexpected { frame: frame.name() }),
        }
    }

    /// Whether the RTI decides how far each federate may advance, and carries all messages.
    fn is_centralized(&self) -> bool {
        self.topology.coordination() == Coordination::Centralized && !self.boards
    }

    /// Forwards a frame, unless its receiver has ended.
    fn route(&mut self, from: FederateId, to: FederateId, frame: Frame) -> Result<(), Fault> {
        if !self.topology.has(to) {
            return Err(Fault::UnknownFederate(to));
        }
        self.forward(from, to, frame);
        Ok(())
    }

    fn message(
        &mut self,
        from: FederateId,
        id: ChannelId,
        tag: Tag,
        payload: Payload,
    ) -> Result<(), Fault> {
        let channel = self.topology.channel(id, Some(from), None)?;
        let to = channel.to;
        let frame = Frame::Message { channel: id, tag, payload };
        if channel.physical {
            self.forward(from, to, frame);
            return Ok(());
        }
        if !self.is_centralized() {
            return Err(Fault::Unexpected { frame: frame.name() });
        }
        let read = Step { tag, level: channel.first_reader };
        if self.members[to].is_live() && tag >= self.advance.first(to) {
            let granted = self.advance.granted(to);
            if read <= granted {
                return Err(Fault::InThePast { tag, granted: granted.tag });
            }
            self.advance.sent(from);
            if self.forward(from, to, frame) {
                self.advance.forwarded_at(&self.topology, to, read);
                self.send_grants();
            }
        } else {
            self.advance.sent(from);
            if self.forward(from, to, frame) {
                self.advance.forwarded(to);
            }
        }
        Ok(())
    }

    /// Forwards a frame to a federate, unless the receiver has ended, or is joining and the sender does
    /// not know it yet. Returns whether the frame was forwarded.
    fn forward(&mut self, from: FederateId, to: FederateId, frame: Frame) -> bool {
        let link = self.members[to].link().or_else(|| self.arrivals.link_of(to, from));
        self.outputs.extend(link.map(|link| RtiOutput::Send { link, frame }));
        link.is_some()
    }

    /// A federate has reported its next event, and how many messages it had received by then.
    fn next_event(&mut self, from: FederateId, step: Step, received: u64) {
        self.advance.next(&self.topology, from, step, received);
        self.send_grants();
        self.end_if_starved();
        if let Some(frame) = self.advance.dnet(&self.topology, from).filter(|_| !self.boards) {
            self.send(from, frame);
        }
    }

    /// Ends the program for starvation, if no federate has any more events.
    fn end_if_starved(&mut self) {
        if !self.topology.starves() || self.traffic.lags() {
            return;
        }
        if let Some(tag) = self.advance.idle_stop() {
            self.ask_to_stop(tag);
        }
    }

    /// Sends the grants that are new and useful, and tells federates to report again if others need the reports
    /// that they skip.
    fn send_grants(&mut self) {
        if self.failed || self.boards || self.traffic.lags() {
            return;
        }
        let centralized = self.is_centralized();
        let elapsed = Tag::new(self.now.since(self.start).max(0), u32::MAX);
        for (federate, through) in self.advance.grants(&self.topology, elapsed) {
            let frame = match centralized {
                true if self.topology.is_stepwise(federate) => {
                    Frame::ProvisionalTagAdvanceGrant { through }
                }
                true => Frame::TagAdvanceGrant { tag: through.whole() },
                false => Frame::Safe { through },
            };
            self.send(federate, frame);
        }
        for (federate, frame) in self.advance.recall(&self.topology) {
            self.send(federate, frame);
        }
    }

    fn send(&mut self, to: FederateId, frame: Frame) {
        if let Some(link) = self.members[to].link() {
            self.outputs.push_back(RtiOutput::Send { link, frame });
        }
    }

    /// Tells the neighbours of a federate that the federate has ended, or does not join after all. From now on
    /// the RTI expects no message from it, and does not wait for messages to it to arrive.
    fn announce_end(&mut self, federate: FederateId, in_order: bool) {
        if self.phase == Phase::Joining {
            // The federates do not know of one another yet, and another process may join as this federate.
            return;
        }
        if self.phase == Phase::Running {
            self.advance.end(&self.topology, federate);
            // Under centralized coordination the RTI has forwarded all messages of the federate.
            let counted = in_order || self.is_centralized();
            self.traffic.end(&self.topology, federate, counted);
        }
        for neighbour in self.concerned_by(federate) {
            let link = self.members[neighbour].link();
            let link = link.or_else(|| self.arrivals.link_of_linking(neighbour));
            let frame = Frame::Gone { federate, in_order };
            self.outputs.extend(link.map(|link| RtiOutput::Send { link, frame }));
        }
    }

    fn send_all(&mut self, frame: &Frame) {
        for federate in self.topology.federates() {
            self.send(federate, frame.clone());
        }
    }
}
