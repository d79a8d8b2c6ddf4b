//! What is drawn apart from the rest of a trial, so that the other draws of a seed stay the same: other
//! waits, federates that leave, and bounds.

use std::sync::Arc;

use hprm_core::{
    Bound, Coordination, FederateId, Nanos, Overflow, PhysicalTime, Program, Tag, unsafe_blocking,
};

use crate::rng::mix;
use crate::{Rng, Visit};

/// Separates the draws for waits from all others of a seed.
const WAITS: u64 = 0x3a17;

/// The same for federates that leave.
const LEAVES: u64 = 0x1ea7e;

/// The same for federates that leave at a moment that no tag tells.
const DEPARTURES: u64 = 0xdeba;

/// The same for bounds.
const BOUNDS: u64 = 0xb0d5;

/// How long a federate waits before a tag.
const MAXWAITS: [Nanos; 6] = [0, 0, 500, 2_000, 20_000, Nanos::MAX];

/// How much longer for an input.
const ABSENT_AFTER: [Nanos; 6] = [0, 0, 300, 1_500, 10_000, Nanos::MAX];

/// Which federate waits for how long from which tag on.
pub type Maxwait = (FederateId, Tag, Nanos);

/// Gives half of the decentralized programs other waits: federates that wait for their inputs in
/// different ways, and change that while they run.
pub(crate) fn waits(seed: u64, program: &mut Arc<Program>) -> Vec<Maxwait> {
    let mut rng = Rng::new(mix(seed ^ WAITS));
    let decentralized = program.properties.coordination == Coordination::Decentralized;
    if !decentralized || !rng.percent(50) {
        return Vec::new();
    }
    let uneven = rng.percent(80);
    let program = Arc::make_mut(program);
    for federate in program.federates.ids() {
        program.federates[federate].maxwait = pick(&mut rng, &MAXWAITS);
    }
    for connection in program.connections.ids().filter(|_| uneven) {
        program.connections[connection].absent_after = pick(&mut rng, &ABSENT_AFTER);
    }
    let changing = program.federates.ids().filter(|_| rng.percent(20));
    let changing: Vec<_> = changing.collect();
    let change = |federate| {
        // Only the program itself can state a wait without an end.
        let wait = pick(&mut rng, &MAXWAITS[..5]);
        (federate, Tag::new(rng.below(10_000).cast_signed(), 0), wait)
    };
    changing.into_iter().map(change).collect()
}

/// Gives most physical connections a bound. A sender waits only where it may.
pub(crate) fn bounds(seed: u64, program: &mut Arc<Program>) {
    let mut rng = Rng::new(mix(seed ^ BOUNDS));
    let program = Arc::make_mut(program);
    for id in program.connections.ids() {
        if !program.connections[id].physical || !rng.percent(70) {
            continue;
        }
        let messages = 1 + u32::try_from(rng.below(3)).unwrap_or(0);
        let overflow = pick(&mut rng, &[Overflow::Drop, Overflow::Replace, Overflow::Block]);
        program.connections[id].bound = Some(Bound { messages, overflow });
        if unsafe_blocking(program).is_some() {
            program.connections[id].bound = Some(Bound { messages, overflow: Overflow::Replace });
        }
    }
}

/// Federates that leave, each at its first reaction at that tag or a later one.
pub(crate) fn leaves(seed: u64, program: &Program) -> Vec<(FederateId, Tag)> {
    let mut rng = Rng::new(mix(seed ^ LEAVES));
    if !rng.percent(30) {
        return Vec::new();
    }
    let leaving: Vec<_> = program.federates.ids().filter(|_| rng.percent(30)).collect();
    let leave = |federate| (federate, Tag::new(rng.below(12_000).cast_signed(), 0));
    leaving.into_iter().map(leave).collect()
}

fn pick<T: Copy>(rng: &mut Rng, among: &[T]) -> T {
    among[usize::try_from(rng.below(among.len() as u64)).unwrap_or(0)]
}

/// Federates that are asked to leave from outside, as by another thread of their processes, and when. Transient ones leave
/// anyway.
pub(crate) fn departures(seed: u64, program: &Program) -> Vec<(FederateId, PhysicalTime, Visit)> {
    let mut rng = Rng::new(mix(seed ^ DEPARTURES));
    if program.federates.values().any(|federate| federate.transient) || !rng.percent(12) {
        return Vec::new();
    }
    let leaving: Vec<_> = program.federates.ids().filter(|_| rng.percent(40)).collect();
    let at = |federate| (federate, PhysicalTime(rng.below(20_000).cast_signed()), Visit::Leave);
    leaving.into_iter().map(at).collect()
}
