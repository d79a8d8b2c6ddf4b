//! A federation between two things that happen: the machines, and what is on its way between them.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;

use hprm_core::{FederateId, Nanos, PhysicalTime, Program, Table, Tag};
use hprm_federated::{
    Fault, FederationId, Frame, Input, LinkId, Output, Quieting, Rti, RtiInput, RtiOutput, Step,
    Topology,
};

use super::digest::{Shared, digest};
use crate::Plan;
use crate::network::{Event, Place};
use crate::node::{Node, Turn};
use crate::world::linked;

/// When the processes are launched: late enough for a start in the past.
const LAUNCH: PhysicalTime = PhysicalTime(1_000_000_000);

/// Something that may happen once, at any moment.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub enum Happening {
    /// A federate asks to stop.
    Stop(FederateId),
    /// A federate leaves, and all is well.
    Leave(FederateId),
    /// A federate's process dies.
    Crash(FederateId),
    /// The link between a federate and the RTI breaks; what was on its way is lost.
    Disconnect(FederateId),
    /// A federate's physical action is scheduled.
    Event(FederateId),
}

/// What happens next.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub enum Action {
    /// The oldest of what is on its way from the one to the other arrives.
    Deliver(Place, Place),
    /// A federate does what it may: it reports, or processes a tag.
    Advance(FederateId),
    /// It is that time now.
    Time(PhysicalTime),
    /// Something from outside.
    Happens(Happening),
}

/// A federate, and what an observer has noted of it.
#[derive(Clone, PartialEq, Eq, Hash)]
pub(super) struct Seat {
    pub(super) node: Node,
    /// How far it has been told to advance.
    pub(super) granted: Step,
}

/// See the module.
#[derive(Clone)]
pub(super) struct State {
    pub(super) now: PhysicalTime,
    rti: Shared<Rti>,
    pub(super) seats: Table<FederateId, Shared<Seat>>,
    /// What is on its way, oldest first; empty links are not there.
    pub(super) links: BTreeMap<(Place, Place), VecDeque<Event>>,
    /// What may still happen.
    pub(super) happenings: BTreeSet<Happening>,
    pub(super) failed: Option<FederateId>,
    pub(super) finished: bool,
    /// Links to the RTI that have broken.
    broken: BTreeSet<FederateId>,
    /// Federates that have left.
    pub(super) left: BTreeSet<FederateId>,
    /// The physical action that has been scheduled.
    pub(super) event: Option<(FederateId, Tag)>,
}

impl State {
    /// A federation whose processes have just been launched. Tag zero will be `start_delay` after
    /// the last federate has become ready.
    pub(super) fn new(
        program: &Arc<Program>,
        happenings: &[Happening],
        start_delay: Nanos,
        flow_limit: Option<u64>,
        quieting: Quieting,
    ) -> Self {
        let federation = FederationId(1);
        let topology = Topology::new(program);
        let fingerprint = Arc::new(program.fingerprint());
        let rti = Rti::new(topology, federation, Arc::clone(&fingerprint), start_delay);
        let rti = rti.quieting(quieting);
        let plan = Plan { flow_limit, ..Plan::default() };
        let seat = |me| {
            let node = Node::new(me, program, (federation, &fingerprint), &plan);
            Shared::new(Seat { node, granted: Step::NEVER })
        };
        let mut state = Self {
            now: LAUNCH,
            rti: Shared::new(rti),
            seats: program.federates.ids().map(seat).collect(),
            links: BTreeMap::new(),
            happenings: happenings.iter().copied().collect(),
            failed: None,
            finished: false,
            broken: BTreeSet::new(),
            left: BTreeSet::new(),
            event: None,
        };
        program.federates.ids().for_each(|me| state.begin(me));
        state
    }

    /// A federate's process has been launched.
    fn begin(&mut self, me: FederateId) {
        let now = self.now;
        self.seats[me].change(|seat| seat.node.drain(now));
        self.carry_out(me);
        let place = Place::Federate(me);
        self.send(place, place, Event::Federate(me, Input::Loaded));
    }

    /// A federate's process is launched again.
    fn launch(&mut self, me: FederateId) {
        self.seats[me].change(|seat| seat.node = seat.node.again());
        self.broken.remove(&me);
        self.begin(me);
    }

