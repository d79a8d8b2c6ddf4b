//! A federation between two actions: the machines, and the frames in transit between them.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use hprm_core::{FederateId, Fingerprint, PhysicalTime, Program, Table, Tag};
use hprm_federated::{
    Fault, FederationId, Frame, Input, LinkId, Output, Posting, Rti, RtiInput, RtiOutput, Step,
    Topology,
};

use super::Setting;
use super::digest::{Shared, digest};
use super::links::Links;
use super::moves::{Move, Moves};
use crate::network::{Event, Instance, LinkEvent, Place};
use crate::node::{Node, Turn};
use crate::plan::Life;
use crate::{Machines, Plan};

/// When the processes are launched: late enough for a start in the past.
const LAUNCH: PhysicalTime = PhysicalTime(1_000_000_000);

/// An event from outside that may happen once, at any moment.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub enum Happening {
    /// A federate asks to stop.
    Stop(FederateId),
    /// A federate leaves, and all is well.
    Leave(FederateId),
    /// A federate's process dies.
    Crash(FederateId),
    /// The link between a federate and the RTI breaks; frames in transit are lost.
    Disconnect(FederateId),
    /// A federate's physical action is scheduled.
    Event(FederateId),
    /// A transient federate that has not joined, or has ended, is launched. Federates for which that may
    /// happen are absent at the beginning.
    Arrive(FederateId),
    /// A federate asks to leave, as `lf.stop()` does.
    Depart(FederateId),
    /// The direct link between two federates breaks.
    Break(FederateId, FederateId),
}

/// A step from one state to the next.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub enum Action {
    /// The oldest event in transit from the one to the other arrives.
    Deliver(Place, Place),
    /// A federate advances: it reports, or processes a tag.
    Advance(FederateId),
    /// Physical time advances to this time.
    Time(PhysicalTime),
    /// A wake-up of the RTI.
    Wake,
    /// An event from outside.
    Happens(Happening),
}

/// A federate, and what an observer has noted of it.
#[derive(Clone, PartialEq, Eq, Hash)]
pub(super) struct Seat {
    pub(super) node: Node,
    /// The largest grant that it has received.
    pub(super) granted: Step,
}

/// See the module.
#[derive(Clone)]
pub(super) struct State {
    pub(super) now: PhysicalTime,
    rti: Shared<Rti>,
    /// The latest process of each federate.
    pub(super) seats: Table<FederateId, Shared<Seat>>,
    federation: FederationId,
    fingerprint: Arc<Fingerprint>,
    plan: Arc<Plan>,
    /// The records of earlier processes.
    pub(super) past: Shared<Vec<Life>>,
    pub(super) links: Links,
    /// What machines are known to do.
    moves: Moves,
    /// The events from outside that may still happen.
    pub(super) happenings: BTreeSet<Happening>,
    pub(super) failed: Option<FederateId>,
    pub(super) finished: bool,
    /// Links that have broken, or that one end has closed.
    broken: BTreeSet<(Place, Place)>,
    /// The least tag of a message that a broken link has lost.
    pub(super) lost_from: Tag,
    /// Federates that have left.
    pub(super) left: BTreeSet<FederateId>,
    /// The physical action that has been scheduled.
    pub(super) event: Option<(FederateId, Tag)>,
    /// What processes show, if some get the boards of others later.
    posted: BTreeMap<Instance, Posting>,
}

impl State {
    /// A federation whose processes have just been launched. Tag zero will be `start_delay` after
    /// the last federate has become ready.
    pub(super) fn new(program: &Arc<Program>, setting: &Setting) -> Self {
        let Setting { ref happenings, start_delay, flow_limit, dnet, boards, .. } = *setting;
        let federation = FederationId(1);
        let topology = Topology::new(program);
        let fingerprint = Arc::new(program.fingerprint());
        let rti = Rti::new(topology, federation, Arc::clone(&fingerprint), start_delay);
        let rti = rti.dnet_mode(dnet);
        let rti = if boards { rti.with_boards(false) } else { rti };
        let plan = Plan { flow_limit, machines: machines(program, setting), ..Plan::default() };
        let seat = |me| {
            let me = Instance::first(me);
            let mut node = Node::new(me, program, (federation, &fingerprint), &plan);
            node.crashed = happenings.contains(&Happening::Arrive(me.federate));
            Shared::new(Seat { node, granted: Step::NEVER })
        };
        let mut state = Self {
            now: LAUNCH,
            rti: Shared::new(rti),
            seats: program.federates.ids().map(seat).collect(),
            federation,
            fingerprint: Arc::clone(&fingerprint),
            plan: Arc::new(plan),
            past: Shared::new(Vec::new()),
            links: Links::default(),
            moves: Moves::default(),
            happenings: happenings.iter().copied().collect(),
            failed: None,
            finished: false,
            broken: BTreeSet::new(),
            lost_from: Tag::FOREVER,
            left: BTreeSet::new(),
            event: None,
            posted: BTreeMap::new(),
        };
        for me in program.federates.ids() {
            if !state.seats[me].get().node.is_over() {
                state.begin(me);
            }
        }
        state
    }

