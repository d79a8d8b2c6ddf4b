//! Links with random latencies that keep the order of what is sent, and may break.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use hprm_core::{FederateId, Nanos, PhysicalTime};
use hprm_federated::{Frame, Input, LinkId, RtiInput};

use crate::machines::{Agents, Notice};
use crate::{Plan, Rng};

/// A process that is a federate: the first one, or one that joined later.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Instance {
    /// Which federate.
    pub federate: FederateId,
    /// How many processes have been that federate before.
    pub life: u16,
}

/// What stands before the number in an address: all federates can be reached through agents.
const AGENT: &str = "agent:";

impl Instance {
    /// The first process of a federate.
    #[must_use]
    pub const fn first(federate: FederateId) -> Self {
        Self { federate, life: 0 }
    }

    /// Its link to the RTI, after so many others `before`.
    pub(crate) fn link(self, before: u32) -> LinkId {
        let Self { federate, life } = self;
        let fits = federate.0 < 1 << 10 && life < 1 << 8 && before < 1 << 14;
        assert!(fits, "a simulation has at most 1024 federates, with few lives and links each");
        LinkId(before << 18 | u32::from(life) << 10 | u32::from(federate.0))
    }

    /// The process with that link to the RTI.
    pub(crate) fn of_link(link: LinkId) -> Self {
        let part = |number: u32| u16::try_from(number).unwrap_or(0);
        Self { federate: FederateId(part(link.0 & 0x3ff)), life: part(link.0 >> 10 & 0xff) }
    }

    /// The address at which it accepts direct links.
    pub(crate) fn address(self) -> String {
        format!("{AGENT}{}", self.link(0).0)
    }

    /// The process that accepts direct links at an address.
    pub(crate) fn at(address: &str) -> Self {
        let number = address.strip_prefix(AGENT).and_then(|number| number.parse().ok());
        Self::of_link(LinkId(number.expect("an address has the number of a link")))
    }
}

impl fmt::Debug for Instance {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.life {
            0 => write!(f, "{:?}", self.federate),
            life => write!(f, "{:?}, life {life}", self.federate),
        }
    }
}

/// One end of a link.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub enum Place {
    /// The RTI.
    Rti,
    /// A federate.
    Federate(Instance),
    /// What a federate shows on its board, as another one sees it.
    Board(FederateId),
}

impl Place {
    /// Whether that federate is there.
    fn is(self, federate: FederateId) -> bool {
        matches!(self, Self::Federate(instance) if instance.federate == federate)
    }
}

/// What comes on a direct link.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(crate) enum LinkEvent {
    /// The other end has accepted it.
    Up,
    /// A frame.
    Frame(Frame),
    /// It has ended.
    Lost,
}

/// What happens at some time.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(crate) enum Event {
    /// The RTI gets an input.
    Rti(RtiInput),
    /// A federate gets an input.
    Federate(Instance, Input),
    /// A federate opens a direct link to another.
    Connect { from: Instance, to: Instance },
    /// Something comes on a direct link.
    Peer { from: Instance, to: Instance, link_event: LinkEvent },
    /// A wake-up of a federate.
    Wake(Instance),
    /// A federate is woken up by another one, which has posted what it waits for.
    Released(Instance),
    /// A wake-up of the RTI.
    WakeRti,
    /// A process is launched that joins as a transient federate.
    Launch(FederateId),
    /// A transient federate asks to leave.
    Leave(FederateId),
    /// The direct link between two federates breaks.
    Break(FederateId, FederateId),
    /// A federate's process is killed.
    Crash(FederateId),
    /// The process of a federate is launched again.
    Restart(FederateId),
    /// The link between a federate and the RTI breaks.
    Cut(FederateId),
    /// A federate's physical action is scheduled.
    Happen(FederateId),
    /// Something happens to agents or to their links, which the log shows.
    Told(String),
}

/// How long a frame is in transit.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Default)]
pub struct Latency {
    /// The least.
    pub least: u64,
    /// How much more it may be.
    pub jitter: u64,
    /// In how many cases of a hundred it is fifty times as much, as if it were sent again.
    pub spikes: u64,
}

/// A federate is cut off for a while. What is sent then arrives later: links are reliable.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub struct Partition {
    /// The federate.
    pub federate: FederateId,
    /// From when.
    pub from: PhysicalTime,
    /// Until when.
    pub until: PhysicalTime,
}

