//! Transient federates that join and leave, and direct links that break, or that are slower or faster than
//! the links of the RTI: drawn apart from the rest, so that the other draws of a seed stay the same.

use std::collections::BTreeSet;

use hprm_core::{Coordination, FederateId, Nanos, PhysicalTime, Program};

use crate::network::Instance;
use crate::plan::Resets;
use crate::rng::mix;
use crate::{Latency, Plan, Rng, Shape, Visit};

/// Separates the draws of this file from all others of a seed.
const VISITS: u64 = 0x7151;

/// The same for which processes users start.
const BY_HAND: u64 = 0xb4a2d;

/// How long a program lasts that would not end by itself.
const TIMEOUTS: [Nanos; 4] = [2_000, 5_000, 10_000, 20_000];

/// After how long a federate opens a direct link again: soon, or later than a broken link is explained; the
/// federates of a federation that runs do not wait so long.
const SHORT: Nanos = 1_000;
const LONG: Nanos = 3_000_000_000;

/// How long frames may be in transit on the links of one kind, while those of the other kind are quick.
const SLOW: [u64; 3] = [20_000, 50_000, 200_000];
const QUICK: Latency = Latency { least: 0, jitter: 100, spikes: 0 };

/// By how much the visits of a long program are later. Where the links of the RTI are slow, a federate that
/// joins needs so much time.
const LATER: Nanos = 20;

/// Makes some federates of some programs transient, and draws what happens to them and to direct links.
pub(crate) fn draw(seed: u64, shape: Shape, program: &mut Program, plan: &mut Plan) {
    let mut rng = Rng::new(mix(seed ^ VISITS));
    if rng.percent(30) {
        transients(&mut rng, program, plan);
    }
    if shape.coordination == Coordination::Decentralized && rng.percent(8) {
        let (one, other) = two(&mut rng, program);
        plan.broken = Some((one, other, time(&mut rng)));
    }
    if shape.coordination == Coordination::Decentralized && rng.percent(10) {
        let running = program.federates.values().any(|federate| federate.transient);
        let pause = if running || rng.percent(50) { SHORT } else { LONG };
        plan.resets = Some(Resets { count: 1 + rng.below(6), pause });
    }
    if shape.coordination == Coordination::Decentralized {
        ends(&mut rng, program, plan);
        latencies(&mut rng, program, plan);
    } else if plan.boards {
        if !latencies(&mut rng, program, plan) && rng.percent(50) {
            // Otherwise most of those that join are too late.
            last(program, plan);
        }
        if rng.percent(50) {
            successors(&mut rng, program, plan);
        }
    }
}

/// In some programs, the processes of transient federates that users start. No other process takes their places.
pub(crate) fn by_hand(seed: u64, program: &Program) -> BTreeSet<Instance> {
    let mut rng = Rng::new(mix(seed ^ BY_HAND));
    if !rng.percent(20) {
        return BTreeSet::new();
    }
    let transients = program.federates.iter().filter(|(_, federate)| federate.transient);
    let lives =
        transients.flat_map(|(federate, _)| (0..12).map(move |life| Instance { federate, life }));
    lives.filter(|_| rng.percent(40)).collect()
}

/// Replaces transient federates, many times and soon, while messages of those that were there before are in transit.
fn successors(rng: &mut Rng, program: &Program, plan: &mut Plan) {
    let timeout = program.properties.timeout.unwrap_or_default();
    let transients = program.federates.iter().filter(|(_, federate)| federate.transient);
    for (me, _) in transients {
        for _ in 0..rng.below(8) {
            let at = PhysicalTime(rng.below(timeout.cast_unsigned() + 20_000).cast_signed());
            if rng.percent(60) {
                plan.visits.push((me, at, Visit::Crash));
            }
            let longest = if rng.percent(50) { 500 } else { 20_000 };
            let pause = rng.below(longest).cast_signed();
            plan.visits.push((me, at.plus(pause), Visit::Launch));
        }
    }
}

/// Draws a federate whose direct links break when it has ended.
fn ends(rng: &mut Rng, program: &Program, plan: &mut Plan) {
    if rng.percent(8) {
        plan.broken_at_end = Some(two(rng, program).0);
    }
}

/// Draws links of one kind that are slower than those of the other, so that what a federate learns from the
/// RTI overtakes what comes from its peers, or the other way round. Returns whether the program lasts longer because of that.
fn latencies(rng: &mut Rng, program: &mut Program, plan: &mut Plan) -> bool {
    let jitter = SLOW[usize::try_from(rng.below(3)).unwrap_or(0)];
    let slow = Latency { least: 0, jitter, spikes: 0 };
    let drawn = rng.below(10);
    let is_slow = matches!(drawn, 2..=4);
    if is_slow {
        (plan.latency, plan.direct_latency) = (slow, Some(QUICK));
        last(program, plan);
    } else if drawn < 2 {
        (plan.latency, plan.direct_latency) = (QUICK, Some(slow));
    }
    is_slow
}

/// Makes a program with transient federates long enough that they can join over slow links.
fn last(program: &mut Program, plan: &mut Plan) {
    if program.federates.values().any(|federate| federate.transient) {
        let timeout = &mut program.properties.timeout;
        *timeout = timeout.map(|timeout| LATER * timeout);
        for (_, at, _) in &mut plan.visits {
            at.0 *= LATER;
        }
    }
}

fn transients(rng: &mut Rng, program: &mut Program, plan: &mut Plan) {
    let count = program.federates.len();
    let timeout = TIMEOUTS[usize::try_from(rng.below(4)).unwrap_or(0)];
    program.properties.timeout.get_or_insert(timeout);
    let all: Vec<_> = program.federates.ids().collect();
    // Not all of them, or there would be no federation to join.
    let lasting = all[usize::try_from(rng.below(count as u64)).unwrap_or(0)];
    let share = 100 / (1 + rng.below(3));
    let chosen: Vec<_> =
        all.into_iter().filter(|me| *me != lasting && rng.percent(share)).collect();
    for me in chosen {
        program.federates[me].transient = true;
        if rng.percent(50) {
            plan.absent.insert(me);
        }
        for _ in 0..1 + rng.below(4) {
            let visit = match rng.below(10) {
                0..=4 => Visit::Launch,
                5..=7 => Visit::Leave,
                _ => Visit::Crash,
            };
            plan.visits.push((me, time(rng), visit));
        }
    }
}

fn two(rng: &mut Rng, program: &Program) -> (FederateId, FederateId) {
    let channels = program.channels.len() as u64;
    let at = usize::try_from(rng.below(channels)).unwrap_or(0);
    let channel = program.channels.values().nth(at);
    channel.map_or((FederateId(0), FederateId(1)), |channel| (channel.from, channel.to))
}

fn time(rng: &mut Rng) -> PhysicalTime {
    PhysicalTime(rng.below(50_000).cast_signed())
}