    /// The process of a federate joins.
    fn begin(&mut self, me: FederateId) {
        let now = self.now;
        self.seats[me].change(|seat| seat.node.drain(now));
        self.carry_out(me);
        let place = self.place(me);
        self.send(place, place, Event::Federate(self.instance(me), Input::Loaded));
    }

    /// The process of a federate has ended before the start, and is launched again.
    fn launch(&mut self, me: FederateId) {
        let Instance { federate, life } = self.instance(me);
        let again = Instance { federate, life: life + 1 };
        self.seats[me].change(|seat| seat.node = seat.node.again(again));
        self.begin(me);
    }

    /// The latest process of a federate.
    fn instance(&self, me: FederateId) -> Instance {
        self.seats[me].get().node.me
    }

    /// Its link to the RTI.
    fn link(&self, me: FederateId) -> LinkId {
        self.seats[me].get().node.link()
    }

    /// The latest process of a federate, as the end of a link.
    pub(super) fn place(&self, me: FederateId) -> Place {
        Place::Federate(self.instance(me))
    }

    /// The hash of everything in which states can differ.
    pub(super) fn digest(&self) -> u128 {
        let seats: Vec<_> = self.seats.values().map(Shared::digest).collect();
        let parts = (self.now, self.rti.digest(), seats, &self.links, &self.happenings);
        let rest = (self.failed, self.finished, &self.broken, &self.left, self.event);
        digest(&(parts, rest, self.past.digest(), self.lost_from, &self.posted))
    }

    /// Whether that action tells a federate of the start.
    pub(super) fn is_start(&self, action: Action) -> bool {
        let Action::Deliver(from, to) = action else { return false };
        let next = self.links.on((from, to)).next();
        matches!(next, Some(Event::Federate(_, Input::FromRti(Frame::Start { .. }))))
    }

    /// Whether no federate knows of the start, and all learn of it next.
    pub(super) fn is_about_to_start(&self) -> bool {
        let start = |me| Action::Deliver(Place::Rti, self.place(me));
        let mut there = self.seats.ids().filter(|me| !self.seats[*me].get().node.is_over());
        there.all(|me| self.is_start(start(me)))
    }

    /// How many logical messages have arrived.
    pub(super) fn messages(&self) -> usize {
        self.seats.values().map(|seat| seat.get().node.received.values().sum::<usize>()).sum()
    }

    /// The deliveries that are possible.
    pub(super) fn deliveries(&self) -> impl Iterator<Item = Action> {
        self.links.ends().map(|(from, to)| Action::Deliver(from, to))
    }

    /// What may happen from outside.
    pub(super) fn events(&self) -> impl Iterator<Item = Action> {
        let possible = self.happenings.iter().filter(|happening| match **happening {
            Happening::Stop(me)
            | Happening::Leave(me)
            | Happening::Event(me)
            | Happening::Depart(me) => self.seats[me].get().node.is_running(),
            Happening::Arrive(me) => self.seats[me].get().node.is_over() && !self.finished,
            Happening::Break(one, other) => {
                let is_over = |me: FederateId| self.seats[me].get().node.is_over();
                let linked = self.seats[one].get().node.direct_links.has(self.instance(other));
                linked && !is_over(one) && !is_over(other)
            }
            Happening::Crash(me) | Happening::Disconnect(me) => {
                !self.seats[me].get().node.is_over() && self.failed.is_none()
            }
        });
        possible.map(|happening| Action::Happens(*happening))
    }

