//! A federation in virtual time: the RTI, the federates, and what is on its way between them.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::sync::Arc;

use hprm_core::{Coordination, FederateId, Nanos, PhysicalTime, Program, Table, Tag};
use hprm_federated::{
    End, Fault, FederationId, Frame, Input, LinkId, Output, Quieting, Refusal, Rti, RtiInput,
    RtiOutput, Topology,
};

use crate::network::{Event, Latency, Network, Partition, Place};
use crate::node::Node;
use crate::{Log, Maxwait, Rng};

/// What is to happen besides the program.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct Plan {
    /// How long things take on their way.
    pub latency: Latency,
    /// Somebody who is cut off for a while.
    pub partition: Option<Partition>,
    /// How each federate's clock deviates from true time; those that are not here do not.
    pub clocks: Vec<Skew>,
    /// A federate that asks to stop once it has processed that tag or a later one.
    pub stop: Option<(FederateId, Tag)>,
    /// Federates that leave, each at its first reaction at that tag or a later one.
    pub leaves: Vec<(FederateId, Tag)>,
    /// Federates that change after which tag how long they wait.
    pub maxwaits: Vec<Maxwait>,
    /// A federate that is killed at that time.
    pub crash: Option<(FederateId, PhysicalTime)>,
    /// A federate whose link to the RTI breaks at that time.
    pub cut: Option<(FederateId, PhysicalTime)>,
    /// How many bytes may be under way to a receiver when a tag begins, if not as many as usual.
    pub flow_limit: Option<u64>,
    /// When the RTI tells federates that nobody needs their reports.
    pub quieting: Quieting,
    /// When which federate's physical action is scheduled from outside.
    pub events: Vec<(FederateId, PhysicalTime)>,
}

/// How a clock deviates.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Default)]
pub struct Skew {
    /// By how much it is fast at time zero.
    pub offset: Nanos,
    /// How much it gains in a million.
    pub drift: Nanos,
}

impl Skew {
    /// What the clock says at a true time.
    fn local(self, time: PhysicalTime) -> PhysicalTime {
        let gained = i128::from(time.0) * i128::from(self.drift) / 1_000_000;
        let gained = Nanos::try_from(gained).unwrap_or(Nanos::MAX);
        PhysicalTime(time.0.saturating_add(self.offset).saturating_add(gained))
    }

    /// The first time at which it says that much or more.
    fn global(self, reading: PhysicalTime) -> PhysicalTime {
        let elapsed = i128::from(reading.0) - i128::from(self.offset);
        let time = elapsed * 1_000_000 / i128::from(1_000_000 + self.drift);
        let mut time = PhysicalTime(Nanos::try_from(time).unwrap_or(Nanos::MAX).saturating_sub(2));
        while self.local(time) < reading {
            time = time.plus(1);
        }
        time
    }
}

/// Something that happens, as a person reads it.
struct Shown {
    now: PhysicalTime,
    event: Event,
}

impl fmt::Display for Shown {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:>9} {:?}", self.now.0, self.event)
    }
}

/// What has become of a federation.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Outcome {
    /// What its reactions did.
    pub log: Log,
    /// The last tag of each federate.
    pub last: Table<FederateId, Tag>,
    /// Which of them left before the others.
    pub left: Table<FederateId, bool>,
    /// How many messages came too late for their tag.
    pub tardy: usize,
    /// How many messages did not come at all before their receiver ended, as far as it had to hear of
    /// them.
    pub lost: usize,
    /// Whom the RTI reported as failed.
    pub failed: Option<FederateId>,
    /// The last tag of the program, as far as any federate knew it.
    pub stop: Tag,
    /// How many things happened.
    pub events: usize,
    /// By how much, at most, a tag has begun after it was due by the federate's clock.
    pub lag: Nanos,
    /// How many frames the federates sent to the RTI, and the RTI to them.
    pub frames: (usize, usize),
}

/// See the module.
#[derive(Clone, Debug)]
pub struct World {
    program: Arc<Program>,
    rti: Rti,
    nodes: Table<FederateId, Node>,
    network: Network,
    clocks: Table<FederateId, Skew>,
    joined: Table<FederateId, bool>,
    /// The federates' links to the RTI; whoever joins again has another one.
    links: Table<FederateId, LinkId>,
    failed: Option<FederateId>,
    finished: bool,
    events: usize,
    frames: (usize, usize),
    /// What the RTI was told, if that is of interest.
    tape: Option<Vec<RtiInput>>,
}

