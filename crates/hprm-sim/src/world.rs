//! A federation in virtual time: the RTI, the federates, and the frames in transit between them.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::sync::Arc;

use hprm_core::{ChannelId, FederateId, Fingerprint, Nanos, PhysicalTime, Program, Table, Tag};
use hprm_federated::{
    End, Fault, FederationId, Frame, Input, LinkId, Output, Refusal, Rti, RtiInput, RtiOutput,
    Topology,
};

use crate::boards::Boards;
use crate::explained::{Seen, wrong_holds};
use crate::machines::Agents;
use crate::network::{Event, Instance, LinkEvent, Network, Place};
use crate::node::Node;
use crate::places::Places;
use crate::plan::{Outcome, Plan, Resets, Skew, Visit};
use crate::rng::mix;
use crate::{Log, Rng};

/// An event, as the log of a run shows it.
struct Shown {
    now: PhysicalTime,
    event: Event,
}

impl fmt::Display for Shown {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:>9} {:?}", self.now.0, self.event)
    }
}

/// See the module.
#[derive(Clone, Debug)]
pub struct World {
    program: Arc<Program>,
    rti: Rti,
    federation: FederationId,
    fingerprint: Arc<Fingerprint>,
    plan: Plan,
    /// All processes so far.
    nodes: BTreeMap<Instance, Node>,
    /// How many processes each federate has had.
    launched: Table<FederateId, u16>,
    rng: Rng,
    network: Network,
    clocks: Table<FederateId, Skew>,
    boards: Boards,
    joined: BTreeSet<Instance>,
    places: Places,
    failed: Option<FederateId>,
    finished: bool,
    /// What has been wrong, if anything was.
    wrong: Option<String>,
    /// The next wake-up of the RTI; other wake-ups are void.
    wake: Option<PhysicalTime>,
    /// The messages that broken links have lost.
    lost: Vec<(ChannelId, Tag)>,
    /// When the last process ended.
    over: PhysicalTime,
    events: usize,
    frames: (usize, usize),
    /// What federates and the RTI have waited for, by kind.
    seen: Seen,
    /// The inputs of the RTI, if they are recorded.
    tape: Option<Vec<RtiInput>>,
}

/// Several times as many steps as any of the small programs takes: a run that takes more goes on for ever.
const STEPS: usize = 200_000;

/// Every how many events, about, what federates say they wait for is looked at.
const LOOK: u64 = 16;

/// After how long a federate that has lost the RTI, or was killed, joins again.
const PAUSE: Nanos = 1_000;

/// The same if there are several machines, and the RTI may learn late that the former process has ended.
const LONG_PAUSE: Nanos = 500_000_000;

/// From the last federate's readiness to the start.
const START_DELAY: Nanos = 10_000;

fn rti(
    topology: Topology,
    federation: FederationId,
    fingerprint: Arc<Fingerprint>,
    plan: &Plan,
) -> Rti {
    let rti = Rti::new(topology, federation, fingerprint, START_DELAY).dnet_mode(plan.dnet);
    if plan.boards { rti.with_boards(false) } else { rti }
}

impl World {
    /// A federation whose processes have just been launched.
    #[must_use]
    pub fn new(program: &Arc<Program>, mut rng: Rng, plan: Plan) -> Self {
        let federation = FederationId(u128::from(rng.draw()));
        let topology = Topology::new(program);
        let fingerprint = Arc::new(program.fingerprint());
        let clock = |me: FederateId| plan.clocks.get(me.index()).copied().unwrap_or_default();
        let mut world = Self {
            program: Arc::clone(program),
            federation,
            fingerprint: Arc::clone(&fingerprint),
            nodes: BTreeMap::new(),
            launched: Table::filled(program.federates.len(), 0),
            rti: rti(topology, federation, fingerprint, &plan),
            boards: Boards::default(),
            network: Network::new(Rng::new(rng.draw()), &plan),
            clocks: program.federates.ids().map(clock).collect(),
            joined: BTreeSet::new(),
            places: Places::default(),
            failed: None,
            finished: false,
            wrong: None,
            wake: None,
            lost: Vec::new(),
            over: PhysicalTime(0),
            events: 0,
            frames: (0, 0),
            seen: Seen::new(),
            tape: None,
            rng,
            plan,
        };
        for federate in program.federates.ids() {
            if !world.plan.absent.contains(&federate) {
                world.launch(PhysicalTime(0), federate);
            }
        }
        let Plan { crash, cut, broken, visits, events, .. } = world.plan.clone();
        let crash = crash.map(|(federate, at)| (at, Event::Crash(federate)));
        let cut = cut.map(|(federate, at)| (at, Event::Cut(federate)));
        let broken = broken.map(|(one, other, at)| (at, Event::Break(one, other)));
        for (at, event) in [crash, cut, broken].into_iter().flatten() {
            world.network.at(at, event);
        }
        for (federate, at) in events {
            world.network.at(at, Event::Happen(federate));
        }
        for (federate, at, visit) in visits {
            let event = match visit {
                Visit::Launch => Event::Launch(federate),
                Visit::Leave => Event::Leave(federate),
                Visit::Crash => Event::Crash(federate),
            };
            world.network.at(at, event);
        }
        world
    }