    /// The oldest event in transit on a link arrives.
    pub(super) fn deliver(&mut self, from: Place, to: Place) -> Result<(), Fault> {
        let Some(event) = self.links.pop((from, to)) else { return Ok(()) };
        match event {
            Event::Rti(input) => self.rti_input(input),
            Event::Federate(me, input) => self.input(me, input),
            Event::Connect { from, to } => self.connected(from, to),
            Event::Peer { from, to, link_event } => self.take_link_event(from, to, link_event),
            _ => Ok(()),
        }
    }

    /// A federate opens a direct link to another one.
    fn connected(&mut self, from: Instance, to: Instance) -> Result<(), Fault> {
        let opener = &self.seats[from.federate].get().node;
        let hello = opener.machine.peer_hello();
        let opened = opener.me == from && opener.direct_links.has_opened(to);
        let node = &self.seats[to.federate].get().node;
        if node.me != to || node.is_over() || !opened || node.machine.admit(&hello).is_err() {
            self.send_link_event(to, from, LinkEvent::Lost);
            return Ok(());
        }
        self.seats[to.federate].change(|seat| seat.node.direct_links.accept(from));
        self.send_link_event(to, from, LinkEvent::Up);
        self.input(to, Input::PeerUp(from.federate))
    }

    /// A frame or the end of a direct link arrives, unless the receiver has closed it or opened another.
    fn take_link_event(
        &mut self,
        from: Instance,
        to: Instance,
        link_event: LinkEvent,
    ) -> Result<(), Fault> {
        let node = &self.seats[to.federate].get().node;
        if node.me != to || !node.direct_links.has(from) {
            return Ok(());
        }
        let peer = from.federate;
        let input = match link_event {
            LinkEvent::Up => Input::PeerUp(peer),
            LinkEvent::Frame(frame) => Input::FromPeer { from: peer, frame },
            LinkEvent::Lost => {
                self.seats[to.federate].change(|seat| seat.node.direct_links.forget(from));
                Input::PeerLost(peer)
            }
        };
        self.input(to, input)
    }

    fn send_link_event(&mut self, from: Instance, to: Instance, link_event: LinkEvent) {
        let event = Event::Peer { from, to, link_event };
        self.send(Place::Federate(from), Place::Federate(to), event);
    }

    /// The next wake-up of the RTI.
    pub(super) fn rti_wakeup(&self) -> Option<PhysicalTime> {
        self.rti.get().next_wakeup()
    }

    /// A wake-up of the RTI.
    pub(super) fn wake_rti(&mut self) -> Result<(), Fault> {
        self.rti_input(RtiInput::Wake)
    }

    /// A federate advances. Returns until when it waits, if it has not processed a tag.
    pub(super) fn advance(&mut self, me: FederateId) -> Result<Turn, Fault> {
        self.go(me, Move::Advance)
    }

    /// A federate does something.
    fn go(&mut self, me: FederateId, what: Move) -> Result<Turn, Fault> {
        let moved = self.moves.of_seat(&self.seats[me], self.now, what);
        self.seats[me] = moved.machine.clone();
        let turn = moved.result.clone()?;
        self.carry_out_all(me, &moved.outputs);
        Ok(turn)
    }

    /// An event from outside happens.
    pub(super) fn happen(&mut self, happening: Happening) -> Result<(), Fault> {
        self.happenings.remove(&happening);
        let now = self.now;
        match happening {
            Happening::Stop(me) => self.input(self.instance(me), Input::RequestStop),
            Happening::Depart(me) => self.input(self.instance(me), Input::RequestDeparture),
            Happening::Arrive(me) => {
                self.arrive(me);
                Ok(())
            }
            Happening::Break(one, other) => {
                self.break_link(self.instance(one), self.instance(other));
                Ok(())
            }
            Happening::Leave(me) => {
                self.left.insert(me);
                self.seats[me].change(|seat| {
                    let left = seat.node.input(now, Input::Leave);
                    seat.node.finished = true;
                    left
                })?;
                self.carry_out(me);
                Ok(())
            }
            Happening::Crash(me) => {
                self.seats[me].change(|seat| seat.node.crashed = true);
                self.leave(me);
                Ok(())
            }
            Happening::Disconnect(me) => {
                let (rti, place) = (Place::Rti, self.place(me));
                self.broken.extend([(rti, place), (place, rti)]);
                self.links.cut((place, rti));
                // The federate may open another link before the RTI learns of the end of this one.
                let closed = RtiInput::Closed { link: self.link(me) };
                self.links.replace((rti, rti), Event::Rti(closed));
                let lost = Event::Federate(self.instance(me), Input::RtiLost);
                self.links.replace((rti, place), lost);
                Ok(())
            }
            Happening::Event(me) => {
                let tag = self.seats[me].change(|seat| seat.node.happen(now))?;
                self.carry_out(me);
                self.event = tag.map(|tag| (me, tag));
                Ok(())
            }
        }
    }

