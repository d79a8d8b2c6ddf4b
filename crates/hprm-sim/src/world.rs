//! A federation in virtual time: the RTI, the federates, and what is on its way between them.

use std::sync::Arc;

use hprm_core::{FederateId, Nanos, PhysicalTime, Program, Table, Tag};
use hprm_federated::{
    Fault, FederationId, Frame, Input, LinkId, Output, Rti, RtiInput, RtiOutput, Topology,
};

use crate::network::{Event, Network, Place};
use crate::node::Node;
use crate::{Log, Rng};

/// What is to happen besides the program.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Plan {
    /// The greatest latency of a link.
    pub latency: u64,
    /// A federate that asks to stop once it has processed that tag or a later one.
    pub stop: Option<(FederateId, Tag)>,
    /// A federate that is killed at that time.
    pub crash: Option<(FederateId, PhysicalTime)>,
}

/// What has become of a federation.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Outcome {
    /// What its reactions did.
    pub log: Log,
    /// The last tag of each federate.
    pub last: Table<FederateId, Tag>,
    /// How many messages came too late for their tag.
    pub tardy: usize,
    /// How many messages did not come at all before their receiver ended.
    pub lost: usize,
    /// Whom the RTI reported as failed.
    pub failed: Option<FederateId>,
}

/// See the module.
#[derive(Clone, Debug)]
pub struct World {
    program: Arc<Program>,
    rti: Rti,
    nodes: Table<FederateId, Node>,
    network: Network,
    failed: Option<FederateId>,
    finished: bool,
}

/// More than any of the small programs takes.
const STEPS: usize = 1_000_000;

/// From the last federate's readiness to the start.
const START_DELAY: Nanos = 10_000;

impl World {
    /// A federation whose processes have just been launched.
    #[must_use]
    pub fn new(program: &Arc<Program>, mut rng: Rng, plan: Plan) -> Self {
        let federation = FederationId(u128::from(rng.draw()));
        let topology = Topology::new(program);
        let stop = |me| plan.stop.filter(|(who, _)| *who == me).map(|(_, tag)| tag);
        let node = |me| Node::new(me, program, federation, stop(me));
        let mut world = Self {
            program: Arc::clone(program),
            nodes: program.federates.ids().map(node).collect(),
            rti: Rti::new(topology, federation, program.fingerprint(), START_DELAY),
            network: Network::new(Rng::new(rng.draw()), plan.latency),
            failed: None,
            finished: false,
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
        world
    }

    /// Runs until nothing more happens.
    ///
    /// # Errors
    ///
    /// If a machine finds fault with another, or the federation comes to rest before its end.
    pub fn run(mut self) -> Result<Outcome, String> {
        for _ in 0..STEPS {
            let Some((now, event)) = self.network.next() else {
                return self.outcome();
            };
            let shown = format!("{now:?} {event:?}");
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
        let lost = self.nodes.values().map(|node| node.sent).sum::<usize>()
            - self.nodes.values().map(|node| node.received).sum::<usize>();
        Ok(Outcome { log, last, tardy, lost, failed: self.failed })
    }

    fn step(&mut self, now: PhysicalTime, event: Event) -> Result<(), Fault> {
        match event {
            Event::Rti(input) => {
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
                if !self.nodes[federate].is_over() {
                    self.nodes[federate].crashed = true;
                    self.leave(now, federate);
                }
                Ok(())
            }
        }
    }

    /// One turn of a federate's loop.
    fn turn(&mut self, now: PhysicalTime, federate: FederateId, input: Input) -> Result<(), Fault> {
        let node = &mut self.nodes[federate];
        if node.is_over() {
            return Ok(());
        }
        node.input(now, input)?;
        let wake = node.advance(now)?;
        if let Some(at) = wake
            && node.wake.is_none_or(|known| at < known)
        {
            node.wake = Some(at);
            self.network.at(at, Event::Wake(federate));
        }
        let over = node.is_over();
        self.carry_out(now, federate);
        if over {
            self.leave(now, federate);
        }
        Ok(())
    }

    /// A federate's process ends, and so do its links.
    fn leave(&mut self, now: PhysicalTime, federate: FederateId) {
        let from = Place::Federate(federate);
        let closed = RtiInput::Closed { link: LinkId(u32::from(federate.0)) };
        self.network.send(now, from, Place::Rti, Event::Rti(closed));
        for to in self.program.federates.ids().filter(|to| *to != federate) {
            let lost = Event::Federate(to, Input::PeerLost(federate));
            self.network.send(now, from, Place::Federate(to), lost);
        }
    }

    fn carry_out(&mut self, now: PhysicalTime, federate: FederateId) {
        let from = Place::Federate(federate);
        while let Some(output) = self.nodes[federate].outputs.pop_front() {
            match output {
                Output::ToRti(frame) => {
                    let link = LinkId(u32::from(federate.0));
                    let event = Event::Rti(RtiInput::Frame { link, frame });
                    self.network.send(now, from, Place::Rti, event);
                }
                Output::ToPeer { to, frame } => {
                    let event = Event::Federate(to, Input::FromPeer { from: federate, frame });
                    self.network.send(now, from, Place::Federate(to), event);
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
                RtiOutput::Failed { federate, .. } => self.failed = Some(federate),
                RtiOutput::Finished => self.finished = true,
                _ => {}
            }
        }
    }

    fn announce(&mut self, now: PhysicalTime, link: LinkId, frame: Frame) {
        let to = FederateId(u16::try_from(link.0).expect("a link has its federate's number"));
        let event = Event::Federate(to, Input::FromRti(frame));
        self.network.send(now, Place::Rti, Place::Federate(to), event);
    }
}