    /// Launches a process that joins as a federate.
    fn launch(&mut self, now: PhysicalTime, federate: FederateId) {
        let me = Instance { federate, life: self.launched[federate] };
        self.launched[federate] += 1;
        let identity = (self.federation, &self.fingerprint);
        let node = Node::new(me, &self.program, identity, &self.plan);
        let loaded = now.plus(self.rng.below(5_000).cast_signed());
        self.begin(now, node, loaded);
    }

    fn pause(&self) -> Nanos {
        if self.plan.machines.is_some() { LONG_PAUSE } else { PAUSE }
    }

    /// A process joins, and has loaded its program at `loaded`.
    fn begin(&mut self, now: PhysicalTime, mut node: Node, loaded: PhysicalTime) {
        let me = node.me;
        node.drain(now);
        self.nodes.insert(me, node);
        self.carry_out(now, me);
        self.network.at(loaded, Event::Federate(me, Input::Loaded));
    }

    /// The process of a federate that was launched last, or the first one that is left.
    fn find(&self, federate: FederateId, is: impl Fn(&Node) -> bool) -> Option<Instance> {
        let lives = (0..self.launched[federate]).rev().map(|life| Instance { federate, life });
        lives.into_iter().find(|instance| is(&self.nodes[instance]))
    }

    /// Runs it, and returns a new RTI and all inputs that the RTI gets in this run.
    ///
    /// # Errors
    ///
    /// As [`Self::run`].
    pub fn record(mut self) -> Result<(Rti, Vec<RtiInput>), String> {
        let rti = self.rti.clone();
        self.tape = Some(Vec::new());
        while let Some((now, event)) = self.next() {
            self.step(now, event).map_err(|fault| fault.to_string())?;
        }
        let tape = self.tape.take().unwrap_or_default();
        self.outcome().map(|_| (rti, tape))
    }

    /// Runs until nothing more happens.
    ///
    /// # Errors
    ///
    /// If a machine rejects an input, or nothing more happens although the federation has not ended.
    pub fn run(self) -> Result<Outcome, String> {
        self.run_watched(|_| {})
    }

    /// The same, and shows each event before it happens.
    ///
    /// # Errors
    ///
    /// As [`Self::run`].
    pub fn run_watched(
        mut self,
        mut watch: impl FnMut(&dyn fmt::Display),
    ) -> Result<Outcome, String> {
        while self.events < STEPS {
            let Some((now, event)) = self.next() else {
                return self.outcome();
            };
            self.events += 1;
            let shown = Shown { now, event: event.clone() };
            watch(&shown);
            self.step(now, event).map_err(|fault| format!("{fault}, at {shown}"))?;
            if let Some(wrong) = self.wrong_explanation(now) {
                return Err(format!("{wrong}, at {shown}"));
            }
        }
        Err("it goes on for ever".to_owned())
    }

    /// Runs a federation that is too large for what [`Self::run`] looks at besides.
    ///
    /// # Errors
    ///
    /// As [`Self::run`].
    pub fn run_large(mut self) -> Result<Outcome, String> {
        while let Some((now, event)) = self.next() {
            self.events += 1;
            self.step(now, event).map_err(|fault| fault.to_string())?;
        }
        self.outcome()
    }

