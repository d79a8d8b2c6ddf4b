//! Links with random latencies that keep the order of what is sent, and may break.

use std::collections::{BTreeMap, BTreeSet};

use hprm_core::{FederateId, Nanos, PhysicalTime};
use hprm_federated::{Input, LinkId, RtiInput};

use crate::Rng;

/// One end of a link.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub enum Place {
    /// The RTI.
    Rti,
    /// A federate.
    Federate(FederateId),
}

/// What happens at some time.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(crate) enum Event {
    /// The RTI gets an input.
    Rti(RtiInput),
    /// A federate gets an input.
    Federate(FederateId, Input),
    /// A federate opens a direct link to another.
    Dial { from: FederateId, to: FederateId },
    /// A federate looks up.
    Wake(FederateId),
    /// A federate's process is killed.
    Crash(FederateId),
    /// It is launched again.
    Restart(FederateId),
    /// The link between a federate and the RTI breaks.
    Cut(FederateId),
    /// A federate's physical action is scheduled.
    Happen(FederateId),
}

/// How long things take on their way.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Default)]
pub struct Latency {
    /// The least.
    pub least: u64,
    /// How much more it may be.
    pub jitter: u64,
    /// In how many cases of a hundred it is fifty times as much: something was sent again.
    pub spikes: u64,
}

/// Somebody is cut off for a while. What is sent then arrives later: links are reliable.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub struct Partition {
    /// Who.
    pub who: FederateId,
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
    partition: Option<Partition>,
    /// When the last thing sent on a link arrives.
    busy: BTreeMap<(Place, Place), PhysicalTime>,
    /// The federates whose links to the RTI have broken.
    broken: BTreeSet<FederateId>,
}

impl Network {
    pub(crate) fn new(rng: Rng, latency: Latency, partition: Option<Partition>) -> Self {
        Self {
            rng,
            pending: BTreeMap::new(),
            sequence: 0,
            latency,
            partition,
            busy: BTreeMap::new(),
            broken: BTreeSet::new(),
        }
    }

    pub(crate) fn at(&mut self, time: PhysicalTime, event: Event) {
        self.pending.insert((time, self.sequence), event);
        self.sequence += 1;
    }

    /// Sends something that arrives after everything sent before on the same link, if that has not
    /// broken.
    pub(crate) fn send(&mut self, now: PhysicalTime, from: Place, to: Place, event: Event) {
        if self.is_broken(from, to) {
            return;
        }
        let arrival = now.plus(self.delay());
        let arrival = match self.partition {
            Some(Partition { who, from: cut, until })
                if [from, to].contains(&Place::Federate(who))
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

    /// Breaks the link between a federate and the RTI: what is on its way is lost, and both ends
    /// learn of it.
    pub(crate) fn cut(&mut self, now: PhysicalTime, who: FederateId, link: LinkId) {
        self.broken.insert(who);
        self.pending.retain(
            |_, event| !matches!(event, Event::Rti(RtiInput::Frame { link: on, .. }) if *on == link),
        );
        self.lose_frames(who);
        let (early, late) = (now.plus(self.delay()), now.plus(self.delay()));
        self.at(early, Event::Rti(RtiInput::Closed { link }));
        self.at(late, Event::Federate(who, Input::RtiLost));
    }

    /// The federate has another link to the RTI: what was on its way on the one before is lost.
    pub(crate) fn mend(&mut self, who: FederateId) {
        self.broken.remove(&who);
        self.lose_frames(who);
    }

    fn lose_frames(&mut self, who: FederateId) {
        let is_lost =
            |event: &Event| matches!(event, Event::Federate(to, Input::FromRti(_)) if *to == who);
        self.pending.retain(|_, event| !is_lost(event));
    }

    fn is_broken(&self, from: Place, to: Place) -> bool {
        match (from, to) {
            (Place::Federate(who), Place::Rti) | (Place::Rti, Place::Federate(who)) => {
                self.broken.contains(&who)
            }
            _ => false,
        }
    }

    fn delay(&mut self) -> Nanos {
        let Latency { least, jitter, spikes } = self.latency;
        let usual = least + self.rng.below(jitter);
        let factor = if self.rng.percent(spikes) { 50 } else { 1 };
        usual.saturating_mul(factor).cast_signed()
    }

    pub(crate) fn next(&mut self) -> Option<(PhysicalTime, Event)> {
        self.pending.pop_first().map(|((time, _), event)| (time, event))
    }
}