/// More than any of the small programs takes.
const STEPS: usize = 1_000_000;

/// How long it takes until whoever has lost the RTI, or was killed, joins again.
const PAUSE: Nanos = 1_000;

/// From the last federate's readiness to the start.
const START_DELAY: Nanos = 10_000;

impl World {
    /// A federation whose processes have just been launched.
    #[must_use]
    pub fn new(program: &Arc<Program>, mut rng: Rng, plan: Plan) -> Self {
        let federation = FederationId(u128::from(rng.draw()));
        let topology = Topology::new(program);
        let fingerprint = Arc::new(program.fingerprint());
        let node = |me| Node::new(me, program, (federation, &fingerprint), &plan);
        let clock = |me: FederateId| plan.clocks.get(me.index()).copied().unwrap_or_default();
        let mut world = Self {
            program: Arc::clone(program),
            nodes: program.federates.ids().map(node).collect(),
            rti: Rti::new(topology, federation, Arc::clone(&fingerprint), START_DELAY)
                .quieting(plan.quieting),
            network: Network::new(Rng::new(rng.draw()), plan.latency, plan.partition),
            clocks: program.federates.ids().map(clock).collect(),
            joined: Table::filled(program.federates.len(), false),
            links: program.federates.ids().map(|me| LinkId(u32::from(me.0))).collect(),
            failed: None,
            finished: false,
            events: 0,
            frames: (0, 0),
            tape: None,
        };
        for federate in program.federates.ids() {
            world.nodes[federate].drain(PhysicalTime(0));
            world.carry_out(PhysicalTime(0), federate);
            let loaded = PhysicalTime(rng.below(5_000).cast_signed());
            world.network.at(loaded, Event::Federate(federate, Input::Loaded));
        }
        if let Some((federate, at)) = plan.crash {
            world.network.at(at, Event::Crash(federate));
        }
        if let Some((federate, at)) = plan.cut {
            world.network.at(at, Event::Cut(federate));
        }
        for (federate, at) in plan.events {
            world.network.at(at, Event::Happen(federate));
        }
        world
    }

    /// Runs it, and returns a new RTI and all that it is told in this run.
    ///
    /// # Errors
    ///
    /// As [`Self::run`].
    pub fn record(mut self) -> Result<(Rti, Vec<RtiInput>), String> {
        let rti = self.rti.clone();
        self.tape = Some(Vec::new());
        while let Some((now, event)) = self.network.next() {
            self.step(now, event).map_err(|fault| fault.to_string())?;
        }
        let tape = self.tape.take().unwrap_or_default();
        self.outcome().map(|_| (rti, tape))
    }

    /// Runs until nothing more happens.
    ///
    /// # Errors
    ///
    /// If a machine finds fault with another, or the federation comes to rest before its end.
    pub fn run(self) -> Result<Outcome, String> {
        self.run_watched(|_| {})
    }

    /// The same, and says each thing before it happens.
    ///
    /// # Errors
    ///
    /// As [`Self::run`].
    pub fn run_watched(
        mut self,
        mut watch: impl FnMut(&dyn fmt::Display),
    ) -> Result<Outcome, String> {
        while self.events < STEPS {
            let Some((now, event)) = self.network.next() else {
                return self.outcome();
            };
            self.events += 1;
            let shown = Shown { now, event: event.clone() };
            watch(&shown);
            self.step(now, event).map_err(|fault| format!("{fault}, at {shown}"))?;
        }
        Err("it goes on for ever".to_owned())
    }