    /// Whether the RTI has not heard yet that a link has ended.
    fn has_ended(&self, link: LinkId, me: FederateId) -> bool {
        let sent = self.links.get(&(Place::Federate(me), Place::Rti));
        sent.into_iter().flatten().any(|event| *event == Event::Rti(RtiInput::Closed { link }))
    }

    /// What tells this state from others.
    pub(super) fn digest(&self) -> u128 {
        let seats: Vec<_> = self.seats.values().map(Shared::digest).collect();
        let parts = (self.now, self.rti.digest(), seats, &self.links, &self.happenings);
        digest(&(parts, self.failed, self.finished, &self.broken, &self.left, self.event))
    }

    /// Whether that action brings a federate the news of the start.
    pub(super) fn is_start(&self, action: Action) -> bool {
        let Action::Deliver(from, to) = action else { return false };
        let next = self.links.get(&(from, to)).and_then(VecDeque::front);
        matches!(next, Some(Event::Federate(_, Input::FromRti(Frame::Start { .. }))))
    }

    /// Whether nobody has got the news of the start, and everybody will next.
    pub(super) fn is_about_to_start(&self) -> bool {
        let start = |me| Action::Deliver(Place::Rti, Place::Federate(me));
        self.seats.ids().all(|me| self.is_start(start(me)))
    }

    /// How many logical messages have come to their receivers.
    pub(super) fn messages(&self) -> usize {
        self.seats.values().map(|seat| seat.get().node.received.values().sum::<usize>()).sum()
    }

    /// What arrives, if anything on its way does.
    pub(super) fn deliveries(&self) -> impl Iterator<Item = Action> {
        self.links.keys().map(|(from, to)| Action::Deliver(*from, *to))
    }

    /// What may happen from outside.
    pub(super) fn events(&self) -> impl Iterator<Item = Action> {
        let possible = self.happenings.iter().filter(|happening| match **happening {
            Happening::Stop(me) | Happening::Leave(me) | Happening::Event(me) => {
                self.seats[me].get().node.is_running()
            }
            Happening::Crash(me) | Happening::Disconnect(me) => {
                !self.seats[me].get().node.is_over() && self.failed.is_none()
            }
        });
        possible.map(|happening| Action::Happens(*happening))
    }

    /// The oldest of what is on its way on a link arrives.
    pub(super) fn deliver(&mut self, from: Place, to: Place) -> Result<(), Fault> {
        let Some(event) = self.pop(from, to) else { return Ok(()) };
        match event {
            Event::Rti(input) => self.rti_input(input),
            Event::Federate(me, input) => self.input(me, input),
            Event::Dial { from, to } => {
                let hello = self.seats[from].get().node.machine.peer_hello();
                if self.seats[to].get().node.is_over() {
                    return Ok(());
                }
                let admitted = self.seats[to].get().node.machine.admit(&hello);
                assert!(admitted.is_ok_and(|(peer, _)| peer == from), "{from:?} has a channel");
                self.input(to, Input::PeerUp(from))?;
                let up = Event::Federate(from, Input::PeerUp(to));
                self.send(Place::Federate(to), Place::Federate(from), up);
                Ok(())
            }
            Event::Wake(_)
            | Event::Crash(_)
            | Event::Restart(_)
            | Event::Cut(_)
            | Event::Happen(_) => Ok(()),
        }
    }

    /// A federate does what it may. Returns until when it waits, if it has not processed a tag.
    pub(super) fn advance(&mut self, me: FederateId) -> Result<Turn, Fault> {
        let now = self.now;
        let turn = self.seats[me].change(|seat| seat.node.advance_once(now))?;
        self.carry_out(me);
        Ok(turn)
    }