    /// The next event.
    fn next(&mut self) -> Option<(PhysicalTime, Event)> {
        let next = self.network.next();
        let lost = self.network.agents().map(Agents::take_lost);
        self.lose(&lost.unwrap_or_default());
        next
    }

    /// What is wrong with what the federates and the RTI say they wait for, if anything. It is looked at now and
    /// then.
    fn wrong_explanation(&mut self, now: PhysicalTime) -> Option<String> {
        if !mix(self.events as u64).is_multiple_of(LOOK) {
            return None;
        }
        let Self { nodes, clocks, rti, seen, .. } = self;
        for (me, node) in nodes.iter() {
            let local = clocks[me.federate].local(now);
            if let Some(wrong) = node.wrong_blockers(local, seen) {
                return Some(format!("{me:?}: {wrong}"));
            }
        }
        let links = |federate| {
            let lives = nodes.values().filter(|node| node.me.federate == federate);
            lives.map(Node::link).collect()
        };
        wrong_holds(rti, now, links, seen)
    }

    fn outcome(mut self) -> Result<Outcome, String> {
        let traffic = self.network.agents().map(|agents| agents.traffic());
        let wrong = self.network.agents().and_then(|agents| agents.wrong().map(str::to_owned));
        if let Some(wrong) = self.wrong.take().or(wrong) {
            return Err(wrong);
        }
        if !self.finished {
            let at: Vec<_> = self.nodes.values().map(Node::last_tag).collect();
            return Err(format!("nothing more happens, with the federates at {at:?}"));
        }
        if let Some((me, _)) = self.nodes.iter().find(|(_, node)| !node.is_over()) {
            return Err(format!("{me:?} waits for ever"));
        }
        let mut log = Log::new(&self.program);
        for node in self.nodes.values() {
            for (reaction, entries) in node.log.entries.iter() {
                log.entries[reaction].extend(entries.iter().cloned());
            }
        }
        let last_of = |federate| {
            let nodes = self.nodes.values().filter(|node| node.me.federate == federate);
            nodes.map(Node::last_tag).max().unwrap_or(Tag::NEVER)
        };
        let ids = || self.program.federates.ids();
        let has_left = |me| self.find(me, |_| true).is_some_and(|me| self.nodes[&me].has_left());
        let last: Table<FederateId, Tag> = ids().map(last_of).collect();
        let left = ids().map(has_left).collect();
        let tardy = self.nodes.values().map(|node| node.tardy).sum();
        let lost = ids().map(|me| self.lost_to(me)).sum();
        let stop = self.nodes.values().map(Node::stop_tag).min().unwrap_or(Tag::FOREVER);
        let lag = self.nodes.values().map(|node| node.lag.0).max().unwrap_or(0);
        if let Some(wrong) = self.nodes.values().find_map(|node| node.patience.wrong()) {
            return Err(wrong.to_owned());
        }
        if let Some(wrong) = self.nodes.values().find_map(Node::wrong_bound) {
            return Err(wrong);
        }
        // The tag of a message on a physical connection does not say when its receiver needs it.
        let missed = self.lost.iter().filter(|(channel, tag)| {
            let channel = &self.program.channels[*channel];
            !channel.physical && *tag <= last[channel.to]
        });
        let lost_from = missed.map(|(_, tag)| *tag).min().unwrap_or(Tag::FOREVER);
        let Self { failed, over, events, frames, seen, places, .. } = self;
        let lives = self.nodes.into_values().filter_map(Node::life).collect();
        Ok(Outcome {
            log,
            last,
            left,
            withdrawn: places.withdrawn,
            tardy,
            lost,
            failed,
            stop,
            lives,
            lost_from,
            traffic: traffic.unwrap_or_default(),
            over,
            events,
            lag,
            frames,
            seen,
        })
    }

    /// How many messages did not arrive that a federate had to get; if it has left, before it left.
    fn lost_to(&self, me: FederateId) -> usize {
        let node = self.find(me, |_| true).map(|me| &self.nodes[&me]);
        node.map_or(0, |node| node.missed_of(self.nodes.values()))
    }