    /// A process is launched that joins as a federate.
    fn arrive(&mut self, me: FederateId) {
        let former = self.seats[me].get().node.clone();
        let was = former.me;
        let is_new = former.last_tag() == Tag::NEVER && was.life == 0;
        let life = if is_new { 0 } else { was.life + 1 };
        self.past.change(|past| past.extend(former.clone().life()));
        let instance = Instance { federate: me, life };
        let node =
            Node::new(instance, former.program(), (self.federation, &self.fingerprint), &self.plan);
        self.seats[me] = Shared::new(Seat { node, granted: Step::NEVER });
        self.begin(me);
    }

    /// The direct link between two federates breaks: frames in transit are lost, and both ends learn of
    /// it.
    fn break_link(&mut self, one: Instance, other: Instance) {
        for (from, to) in [(one, other), (other, one)] {
            let places = (Place::Federate(from), Place::Federate(to));
            for event in self.links.cut(places) {
                if let Event::Peer {
                    link_event: LinkEvent::Frame(Frame::Message { tag, .. }),
                    ..
                } = event
                {
                    self.lost_from = self.lost_from.min(tag);
                }
            }
            let lost = Event::Peer { from, to, link_event: LinkEvent::Lost };
            self.links.replace(places, lost);
            self.broken.insert(places);
        }
    }

    fn input(&mut self, to: Instance, input: Input) -> Result<(), Fault> {
        let me = to.federate;
        let node = &self.seats[me].get().node;
        if node.me != to || node.is_over() {
            return Ok(());
        }
        self.go(me, Move::Handle(input)).map(|_| ())
    }

    fn rti_input(&mut self, input: RtiInput) -> Result<(), Fault> {
        let moved = self.moves.of_rti(&self.rti, self.now, input);
        self.rti = moved.machine.clone();
        moved.result.clone()?;
        for output in &moved.outputs {
            match *output {
                RtiOutput::Send { link, ref frame } => {
                    let to = Instance::of_link(link);
                    let event = Event::Federate(to, Input::FromRti(frame.clone()));
                    if self.seats[to.federate].get().node.link() == link {
                        self.send(Place::Rti, Place::Federate(to), event);
                    }
                }
                RtiOutput::Left { federate } if self.seats[federate].get().node.crashed => {
                    self.launch(federate);
                }
                RtiOutput::Close { link } => self.close_link(link),
                RtiOutput::Failed { federate, .. } => self.failed = Some(federate),
                RtiOutput::Finished => self.finished = true,
                _ => {}
            }
        }
        Ok(())
    }

    /// The RTI closes the link of a federate, and reads no more of it.
    fn close_link(&mut self, link: LinkId) {
        let federate = Instance::of_link(link);
        let (rti, place) = (Place::Rti, Place::Federate(federate));
        let closed = Event::Rti(RtiInput::Closed { link });
        if self.seats[federate.federate].get().node.link() != link {
            // The federate has given it up.
            self.links.replace((rti, rti), closed);
            return;
        }
        self.send(rti, place, Event::Federate(federate, Input::RtiLost));
        self.broken.extend([(rti, place), (place, rti)]);
        self.links.replace((place, rti), closed);
    }

    /// Carries out the outputs of a federate. If the machine is over, its process ends.
    fn carry_out(&mut self, me: FederateId) {
        let outputs = match self.seats[me].get().node.outputs.is_empty() {
            true => Vec::new(),
            false => self.seats[me].change(|seat| std::mem::take(&mut seat.node.outputs).into()),
        };
        self.carry_out_all(me, &outputs);
    }

    fn carry_out_all(&mut self, me: FederateId, outputs: &[Output]) {
        for output in outputs {
            self.carry_out_one(me, output.clone());
        }
        if self.seats[me].get().node.is_over() {
            self.leave(me);
        }
    }