    fn outcome(self) -> Result<Outcome, String> {
        if !self.finished {
            let at: Vec<_> = self.nodes.values().map(Node::last_tag).collect();
            return Err(format!("it has come to rest, with the federates at {at:?}"));
        }
        let mut log = Log::new(&self.program);
        for node in self.nodes.values() {
            for (reaction, entries) in node.log.entries.iter() {
                log.entries[reaction].extend(entries.iter().cloned());
            }
        }
        let last = self.nodes.values().map(Node::last_tag).collect();
        let tardy = self.nodes.values().map(|node| node.tardy).sum();
        let left: Table<FederateId, bool> = self.nodes.values().map(Node::has_left).collect();
        let lost = self.nodes.ids().map(|me| self.lost_to(me)).sum();
        let stop = self.nodes.values().map(Node::stop_tag).min().unwrap_or(Tag::FOREVER);
        let lag = self.nodes.values().map(|node| node.lag.0).max().unwrap_or(0);
        if let Some(wrong) = self.nodes.values().find_map(|node| node.patience.wrong()) {
            return Err(wrong.to_owned());
        }
        let (failed, events, frames) = (self.failed, self.events, self.frames);
        Ok(Outcome { log, last, left, tardy, lost, failed, stop, events, lag, frames })
    }

    /// How many messages did not come that a federate had to hear of; one that has left, before.
    fn lost_to(&self, me: FederateId) -> usize {
        let node = &self.nodes[me];
        let last = if node.has_left() { node.last_tag() } else { Tag::FOREVER };
        let until = |counts: &BTreeMap<Tag, usize>| -> usize {
            counts.range(..=last).map(|(_, n)| n).sum()
        };
        let sent: usize = self.nodes.values().map(|node| until(&node.sent[me])).sum();
        sent - until(&node.received)
    }

    fn step(&mut self, now: PhysicalTime, event: Event) -> Result<(), Fault> {
        match event {
            Event::Rti(input) => {
                if let Some(tape) = &mut self.tape {
                    tape.push(input.clone());
                }
                self.rti.handle(now, input)?;
                self.carry_out_rti(now);
                Ok(())
            }
            Event::Federate(federate, input) => self.turn(now, federate, input),
            Event::Wake(federate) => {
                let node = &mut self.nodes[federate];
                if node.wake.take_if(|wake| *wake == now).is_none() {
                    return Ok(());
                }
                self.turn(now, federate, Input::Wake)
            }
            Event::Dial { from, to } => {
                let hello = self.nodes[from].machine.peer_hello();
                if self.nodes[to].is_over() {
                    return Ok(());
                }
                let admitted = self.nodes[to].machine.admit(&hello);
                assert!(admitted.is_ok_and(|(peer, _)| peer == from), "{from:?} has a channel");
                self.turn(now, to, Input::PeerUp(from))?;
                let up = Event::Federate(from, Input::PeerUp(to));
                self.network.send(now, Place::Federate(to), Place::Federate(from), up);
                Ok(())
            }
            Event::Crash(federate) => {
                let node = &mut self.nodes[federate];
                if !node.is_over() {
                    node.crashed = true;
                    self.leave(now, federate);
                    if !self.joined[federate] {
                        self.network.at(now.plus(PAUSE), Event::Restart(federate));
                    }
                }
                Ok(())
            }
            Event::Restart(federate) => {
                self.restart(now, federate);
                Ok(())
            }
            Event::Cut(federate) => {
                if !self.nodes[federate].is_over() {
                    self.network.cut(now, federate, self.links[federate]);
                }
                Ok(())
            }
            Event::Happen(federate) => {
                if self.nodes[federate].is_running() {
                    let local = self.clocks[federate].local(now);
                    self.nodes[federate].happen(local)?;
                    self.advance(now, federate)?;
                }
                Ok(())
            }
        }
    }

    /// One turn of a federate's loop.
    fn turn(&mut self, now: PhysicalTime, federate: FederateId, input: Input) -> Result<(), Fault> {
        let local = self.clocks[federate].local(now);
        let node = &mut self.nodes[federate];
        if node.is_over() {
            return Ok(());
        }
        node.input(local, input)?;
        self.advance(now, federate)
    }

    /// A federate does what it may.
    fn advance(&mut self, now: PhysicalTime, federate: FederateId) -> Result<(), Fault> {
        let clock = self.clocks[federate];
        let node = &mut self.nodes[federate];
        let wake = node.advance(clock.local(now))?.map(|wake| clock.global(wake).max(now));
        if let Some(at) = wake
            && node.wake.is_none_or(|known| at < known)
        {
            node.wake = Some(at);
            self.network.at(at, Event::Wake(federate));
        }
        let over = node.is_over();
        let again = node.ended == Some(End::Refused(Refusal::Duplicate));
        self.carry_out(now, federate);
        if over && again {
            // Its predecessor has not been noticed to have ended.
            self.network.at(now.plus(PAUSE), Event::Restart(federate));
        }
        if over {
            self.leave(now, federate);
        }
        Ok(())
    }