    fn step(&mut self, now: PhysicalTime, event: Event) -> Result<(), Fault> {
        match event {
            Event::Rti(input) => self.step_rti(now, input),
            Event::WakeRti if self.wake == Some(now) => {
                self.wake = None;
                self.step_rti(now, RtiInput::Wake)
            }
            Event::WakeRti | Event::Told(_) => Ok(()),
            Event::Federate(federate, input) => self.turn(now, federate, input),
            Event::Released(federate) => self.turn(now, federate, Input::Wake),
            Event::Wake(federate) => {
                let Some(node) = self.nodes.get_mut(&federate) else { return Ok(()) };
                if node.wake.take_if(|wake| *wake == now).is_none() {
                    return Ok(());
                }
                self.turn(now, federate, Input::Wake)
            }
            Event::Connect { from, to } => self.connected(now, from, to),
            Event::Peer { from, to, link_event } => {
                self.take_link_event(now, (from, to), link_event)
            }
            Event::Launch(federate) => {
                if !self.finished {
                    self.launch(now, federate);
                }
                Ok(())
            }
            Event::Leave(federate) => match self.find(federate, Node::is_running) {
                Some(instance) => self.turn(now, instance, Input::RequestDeparture),
                None => Ok(()),
            },
            Event::Crash(federate) => {
                if let Some(instance) = self.find(federate, |node| !node.is_over()) {
                    self.node(instance).crashed = true;
                    self.leave(now, instance);
                    if !self.joined.contains(&instance) {
                        self.network.at(now.plus(self.pause()), Event::Restart(federate));
                    }
                }
                Ok(())
            }
            Event::Restart(federate) => {
                self.restart(now, federate);
                Ok(())
            }
            Event::Cut(federate) => {
                if let Some(instance) = self.find(federate, |node| !node.is_over()) {
                    let link = self.nodes[&instance].link();
                    let lost = self.network.cut(now, instance, link);
                    self.lose(&lost);
                }
                Ok(())
            }
            Event::Break(one, other) => {
                self.break_link(now, one, other);
                Ok(())
            }
            Event::Happen(federate) => {
                if let Some(instance) = self.find(federate, Node::is_running) {
                    let local = self.clocks[federate].local(now);
                    self.node(instance).happen(local)?;
                    self.advance(now, instance)?;
                    self.look_at_boards(now, instance)?;
                }
                Ok(())
            }
        }
    }

    fn node(&mut self, instance: Instance) -> &mut Node {
        self.nodes.get_mut(&instance).expect("only processes that were launched do something")
    }

    fn step_rti(&mut self, now: PhysicalTime, input: RtiInput) -> Result<(), Fault> {
        if let Some(tape) = &mut self.tape {
            tape.push(input.clone());
        }
        self.rti.handle(now, input)?;
        self.carry_out_rti(now);
        if let Some(at) = self.rti.next_wakeup().map(|at| at.max(now))
            && self.wake.is_none_or(|known| known != at)
        {
            self.wake = Some(at);
            self.network.at(at, Event::WakeRti);
        }
        Ok(())
    }

    /// A federate opens a direct link to another one. The link may end before the opener knows that it is up;
    /// then it opens the link again.
    fn connected(&mut self, now: PhysicalTime, from: Instance, to: Instance) -> Result<(), Fault> {
        let node = &self.nodes[&from];
        let opened = node.direct_links.has_opened(to) && !node.is_over();
        let admitted = node.machine.peer_hello();
        let admitted = self.nodes[&to].machine.admit(&admitted);
        if self.nodes[&to].is_over() || !opened || admitted.is_err() {
            self.send_link_event(now, to, from, LinkEvent::Lost);
            return Ok(());
        }
        let reset = self.plan.resets.as_mut().filter(|resets| resets.count > 0);
        let Some(Resets { count, pause }) = reset else {
            self.node(to).direct_links.accept(from);
            self.send_link_event(now, to, from, LinkEvent::Up);
            return self.turn(now, to, Input::PeerUp(from.federate));
        };
        *count -= 1;
        let (is_admitted, again) = (count.is_multiple_of(2), now.plus(*pause));
        let (one, other) = (Place::Federate(from), Place::Federate(to));
        if is_admitted {
            // What the acceptor sends on the link is lost.
            self.turn(now, to, Input::PeerUp(from.federate))?;
            let lost = Event::Federate(to, Input::PeerLost(from.federate));
            self.network.send(now, one, other, lost);
        }
        self.network.send(again, one, other, Event::Connect { from, to });
        Ok(())
    }

