//! The agents of all machines, and the network between them, in virtual time.
//!
//! They know nothing of federations: an event that one process sends comes out at another one, later and in order, or
//! both learn that their link has ended. That a link is opened takes no packets of its own here: the end that it leads
//! to begins with the first packet.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use hprm_core::{FederateId, Nanos};
use hprm_federated::relay::{End, Input, Relay};
use hprm_federated::{Frame, LinkId};

use super::link::{Effect, Link, Site};
use super::{Kind, Machines, Trouble};
use crate::Rng;
use crate::network::{Event, Place};
use crate::relayed::line::Carried;

/// Agents that exchange so many packets do so for ever.
const STEPS: usize = 2_000_000;

/// An end of a link: which link, and which of its ends.
type Target = (usize, usize);

/// An agent.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Default)]
struct Agent {
    is_paused: bool,
    is_killed: bool,
    is_cut_off: bool,
    /// What has come while it was paused.
    backlog: VecDeque<(Target, Vec<u8>)>,
}

/// What has come of the links between machines.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct Traffic {
    /// How many there were.
    pub links: usize,
    /// The frames that processes have sent.
    pub frames: u64,
    /// The bytes of packets that were sent.
    pub bytes: u64,
    /// The packets that were sent, and those that were lost.
    pub packets: u64,
    /// See above.
    pub lost: u64,
    /// The federates of which a link has ended although no process has ended it.
    pub severed: BTreeSet<FederateId>,
}

/// What the federation learns.
#[derive(Debug)]
pub(crate) enum Notice {
    /// Something arrives at a process.
    Arrives(Event),
    /// Something happens to agents or links, for the log.
    Told(String),
}

/// See the module.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(crate) struct Agents {
    machines: Machines,
    rng: Rng,
    now: Nanos,
    agents: Vec<Agent>,
    links: Vec<Link>,
    /// The link that is in use between two processes.
    current: BTreeMap<(Place, Place), usize>,
    carried: Carried<Target>,
    /// The bytes of packets that were sent.
    bytes: u64,
    /// What begins and what ends, in the order of times.
    changes: VecDeque<(Nanos, bool, Trouble)>,
    lost: Vec<Frame>,
    /// The federates of which a link has ended although no process has ended it.
    severed: BTreeSet<FederateId>,
    /// What is wrong with a link, if anything.
    wrong: Option<String>,
    steps: usize,
}

impl Agents {
    pub(crate) fn new(machines: &Machines, rng: Rng) -> Self {
        let changes = machines
            .troubles
            .iter()
            .flat_map(|trouble| [(trouble.from, true, *trouble), (trouble.until, false, *trouble)]);
        Self {
            machines: machines.clone(),
            rng,
            now: 0,
            agents: vec![Agent::default(); machines.count()],
            links: Vec::new(),
            current: BTreeMap::new(),
            carried: Carried::new(),
            bytes: 0,
            changes: changes.collect(),
            lost: Vec::new(),
            severed: BTreeSet::new(),
            wrong: None,
            steps: 0,
        }
    }

    /// Whether two processes are on different machines.
    pub(crate) fn are_apart(&self, one: Place, other: Place) -> bool {
        self.machine(one) != self.machine(other)
    }

    fn machine(&self, place: Place) -> usize {
        match place {
            Place::Rti => self.machines.rti(),
            Place::Federate(instance) => self.machines.of(instance.federate),
            Place::Board(federate) => self.machines.of(federate),
        }
    }

    /// The messages that ended links have lost.
    pub(crate) fn take_lost(&mut self) -> Vec<Frame> {
        std::mem::take(&mut self.lost)
    }

    /// What has come of all links.
    pub(crate) fn traffic(&self) -> Traffic {
        let Carried { sent, lost, .. } = self.carried;
        Traffic {
            links: self.links.len(),
            frames: self.links.iter().map(Link::frames).sum(),
            bytes: self.bytes,
            packets: sent,
            lost,
            severed: self.severed.clone(),
        }
    }

    /// What is wrong with a link, if anything.
    pub(crate) fn wrong(&self) -> Option<&str> {
        self.wrong.as_deref()
    }

    /// Whether nothing is on its way between processes, and none is to learn of an end.
    pub(crate) fn is_idle(&self) -> bool {
        self.links.iter().all(Link::is_idle)
    }

    /// A process sends something to one on another machine.
    pub(crate) fn send(&mut self, now: Nanos, from: Place, to: Place, event: Event) -> Vec<Notice> {
        self.now = now;
        let mut notices = Vec::new();
        let at = self.link_for(from, to, &event, &mut notices);
        let end = self.links[at].end_at(from);
        self.lost.extend(self.links[at].send(end, event));
        self.proceed((at, end), &mut notices);
        notices
    }