    /// A federate whose process has ended before the start is launched again, if that helps.
    fn restart(&mut self, now: PhysicalTime, federate: FederateId) {
        if !self.nodes[federate].is_over() || self.failed.is_some() || self.finished {
            return;
        }
        self.nodes[federate] = self.nodes[federate].again();
        self.redial(now, federate);
        self.nodes[federate].drain(now);
        self.carry_out(now, federate);
        self.network.at(now.plus(PAUSE), Event::Federate(federate, Input::Loaded));
    }

    /// A federate opens another link to the RTI.
    fn redial(&mut self, now: PhysicalTime, federate: FederateId) {
        self.network.mend(federate);
        let (from, link) = (Place::Federate(federate), self.links[federate]);
        self.network.send(now, from, Place::Rti, Event::Rti(RtiInput::Closed { link }));
        let federates = u32::try_from(self.links.len()).expect("there are few");
        self.links[federate] = LinkId(link.0 + federates);
    }

    /// A federate's process ends, and so do its links.
    fn leave(&mut self, now: PhysicalTime, federate: FederateId) {
        let from = Place::Federate(federate);
        let closed = RtiInput::Closed { link: self.links[federate] };
        self.network.send(now, from, Place::Rti, Event::Rti(closed));
        for to in linked(&self.program, federate) {
            let lost = Event::Federate(to, Input::PeerLost(federate));
            self.network.send(now, from, Place::Federate(to), lost);
        }
    }

    fn carry_out(&mut self, now: PhysicalTime, federate: FederateId) {
        let from = Place::Federate(federate);
        while let Some(output) = self.nodes[federate].outputs.pop_front() {
            match output {
                Output::ToRti(frame) => {
                    let link = self.links[federate];
                    let event = Event::Rti(RtiInput::Frame { link, frame });
                    self.frames.0 += 1;
                    self.network.send(now, from, Place::Rti, event);
                }
                Output::ToPeer { to, frame } => {
                    let event = Event::Federate(to, Input::FromPeer { from: federate, frame });
                    self.network.send(now, from, Place::Federate(to), event);
                }
                Output::Rejoin => {
                    self.redial(now, federate);
                    let again = Event::Federate(federate, Input::Rejoins);
                    self.network.at(now.plus(PAUSE), again);
                }
                Output::Connect { peer, .. } => {
                    let event = Event::Dial { from: federate, to: peer };
                    self.network.send(now, from, Place::Federate(peer), event);
                }
                _ => {}
            }
        }
    }

    fn carry_out_rti(&mut self, now: PhysicalTime) {
        while let Some(output) = self.rti.poll() {
            match output {
                RtiOutput::Send { link, frame } => self.announce(now, link, frame),
                RtiOutput::Joined { federate, .. } => self.joined[federate] = true,
                RtiOutput::Left { federate } => {
                    self.joined[federate] = false;
                    if self.nodes[federate].crashed {
                        self.network.at(now.plus(PAUSE), Event::Restart(federate));
                    }
                }
                RtiOutput::Failed { federate, .. } => self.failed = Some(federate),
                RtiOutput::Finished => self.finished = true,
                _ => {}
            }
        }
    }

    fn announce(&mut self, now: PhysicalTime, link: LinkId, frame: Frame) {
        let federates = u32::try_from(self.links.len()).expect("there are few");
        let to = u16::try_from(link.0 % federates).expect("a link tells its federate's number");
        let to = FederateId(to);
        if self.links[to] != link {
            return;
        }
        let event = Event::Federate(to, Input::FromRti(frame));
        self.frames.1 += 1;
        self.network.send(now, Place::Rti, Place::Federate(to), event);
    }
}

/// With whom a federate has direct links.
pub(crate) fn linked(program: &Program, me: FederateId) -> BTreeSet<FederateId> {
    let decentralized = program.properties.coordination == Coordination::Decentralized;
    let channels = program.channels.values().filter(|channel| decentralized && !channel.physical);
    channels
        .flat_map(|channel| [(channel.from, channel.to), (channel.to, channel.from)])
        .filter_map(|(one, other)| (one == me && other != me).then_some(other))
        .collect()
}