/// What will happen, by time, and by the order in which it was caused.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(crate) struct Network {
    rng: Rng,
    pending: BTreeMap<(PhysicalTime, u64), Event>,
    sequence: u64,
    latency: Latency,
    /// The same for direct links between federates.
    direct_latency: Latency,
    partition: Option<Partition>,
    /// When the last thing sent on a link arrives.
    busy: BTreeMap<(Place, Place), PhysicalTime>,
    /// Links that have broken, or that one end has closed.
    broken: BTreeSet<(Place, Place)>,
    /// What leads the links between machines, if there are several.
    agents: Option<Agents>,
}

impl Network {
    pub(crate) fn new(rng: Rng, plan: &Plan) -> Self {
        let agents = plan.machines.as_ref().map(|machines| Agents::new(machines, rng.clone()));
        Self {
            rng,
            agents,
            pending: BTreeMap::new(),
            sequence: 0,
            latency: plan.latency,
            direct_latency: plan.direct_latency.unwrap_or(plan.latency),
            partition: plan.partition,
            busy: BTreeMap::new(),
            broken: BTreeSet::new(),
        }
    }

    pub(crate) fn at(&mut self, time: PhysicalTime, event: Event) {
        self.pending.insert((time, self.sequence), event);
        self.sequence += 1;
    }

    /// Sends an event that arrives after everything sent before on the same link, if the link has not
    /// broken.
    pub(crate) fn send(&mut self, now: PhysicalTime, from: Place, to: Place, event: Event) {
        if self.broken.contains(&(from, to)) {
            return;
        }
        if self.are_apart(from, to) {
            let notices = self.agents.as_mut().map(|agents| agents.send(now.0, from, to, event));
            return self.notice(now, notices.unwrap_or_default());
        }
        let is_direct = from != Place::Rti && to != Place::Rti;
        let latency = if is_direct { self.direct_latency } else { self.latency };
        let arrival = now.plus(self.delay(latency));
        let arrival = match self.partition {
            Some(Partition { federate, from: cut, until })
                if [from, to].iter().any(|place| place.is(federate))
                    && arrival >= cut
                    && arrival < until =>
            {
                until
            }
            _ => arrival,
        };
        let busy = self.busy.entry((from, to)).or_insert(arrival);
        *busy = (*busy).max(arrival);
        let arrival = *busy;
        self.at(arrival, event);
    }

    /// What agents tell happens at once.
    fn notice(&mut self, now: PhysicalTime, notices: Vec<Notice>) {
        for notice in notices {
            self.at(
                now,
                match notice {
                    Notice::Arrives(event) => event,
                    Notice::Told(what) => Event::Told(what),
                },
            );
        }
    }

    /// Whether two processes are on different machines.
    pub(crate) fn are_apart(&self, one: Place, other: Place) -> bool {
        self.agents.as_ref().is_some_and(|agents| agents.are_apart(one, other))
    }

    /// What leads the links between machines, if there are several.
    pub(crate) fn agents(&mut self) -> Option<&mut Agents> {
        self.agents.as_mut()
    }

    /// Breaks the link between a federate and the RTI: frames in transit are lost, and both ends learn of it.
    /// Or the RTI has received them, and learns of them and of the end so late that the federate may have opened
    /// another link by then. Returns what is lost.
    pub(crate) fn cut(
        &mut self,
        now: PhysicalTime,
        federate: Instance,
        link: LinkId,
    ) -> Vec<Frame> {
        self.sever(Place::Federate(federate), Place::Rti);
        let mut lost = self.lose_from_rti(federate);
        let (early, late) =
            (now.plus(self.delay(self.latency)), now.plus(self.delay(self.latency)));
        let mut end = early;
        if self.rng.percent(50) {
            end = self.delay_on(link, late).max(early);
        } else {
            lost.extend(self.lose(|event| match event {
                Event::Rti(RtiInput::Frame { link: on, frame }) if *on == link => Some(frame),
                _ => None,
            }));
        }
        self.at(end, Event::Rti(RtiInput::Closed { link }));
        self.at(late, Event::Federate(federate, Input::RtiLost));
        lost
    }

    /// Delays the frames that are in transit to the RTI on a link, in their order, to that time or later. Returns
    /// when the last one arrives.
    fn delay_on(&mut self, link: LinkId, until: PhysicalTime) -> PhysicalTime {
        let is_on = |event: &Event| matches!(event, Event::Rti(RtiInput::Frame { link: on, .. }) if *on == link);
        let on: Vec<_> =
            self.pending.iter().filter(|(_, event)| is_on(event)).map(|(key, _)| *key).collect();
        let mut arrival = until;
        for key in on {
            arrival = arrival.plus(self.delay(self.latency));
            if let Some(event) = self.pending.remove(&key) {
                arrival = arrival.max(key.0);
                self.at(arrival, event);
            }
        }
        arrival
    }