    /// A frame or the end of a direct link arrives, unless the receiver has closed it or opened another.
    fn take_link_event(
        &mut self,
        now: PhysicalTime,
        (from, to): (Instance, Instance),
        link_event: LinkEvent,
    ) -> Result<(), Fault> {
        let node = self.node(to);
        if node.is_over() || !node.direct_links.has(from) {
            return Ok(());
        }
        let input = match link_event {
            LinkEvent::Up => Input::PeerUp(from.federate),
            LinkEvent::Frame(frame) => Input::FromPeer { from: from.federate, frame },
            LinkEvent::Lost => {
                node.direct_links.forget(from);
                Input::PeerLost(from.federate)
            }
        };
        self.turn(now, to, input)
    }

    fn send_link_event(
        &mut self,
        now: PhysicalTime,
        from: Instance,
        to: Instance,
        link_event: LinkEvent,
    ) {
        let event = Event::Peer { from, to, link_event };
        self.network.send(now, Place::Federate(from), Place::Federate(to), event);
    }

    /// The direct link between two federates breaks, if they have one.
    fn break_link(&mut self, now: PhysicalTime, one: FederateId, other: FederateId) {
        let live = |federate| self.find(federate, |node: &Node| !node.is_over());
        let (Some(one), Some(other)) = (live(one), live(other)) else { return };
        if !self.nodes[&one].direct_links.has(other) && !self.nodes[&other].direct_links.has(one) {
            return;
        }
        // Its opener would open it again, as after a reset.
        if self.network.is_opening(one, other) {
            return;
        }
        let lost = self.network.cut_direct(now, one, other);
        self.lose(&lost);
    }

    fn lose(&mut self, frames: &[Frame]) {
        for frame in frames {
            if let Frame::Message { channel, tag, .. } = frame {
                self.lost.push((*channel, *tag));
            }
        }
    }

    /// One turn of a federate's loop.
    fn turn(&mut self, now: PhysicalTime, me: Instance, input: Input) -> Result<(), Fault> {
        let local = self.clocks[me.federate].local(now);
        let node = self.node(me);
        if node.is_over() {
            return Ok(());
        }
        if node.machine.reads_boards() {
            // It may see what some of them have shown before.
            let Self { boards, nodes, rng, .. } = self;
            let node = nodes.get_mut(&me).expect("it has a turn");
            boards.read(node, local, || rng.percent(50))?;
        }
        self.node(me).input(local, input)?;
        self.advance(now, me)?;
        self.look_at_boards(now, me)
    }

    /// After a federate has posted, it wakes up those that wait for that, if any sleeps that heeds boards. Before it sleeps, it reads
    /// the boards itself, if it heeds them, and advances if they permit it.
    fn look_at_boards(&mut self, now: PhysicalTime, me: Instance) -> Result<(), Fault> {
        if !self.node(me).machine.reads_boards() {
            return Ok(());
        }
        let local = self.clocks[me.federate].local(now);
        loop {
            let wakes = self.boards.take_posted(me) && self.is_heeded(me);
            let node = self.nodes.get_mut(&me).expect("it has a turn");
            let heeds = wakes || node.machine.heeds_boards();
            let any = heeds && self.boards.read(node, local, || true)?;
            let is_over = node.is_over();
            if wakes {
                self.wake_released(now, me);
            }
            if !any || is_over {
                return Ok(());
            }
            self.advance(now, me)?;
        }
    }

    /// Whether a federate sleeps that heeds the board of this one.
    fn is_heeded(&self, me: Instance) -> bool {
        let mut others = self.nodes.values().filter(|it| it.me != me && !it.is_over());
        others.any(|it| it.machine.heeds_boards())
    }