    /// Something happens from outside.
    pub(super) fn happen(&mut self, happening: Happening) -> Result<(), Fault> {
        self.happenings.remove(&happening);
        let now = self.now;
        match happening {
            Happening::Stop(me) => self.input(me, Input::RequestStop),
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
                let (rti, place) = (Place::Rti, Place::Federate(me));
                self.broken.insert(me);
                self.links.remove(&(place, rti));
                self.links.remove(&(rti, place));
                let closed = RtiInput::Closed { link: LinkId(u32::from(me.0)) };
                self.links.insert((place, rti), VecDeque::from([Event::Rti(closed)]));
                let lost = Event::Federate(me, Input::RtiLost);
                self.links.insert((rti, place), VecDeque::from([lost]));
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

    fn input(&mut self, me: FederateId, input: Input) -> Result<(), Fault> {
        if self.seats[me].get().node.is_over() {
            return Ok(());
        }
        let now = self.now;
        self.seats[me].change(|seat| {
            match input {
                Input::FromRti(Frame::TagAdvanceGrant { tag }) => seat.grant(Step::end(tag)),
                Input::FromRti(
                    Frame::ProvisionalTagAdvanceGrant { through } | Frame::Safe { through },
                ) => seat.grant(through),
                Input::FromRti(Frame::StopGranted { tag }) => {
                    seat.granted = seat.granted.min(Step::end(tag.pred()));
                }
                _ => {}
            }
            seat.node.input(now, input)
        })?;
        self.carry_out(me);
        Ok(())
    }

    fn rti_input(&mut self, input: RtiInput) -> Result<(), Fault> {
        let now = self.now;
        let mut outputs = Vec::new();
        self.rti.change(|rti| {
            let handled = rti.handle(now, input);
            outputs.extend(std::iter::from_fn(|| rti.poll()));
            handled
        })?;
        for output in outputs {
            match output {
                RtiOutput::Send { link, frame } => {
                    let me = FederateId(u16::try_from(link.0).expect("links have small numbers"));
                    let event = Event::Federate(me, Input::FromRti(frame));
                    if !self.has_ended(link, me) {
                        self.send(Place::Rti, Place::Federate(me), event);
                    }
                }
                RtiOutput::Left { federate } if self.seats[federate].get().node.crashed => {
                    self.launch(federate);
                }
                RtiOutput::Failed { federate, .. } => self.failed = Some(federate),
                RtiOutput::Finished => self.finished = true,
                _ => {}
            }
        }
        Ok(())
    }

    /// Sends what a federate wants sent. If it is over, so is its process.
    fn carry_out(&mut self, me: FederateId) {
        if !self.seats[me].get().node.outputs.is_empty() {
            let outputs = self.seats[me].change(|seat| std::mem::take(&mut seat.node.outputs));
            for output in outputs {
                self.carry_out_one(me, output);
            }
        }
        if self.seats[me].get().node.is_over() {
            self.leave(me);
        }
    }

    fn carry_out_one(&mut self, me: FederateId, output: Output) {
        let from = Place::Federate(me);
        match output {
            Output::ToRti(frame) => {
                let link = LinkId(u32::from(me.0));
                self.send(from, Place::Rti, Event::Rti(RtiInput::Frame { link, frame }));
            }
            Output::Rejoin => {
                self.broken.remove(&me);
                self.send(from, from, Event::Federate(me, Input::Rejoins));
            }
            Output::ToPeer { to, frame } => {
                let event = Event::Federate(to, Input::FromPeer { from: me, frame });
                self.send(from, Place::Federate(to), event);
            }
            Output::Connect { peer, .. } => {
                self.send(from, Place::Federate(peer), Event::Dial { from: me, to: peer });
            }
            _ => {}
        }
    }

    /// A federate's process has ended: its links end after what it has sent.
    fn leave(&mut self, me: FederateId) {
        let from = Place::Federate(me);
        self.links.retain(|(_, to), _| *to != from);
        let closed = RtiInput::Closed { link: LinkId(u32::from(me.0)) };
        self.send(from, Place::Rti, Event::Rti(closed));
        let program = self.seats[me].get().node.program().clone();
        for peer in linked(&program, me) {
            self.send(from, Place::Federate(peer), Event::Federate(peer, Input::PeerLost(me)));
        }
    }

    fn send(&mut self, from: Place, to: Place, event: Event) {
        let lost = match (from, to) {
            (Place::Federate(me), Place::Rti) | (Place::Rti, Place::Federate(me)) => {
                self.broken.contains(&me)
            }
            _ => false,
        };
        let gone = match to {
            Place::Federate(me) => self.seats[me].get().node.is_over(),
            Place::Rti => false,
        };
        if !lost && !gone {
            self.links.entry((from, to)).or_default().push_back(event);
        }
    }

    fn pop(&mut self, from: Place, to: Place) -> Option<Event> {
        let link = self.links.get_mut(&(from, to))?;
        let event = link.pop_front();
        if link.is_empty() {
            self.links.remove(&(from, to));
        }
        event
    }
}

impl Seat {
    fn grant(&mut self, through: Step) {
        self.granted = self.granted.max(through);
    }
}