    /// The link on which a process sends something to another one; a new one if there is none, or if the process opens
    /// one after the last one has ended.
    fn link_for(
        &mut self,
        from: Place,
        to: Place,
        event: &Event,
        notices: &mut Vec<Notice>,
    ) -> usize {
        let ends = (from.min(to), from.max(to));
        let known = self.current.get(&ends).copied();
        let opens = matches!(event, Event::Connect { .. });
        if let Some(known) = known {
            let link = &mut self.links[known];
            let end = link.end_at(from);
            if !opens || !link.sites[end].has_ended {
                return known;
            }
            // The other process opens the new link only once it knows that the old one has ended.
            notices.extend(link.end(1 - end).map(Notice::Arrives));
            self.lost.extend(link.take_lost());
        }
        let (here, there) = (self.machine(from), self.machine(to));
        self.links.push(Link::new((from, here), (to, there)));
        self.current.insert(ends, self.links.len() - 1);
        self.links.len() - 1
    }

    /// A process opens another link to the RTI when it sends the next time, and does not read this one any more.
    pub(crate) fn relink(&mut self, from: Place) {
        let ends = (from.min(Place::Rti), from.max(Place::Rti));
        if let Some(at) = self.current.remove(&ends) {
            let end = self.links[at].end_at(from);
            self.links[at].deafen(end);
        }
    }

    /// The RTI does not read a link any more.
    pub(crate) fn read_no_more(&mut self, number: LinkId) {
        self.lost.extend(self.links.iter_mut().flat_map(|link| link.read_no_more(number)));
    }

    /// When something happens here.
    pub(crate) fn next(&self) -> Option<Nanos> {
        let wakeups = self.links.iter().flat_map(|link| {
            let runs = |end: &usize| self.runs(&link.sites[*end]);
            [0, 1].into_iter().filter(runs).filter_map(|end| link.wakeup(end))
        });
        let change = self.changes.front().map(|(time, _, _)| *time);
        wakeups.chain(change).chain(self.carried.next()).min().map(|at| at.max(self.now))
    }

    fn runs(&self, site: &Site) -> bool {
        let agent = &self.agents[site.machine];
        !agent.is_paused && !agent.is_killed
    }

    /// Does what happens at that time, which is the next one.
    pub(crate) fn step(&mut self, now: Nanos) -> Vec<Notice> {
        self.now = now;
        self.steps += 1;
        assert!(self.steps < STEPS, "the agents exchange packets for ever");
        let mut notices = Vec::new();
        while let Some((time, begins, trouble)) = self.changes.front().copied()
            && time <= now
        {
            self.changes.pop_front();
            let what = if begins { "begins" } else { "ends" };
            notices.push(Notice::Told(format!("{trouble}: {what}")));
            self.change(begins, trouble, &mut notices);
        }
        while let Some((to, packet)) = self.carried.arrived(now) {
            self.arrive(to, packet, &mut notices);
        }
        for at in 0..self.links.len() {
            for end in [0, 1] {
                let is_due = self.links[at].wakeup(end).is_some_and(|due| due <= now);
                if is_due && self.runs(&self.links[at].sites[end]) {
                    self.links[at].handle(end, now, Input::Wake);
                    self.proceed((at, end), &mut notices);
                }
            }
        }
        notices
    }

    fn change(&mut self, begins: bool, trouble: Trouble, notices: &mut Vec<Notice>) {
        let machine = trouble.machine;
        match trouble.kind {
            Kind::Cut { told } => {
                self.agents[machine].is_cut_off = begins;
                let links = &self.links;
                let crosses =
                    |(at, _): Target| links[at].sites.iter().any(|site| site.machine == machine);
                self.carried.cut(crosses);
                if told {
                    let input = if begins { Input::CarrierDown } else { Input::CarrierUp };
                    self.tell_links_of(machine, &input, notices);
                }
            }
            Kind::Pause => {
                self.agents[machine].is_paused = begins;
                if !begins {
                    self.wake_up(machine, notices);
                }
            }
            Kind::Restart => {
                self.agents[machine].is_killed = begins;
                if begins {
                    self.kill(machine, notices);
                } else {
                    self.wake_up(machine, notices);
                }
            }
        }
    }