    fn wake_released(&mut self, now: PhysicalTime, me: Instance) {
        for released in self.node(me).machine.released() {
            let machines = self.plan.machines.as_ref();
            if machines.is_some_and(|it| !it.share_boards(me.federate, released)) {
                self.wrong.get_or_insert(format!("{me:?} cannot wake up {released:?} elsewhere"));
            }
            let to = self.boards.owner(me, released);
            let Some(to) = to.filter(|to| !self.nodes[to].is_over()) else { continue };
            let board = Place::Board(me.federate);
            self.network.send(now, board, Place::Federate(to), Event::Released(to));
        }
    }

    /// A federate advances as far as it may.
    fn advance(&mut self, now: PhysicalTime, me: Instance) -> Result<(), Fault> {
        let clock = self.clocks[me.federate];
        let node = self.node(me);
        let wake = node.advance(clock.local(now))?.map(|wake| clock.global(wake).max(now));
        if let Some(at) = wake
            && node.wake.is_none_or(|known| at < known)
        {
            node.wake = Some(at);
            self.network.at(at, Event::Wake(me));
        }
        let node = &self.nodes[&me];
        let over = node.is_over();
        let again = node.ended == Some(End::Refused(Refusal::Duplicate));
        self.carry_out(now, me);
        if over && again {
            // The RTI has not noticed yet that the predecessor has ended, if there was one.
            if self.launched[me.federate] == 1 {
                self.wrong.get_or_insert(format!("{me:?} is refused as a duplicate of itself"));
            }
            self.network.at(now.plus(self.pause()), Event::Restart(me.federate));
        }
        if over {
            self.leave(now, me);
        }
        Ok(())
    }

    /// A federate whose process has ended before the start is launched again, if that helps.
    fn restart(&mut self, now: PhysicalTime, federate: FederateId) {
        let Some(former) = self.find(federate, |_| true) else { return };
        let is_needed = !self.program.federates[federate].transient;
        if !is_needed || !self.nodes[&former].is_over() || self.failed.is_some() || self.finished {
            return;
        }
        let me = Instance { federate, life: self.launched[federate] };
        self.launched[federate] += 1;
        let node = self.nodes[&former].again(me);
        self.begin(now, node, now.plus(self.pause()));
    }

    /// A federate opens another link to the RTI. The RTI learns of the end of the former one at its own time.
    fn reconnect(&mut self, me: Instance) {
        self.network.relink(me);
        self.node(me).reconnect();
    }

    /// A federate's process ends, and so do its links.
    fn leave(&mut self, now: PhysicalTime, me: Instance) {
        self.over = now;
        let from = Place::Federate(me);
        let closed = RtiInput::Closed { link: self.nodes[&me].link() };
        self.network.send(now, from, Place::Rti, Event::Rti(closed));
        let breaks = self.plan.broken_at_end == Some(me.federate) && self.nodes[&me].finished;
        for peer in self.nodes[&me].direct_links.all() {
            if breaks {
                let lost = self.network.cut_direct(now, me, peer);
                self.lose(&lost);
            } else {
                self.send_link_event(now, me, peer, LinkEvent::Lost);
            }
        }
    }

    fn carry_out(&mut self, now: PhysicalTime, me: Instance) {
        let from = Place::Federate(me);
        while let Some(output) = self.node(me).outputs.pop_front() {
            match output {
                Output::ToRti(frame) => {
                    if self.network.is_severed(from, Place::Rti) {
                        self.lose(std::slice::from_ref(&frame));
                    }
                    let link = self.nodes[&me].link();
                    let event = Event::Rti(RtiInput::Frame { link, frame });
                    self.frames.0 += 1;
                    self.network.send(now, from, Place::Rti, event);
                }
                Output::ToPeer { to, frame } => {
                    if let Some(to) = self.nodes[&me].direct_links.to(to) {
                        if self.network.is_severed(from, Place::Federate(to)) {
                            self.lose(std::slice::from_ref(&frame));
                        }
                        self.send_link_event(now, me, to, LinkEvent::Frame(frame));
                    }
                }
                Output::Post(posting) => self.boards.post(me, posting),
                Output::Board { owner, notifier: false } => self.attach(me, owner),
                Output::Rejoin => {
                    self.reconnect(me);
                    self.network.at(now.plus(self.pause()), Event::Federate(me, Input::Rejoins));
                }
                Output::Connect { peer, listen } => self.connect(now, me, peer, &listen),
                Output::Disconnect(peer) => {
                    let closed = self.nodes[&me].direct_links.all().into_iter();
                    for former in closed.filter(|former| former.federate == peer) {
                        self.node(me).direct_links.forget(former);
                        self.send_link_event(now, me, former, LinkEvent::Lost);
                    }
                }
                _ => {}
            }
        }
    }