    /// A federate has another link to the RTI: frames in transit to it on the former link are lost, and
    /// so is the event that this link has ended.
    pub(crate) fn relink(&mut self, federate: Instance) {
        let (place, rti) = (Place::Federate(federate), Place::Rti);
        self.broken.retain(|ends| ![(place, rti), (rti, place)].contains(ends));
        self.lose_from_rti(federate);
        let is_end =
            |event: &Event| matches!(event, Event::Federate(to, Input::RtiLost) if *to == federate);
        self.pending.retain(|_, event| !is_end(event));
        if let Some(agents) = &mut self.agents {
            agents.relink(place);
        }
    }

    fn lose_from_rti(&mut self, federate: Instance) -> Vec<Frame> {
        self.lose(|event| match event {
            Event::Federate(to, Input::FromRti(frame)) if *to == federate => Some(frame),
            _ => None,
        })
    }

    /// Takes away frames that are in transit.
    fn lose(&mut self, is_lost: impl Fn(&Event) -> Option<&Frame>) -> Vec<Frame> {
        let mut lost = Vec::new();
        self.pending.retain(|_, event| match is_lost(event) {
            Some(frame) => {
                lost.push(frame.clone());
                false
            }
            None => true,
        });
        lost
    }

    /// Whether a direct link between two federates is being opened.
    pub(crate) fn is_opening(&self, one: Instance, other: Instance) -> bool {
        self.pending.values().any(|event| match event {
            Event::Connect { from, to } | Event::Peer { from, to, link_event: LinkEvent::Up } => {
                [(one, other), (other, one)].contains(&(*from, *to))
            }
            _ => false,
        })
    }

    /// Breaks the direct link between two federates in the same way. Returns what is lost.
    pub(crate) fn cut_direct(
        &mut self,
        now: PhysicalTime,
        one: Instance,
        other: Instance,
    ) -> Vec<Frame> {
        self.sever(Place::Federate(one), Place::Federate(other));
        let mut lost = Vec::new();
        self.pending.retain(|_, event| match event {
            Event::Peer { from, to, link_event }
                if [(one, other), (other, one)].contains(&(*from, *to)) =>
            {
                if let LinkEvent::Frame(frame) = link_event {
                    lost.push(frame.clone());
                }
                false
            }
            Event::Connect { from, to } => ![(one, other), (other, one)].contains(&(*from, *to)),
            _ => true,
        });
        for (from, to) in [(one, other), (other, one)] {
            let at = now.plus(self.delay(self.direct_latency));
            self.at(at, Event::Peer { from, to, link_event: LinkEvent::Lost });
        }
        lost
    }

    /// The RTI has closed a link, and reads no more of it.
    pub(crate) fn read_no_more(&mut self, link: LinkId) {
        let is_from = |event: &Event| {
            matches!(event, Event::Rti(RtiInput::Frame { link: on, .. } | RtiInput::Closed { link: on })
                if *on == link)
        };
        self.pending.retain(|_, event| !is_from(event));
        if let Some(agents) = &mut self.agents {
            agents.read_no_more(link);
        }
    }

    /// Whether the link from one place to the other is broken.
    pub(crate) fn is_severed(&self, from: Place, to: Place) -> bool {
        self.broken.contains(&(from, to))
    }

    /// Breaks the link between two places, both ways.
    pub(crate) fn sever(&mut self, one: Place, other: Place) {
        self.broken.extend([(one, other), (other, one)]);
    }

    fn delay(&mut self, latency: Latency) -> Nanos {
        let Latency { least, jitter, spikes } = latency;
        let usual = least + self.rng.below(jitter);
        let factor = if self.rng.percent(spikes) { 50 } else { 1 };
        usual.saturating_mul(factor).cast_signed()
    }

    pub(crate) fn next(&mut self) -> Option<(PhysicalTime, Event)> {
        loop {
            let next = self.pending.first_key_value().map(|((time, _), _)| *time);
            let Some(at) = self.agents.as_ref().and_then(|agents| next_of(agents, next)) else {
                return self.pending.pop_first().map(|((time, _), event)| (time, event));
            };
            let notices = self.agents.as_mut().map(|agents| agents.step(at.0));
            self.notice(at, notices.unwrap_or_default());
        }
    }
}

/// When agents do something before `other` happens. What they exchange for ever while nothing is on its way counts only
/// as long as something else is to happen.
fn next_of(agents: &Agents, other: Option<PhysicalTime>) -> Option<PhysicalTime> {
    let at = PhysicalTime(agents.next()?);
    match other {
        Some(other) => (at <= other).then_some(at),
        None => (!agents.is_idle()).then_some(at),
    }
}