    fn carry_out_one(&mut self, me: FederateId, output: Output) {
        let (instance, place) = (self.instance(me), self.place(me));
        match output {
            Output::ToRti(frame) => {
                let input = RtiInput::Frame { link: self.link(me), frame };
                self.send(place, Place::Rti, Event::Rti(input));
            }
            Output::Board { owner, notifier: false } => {
                let (from, owner) = (Place::Board(owner), self.instance(owner));
                // Nothing is read any more of a predecessor's board.
                self.links.cut((from, place));
                if let Some(posting) = self.posted.get(&owner).cloned() {
                    let input = Input::Board { from: owner.federate, posting };
                    self.send(from, place, Event::Federate(instance, input));
                }
            }
            Output::Post(posting) => {
                if self.rti.get().takes_transients() {
                    self.posted.insert(instance, posting.clone());
                }
                let machines = self.plan.machines.as_ref();
                let is_near = |other| machines.is_none_or(|it| it.share_boards(me, other));
                let others = self.seats.ids().filter(|other| *other != me && is_near(*other));
                for other in others.collect::<Vec<_>>() {
                    let to = self.instance(other);
                    let input = Input::Board { from: me, posting: posting.clone() };
                    let event = Event::Federate(to, input);
                    self.send(Place::Board(me), Place::Federate(to), event);
                }
            }
            Output::Rejoin => {
                let (rti, node) = (Place::Rti, place);
                self.broken.retain(|ends| ![(rti, node), (node, rti)].contains(ends));
                self.links.cut((rti, node));
                self.seats[me].change(|seat| seat.node.reconnect());
                self.send(node, node, Event::Federate(instance, Input::Rejoins));
            }
            Output::ToPeer { to, frame } => {
                let Some(to) = self.seats[me].get().node.direct_links.to(to) else { return };
                if let Frame::Message { tag, .. } = &frame
                    && self.broken.contains(&(place, Place::Federate(to)))
                {
                    self.lost_from = self.lost_from.min(*tag);
                }
                self.send_link_event(instance, to, LinkEvent::Frame(frame));
            }
            Output::Connect { peer, listen } => {
                let to = Instance::at(&listen);
                let node = &self.seats[peer].get().node;
                if node.me != to || node.is_over() {
                    let reason = "refused".to_owned();
                    let input = Input::Unreachable { peer, reason };
                    self.send(place, place, Event::Federate(instance, input));
                    return;
                }
                if let Some(former) = self.seats[me].change(|seat| seat.node.direct_links.open(to))
                {
                    self.send_link_event(instance, former, LinkEvent::Lost);
                }
                let event = Event::Connect { from: instance, to };
                self.send(place, Place::Federate(to), event);
            }
            Output::Disconnect(peer) => {
                let closed = self.seats[me].get().node.direct_links.all().into_iter();
                for former in closed.filter(|former| former.federate == peer) {
                    self.seats[me].change(|seat| seat.node.direct_links.forget(former));
                    self.send_link_event(instance, former, LinkEvent::Lost);
                }
            }
            _ => {}
        }
    }

    /// A federate's process has ended: its links end after what it has sent.
    fn leave(&mut self, me: FederateId) {
        let (instance, place) = (self.instance(me), self.place(me));
        // A process that has opened a link that was not accepted yet learns that there will be none.
        let waiting = self.links.all().filter(|((_, to), _)| *to == place);
        let opened = waiting.flat_map(|(_, events)| events).filter_map(|event| match event {
            Event::Connect { from, .. } => Some(*from),
            _ => None,
        });
        let peers =
            opened.chain(self.seats[me].get().node.direct_links.all()).collect::<BTreeSet<_>>();
        self.links.cut_all_to(place);
        let closed = RtiInput::Closed { link: self.link(me) };
        self.send(place, Place::Rti, Event::Rti(closed));
        for peer in peers {
            self.send_link_event(instance, peer, LinkEvent::Lost);
        }
    }

    fn send(&mut self, from: Place, to: Place, event: Event) {
        let gone = match to {
            Place::Federate(to) => {
                let node = &self.seats[to.federate].get().node;
                node.me != to || node.is_over()
            }
            Place::Rti | Place::Board(_) => false,
        };
        if !self.broken.contains(&(from, to)) && !gone {
            self.links.push((from, to), event);
        }
    }
}

/// Which federates share memory, if not all of them do. Links are as quick as others here.
fn machines(program: &Program, setting: &Setting) -> Option<Machines> {
    let machine = |me| setting.elsewhere.iter().position(|it| *it == me).map_or(0, |at| at + 1);
    let machines = program.federates.ids().map(machine).collect();
    (!setting.elsewhere.is_empty()).then(|| Machines::in_a_good_network(machines, 0))
}
