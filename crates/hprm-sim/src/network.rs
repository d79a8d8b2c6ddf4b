//! Links with random latencies that keep the order of what is sent, and nothing else.

use std::collections::BTreeMap;

use hprm_core::{FederateId, PhysicalTime};
use hprm_federated::{Input, RtiInput};

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
}

/// What will happen, by time, and by the order in which it was caused.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(crate) struct Network {
    rng: Rng,
    pending: BTreeMap<(PhysicalTime, u64), Event>,
    sequence: u64,
    latency: u64,
    /// When the last thing sent on a link arrives.
    busy: BTreeMap<(Place, Place), PhysicalTime>,
}

impl Network {
    pub(crate) fn new(rng: Rng, latency: u64) -> Self {
        Self { rng, pending: BTreeMap::new(), sequence: 0, latency, busy: BTreeMap::new() }
    }

    pub(crate) fn at(&mut self, time: PhysicalTime, event: Event) {
        self.pending.insert((time, self.sequence), event);
        self.sequence += 1;
    }

    /// Sends something that arrives after everything sent before on the same link.
    pub(crate) fn send(&mut self, now: PhysicalTime, from: Place, to: Place, event: Event) {
        let arrival = now.plus(self.rng.below(self.latency).cast_signed());
        let busy = self.busy.entry((from, to)).or_insert(arrival);
        *busy = (*busy).max(arrival);
        let arrival = *busy;
        self.at(arrival, event);
    }

    pub(crate) fn next(&mut self) -> Option<(PhysicalTime, Event)> {
        self.pending.pop_first().map(|((time, _), event)| (time, event))
    }
}