    /// A process gets the board of the process that is another federate, as far as it knows.
    fn attach(&mut self, me: Instance, owner: FederateId) {
        let machines = self.plan.machines.as_ref();
        if machines.is_some_and(|it| !it.share_boards(me.federate, owner)) {
            self.wrong.get_or_insert(format!("{me:?} cannot map a board of {owner:?}, elsewhere"));
        }
        let known = self.node(me).machine.listens_at(owner).map(|address| Instance::at(&address));
        let latest = |world: &Self| world.find(owner, |node| node.machine.reads_boards());
        if let Some(owner) = known.or_else(|| latest(self)) {
            self.boards.attach(me, owner);
        }
    }

    /// Opens a direct link, unless the process that listened there has ended. On another machine, that is found there.
    fn connect(&mut self, now: PhysicalTime, me: Instance, peer: FederateId, listen: &str) {
        let to = Instance::at(listen);
        let (from, place) = (Place::Federate(me), Place::Federate(to));
        if self.nodes[&to].is_over() && !self.network.are_apart(from, place) {
            let reason = "refused".to_owned();
            self.network.at(now, Event::Federate(me, Input::Unreachable { peer, reason }));
            return;
        }
        if let Some(former) = self.node(me).direct_links.open(to) {
            self.send_link_event(now, me, former, LinkEvent::Lost);
        }
        self.network.send(now, from, place, Event::Connect { from: me, to });
    }

    fn carry_out_rti(&mut self, now: PhysicalTime) {
        while let Some(output) = self.rti.poll() {
            self.compare_places(&output);
            match output {
                RtiOutput::Send { link, frame } => self.announce(now, link, frame),
                RtiOutput::Close { link } => self.close_link(now, link),
                RtiOutput::Joined { link, .. } => {
                    self.joined.insert(Instance::of_link(link));
                }
                RtiOutput::Left { federate } => {
                    let Some(me) = self.find(federate, |_| true) else { continue };
                    self.joined.remove(&me);
                    if self.nodes[&me].crashed {
                        self.network.at(now.plus(self.pause()), Event::Restart(federate));
                    }
                }
                RtiOutput::Failed { federate, .. } => self.failed = Some(federate),
                RtiOutput::Finished => self.finished = true,
                _ => {}
            }
        }
    }

    /// What the RTI tells of processes must be true, as far as the RTI can know. Between machines it may be late.
    fn compare_places(&mut self, output: &RtiOutput) {
        let Self { nodes, network, plan, places, wrong, .. } = self;
        let is_well = |link: LinkId| {
            let me = Instance::of_link(link);
            let is_reached = !network.is_severed(Place::Federate(me), Place::Rti);
            let node = &nodes[&me];
            let runs = node.link() == link && !node.is_over() && !node.given_up;
            plan.machines.is_none() && is_reached && runs
        };
        *wrong = wrong.take().or_else(|| places.told(output, &plan.by_hand, is_well));
    }

    /// The RTI sends a frame, unless the federate has another link by now.
    fn announce(&mut self, now: PhysicalTime, link: LinkId, frame: Frame) {
        let to = Instance::of_link(link);
        if self.nodes[&to].link() == link {
            self.frames.1 += 1;
            let event = Event::Federate(to, Input::FromRti(frame));
            self.network.send(now, Place::Rti, Place::Federate(to), event);
        }
    }

    /// The RTI closes a link.
    fn close_link(&mut self, now: PhysicalTime, link: LinkId) {
        let to = Instance::of_link(link);
        if self.nodes[&to].link() == link {
            let lost = Event::Federate(to, Input::RtiLost);
            self.network.send(now, Place::Rti, Place::Federate(to), lost);
            self.network.sever(Place::Rti, Place::Federate(to));
            self.node(to).given_up = true;
        }
        self.network.read_no_more(link);
        self.network.at(now, Event::Rti(RtiInput::Closed { link }));
    }
}