    /// Both ends of the links to a machine learn that the carrier works or does not.
    fn tell_links_of(&mut self, machine: usize, input: &Input, notices: &mut Vec<Notice>) {
        for at in 0..self.links.len() {
            if self.links[at].sites.iter().all(|site| site.machine != machine) {
                continue;
            }
            for end in [0, 1] {
                self.links[at].handle(end, self.now, input.clone());
                self.proceed((at, end), notices);
            }
        }
    }

    /// An agent runs again: takes what has come meanwhile, and what its processes have sent.
    fn wake_up(&mut self, machine: usize, notices: &mut Vec<Notice>) {
        for (to, packet) in std::mem::take(&mut self.agents[machine].backlog) {
            self.arrive(to, packet, notices);
        }
        for target in self.ends_at(machine) {
            self.proceed(target, notices);
        }
    }

    /// An agent is killed: its processes notice at once.
    fn kill(&mut self, machine: usize, notices: &mut Vec<Notice>) {
        for (at, end) in self.ends_at(machine) {
            let link = &mut self.links[at];
            if link.sites[end].relay.take().is_some() {
                notices.extend(link.end(end).map(Notice::Arrives));
                self.lost.extend(link.take_lost());
                self.sever(at);
            }
        }
    }

    fn ends_at(&self, machine: usize) -> Vec<Target> {
        let is_there = |(at, end): &Target| self.links[*at].sites[*end].machine == machine;
        (0..self.links.len()).flat_map(|at| [(at, 0), (at, 1)]).filter(is_there).collect()
    }

    fn arrive(&mut self, (at, end): Target, packet: Vec<u8>, notices: &mut Vec<Notice>) {
        let backlog = self.machines.line.backlog;
        let site = &self.links[at].sites[end];
        let has_ended = site.has_ended && site.relay.is_none();
        let agent = &mut self.agents[site.machine];
        if agent.is_killed {
            return;
        }
        if agent.is_paused {
            if agent.backlog.len() < backlog {
                agent.backlog.push_back(((at, end), packet));
            }
            return;
        }
        if has_ended {
            if let Some(refusal) = Relay::refusal(&packet) {
                self.carry((at, 1 - end), refusal);
            }
            return;
        }
        self.links[at].begin(end, self.now, &mut self.rng);
        self.links[at].handle(end, self.now, Input::Packet(packet.into()));
        self.proceed((at, end), notices);
    }

    /// The agent at an end does what is to be done.
    fn proceed(&mut self, (at, end): Target, notices: &mut Vec<Notice>) {
        if !self.runs(&self.links[at].sites[end]) {
            return;
        }
        let Self { rng, machines, now, .. } = self;
        let link = &mut self.links[at];
        if link.has_unsent(end) {
            link.begin(end, *now, rng);
        }
        let mut random = |longest| usize::try_from(rng.below(longest)).unwrap_or(0);
        let effects = link.proceed(end, *now, || machines.longest.map(&mut random));
        self.lost.extend(link.take_lost());
        for effect in effects {
            match effect {
                Effect::Packet(packet) => self.carry((at, 1 - end), packet),
                Effect::Event(event) => notices.push(Notice::Arrives(event)),
                Effect::Ended(reason) => self.ended((at, end), &reason, notices),
            }
        }
    }

    fn carry(&mut self, to: Target, packet: Vec<u8>) {
        let mut machines = self.links[to.0].sites.iter().map(|site| site.machine);
        if machines.any(|machine| self.agents[machine].is_cut_off) {
            return;
        }
        self.bytes += packet.len() as u64;
        self.carried.send(&self.machines.line, &mut self.rng, self.now, to, packet);
    }

    /// An end of a link gives up, which it may only after something that links do not outlast.
    fn ended(&mut self, (at, end): Target, reason: &End, notices: &mut Vec<Notice>) {
        let [one, other] = [end, 1 - end].map(|end| self.links[at].sites[end].place);
        let text = format!("the link from {one:?} to {other:?} has ended at {one:?}: {reason}");
        let fits =
            self.machines.fatal().is_some_and(|(from, until)| (from..until).contains(&self.now));
        let fits =
            fits && matches!(reason, End::Silent(_) | End::Unheard | End::Unknown | End::Restarted);
        if !fits {
            self.wrong.get_or_insert(text.clone());
        }
        notices.push(Notice::Told(text));
        self.sever(at);
    }

    fn sever(&mut self, at: usize) {
        let federates = self.links[at].sites.iter().filter_map(|site| match site.place {
            Place::Federate(instance) => Some(instance.federate),
            Place::Rti | Place::Board(_) => None,
        });
        self.severed.extend(federates);
    }
}
