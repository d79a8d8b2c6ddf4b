//! Federations do what their program does in one process, whatever the network does.

use std::sync::Arc;

use hprm_core::{Coordination, FederateId, Nanos, PhysicalTime, Program, Tag};
use hprm_federated::Topology;
use hprm_sim::{Latency, Outcome, Plan, Rng, Shape, World, difference, generate, reference};

const CENTRALIZED: Shape =
    Shape { coordination: Coordination::Centralized, maxwait: 0, physical: false, cycles: false };
const PATIENT: Shape =
    Shape { coordination: Coordination::Decentralized, maxwait: Nanos::MAX, ..CENTRALIZED };

/// Latencies from none to many times a program's length.
const LATENCIES: [u64; 4] = [1, 300, 5_000, 200_000];

fn world(
    seed: u64,
    shape: Shape,
    plan: impl FnOnce(&mut Rng, &Program) -> Plan,
) -> (Arc<Program>, Result<Outcome, String>) {
    let mut rng = Rng::new(seed);
    let program = Arc::new(generate(&mut rng, shape));
    let plan = plan(&mut rng, &program);
    let outcome = World::new(&program, rng, plan).run();
    (program, outcome)
}

fn latency(rng: &mut Rng) -> Latency {
    let jitter = LATENCIES[usize::try_from(rng.below(4)).unwrap()];
    Latency { jitter, ..Latency::default() }
}

fn equals_reference(seed: u64, shape: Shape) {
    let (program, outcome) =
        world(seed, shape, |rng, _| Plan { latency: latency(rng), ..Plan::default() });
    let outcome = outcome.unwrap_or_else(|error| panic!("seed {seed}: {error}"));
    assert_eq!(outcome.failed, None, "seed {seed}");
    let must = reference(&program);
    if let Some(difference) = difference(&program, &outcome.log, &must, Tag::FOREVER) {
        panic!("seed {seed}: {difference}");
    }
}

#[test]
fn centralized_federations_equal_their_program() {
    (0..600).for_each(|seed| equals_reference(seed, CENTRALIZED));
}

/// Federates that send to one another on cycles without a delay.
const CYCLIC: Shape = Shape { cycles: true, ..CENTRALIZED };
const PATIENT_CYCLIC: Shape = Shape { cycles: true, ..PATIENT };

const SHAPES: [Shape; 4] = [CENTRALIZED, PATIENT, CYCLIC, PATIENT_CYCLIC];

#[test]
fn federates_on_cycles_equal_their_program() {
    let mut cyclic = 0;
    for seed in 0..12_000 {
        let program = generate(&mut Rng::new(seed), CYCLIC);
        if !Topology::new(&program).zero_delay_cycles().is_empty() {
            cyclic += 1;
            equals_reference(seed, CYCLIC);
            equals_reference(seed, PATIENT_CYCLIC);
        }
    }
    assert!(cyclic > 300, "only {cyclic} of the programs have a cycle");
}

#[test]
fn patient_decentralized_federations_equal_their_program() {
    (0..600).for_each(|seed| equals_reference(seed, PATIENT));
}

#[test]
fn clocks_make_no_message_tardy() {
    for seed in 0..800 {
        let shape = SHAPES[usize::try_from(seed % 4).unwrap()];
        let shape = Shape { physical: true, ..shape };
        let plan = |rng: &mut Rng, _: &_| Plan { latency: latency(rng), ..Plan::default() };
        let (_, outcome) = world(seed, shape, plan);
        let outcome = outcome.unwrap_or_else(|error| panic!("seed {seed}: {error}"));
        assert_eq!((outcome.failed, outcome.tardy, outcome.lost), (None, 0, 0), "seed {seed}");
    }
}

#[test]
fn impatient_federations_equal_their_program_unless_they_report_tardy_messages() {
    let (mut punctual, mut tardy) = (0, 0);
    for seed in 0..400 {
        let shape = Shape { maxwait: 2_000, cycles: seed % 2 == 0, ..PATIENT };
        let plan = |rng: &mut Rng, _: &_| Plan { latency: latency(rng), ..Plan::default() };
        let (program, outcome) = world(seed, shape, plan);
        let outcome = outcome.unwrap_or_else(|error| panic!("seed {seed}: {error}"));
        assert_eq!(outcome.failed, None, "seed {seed}");
        if outcome.tardy + outcome.lost > 0 {
            tardy += 1;
            continue;
        }
        punctual += 1;
        let must = reference(&program);
        if let Some(difference) = difference(&program, &outcome.log, &must, Tag::FOREVER) {
            panic!("seed {seed}: {difference}");
        }
    }
    assert!(punctual > 50 && tardy > 50, "{punctual} without and {tardy} with tardy messages");
}

#[test]
fn federates_stop_together_at_a_tag_that_no_federate_has_passed() {
    for seed in 0..800 {
        let shape = SHAPES[usize::try_from(seed % 4).unwrap()];
        let (program, outcome) = world(seed, shape, |rng, program| {
            let federate = rng.below(program.federates.len() as u64);
            let tag = Tag::new(rng.below(8_000).cast_signed(), 0);
            let stop = Some((FederateId(u16::try_from(federate).unwrap()), tag));
            Plan { latency: latency(rng), stop, ..Plan::default() }
        });
        let outcome = outcome.unwrap_or_else(|error| panic!("seed {seed}: {error}"));
        let last = outcome.last[FederateId(0)];
        assert!(outcome.last.values().all(|tag| *tag == last), "seed {seed}: {:?}", outcome.last);
        let must = reference(&program);
        if let Some(difference) = difference(&program, &outcome.log, &must, last) {
            panic!("seed {seed}: {difference}");
        }
    }
}

#[test]
fn a_crash_ends_the_federation_and_is_reported_once() {
    let mut crashed = 0;
    for seed in 0..800 {
        let shape = SHAPES[usize::try_from(seed % 4).unwrap()];
        let mut victim = None;
        let (_, outcome) = world(seed, shape, |rng, program| {
            let federate = rng.below(program.federates.len() as u64);
            let federate = FederateId(u16::try_from(federate).unwrap());
            victim = Some(federate);
            let at = PhysicalTime(rng.below(60_000).cast_signed());
            Plan { latency: latency(rng), crash: Some((federate, at)), ..Plan::default() }
        });
        match outcome {
            Ok(outcome) if outcome.failed.is_some() => {
                assert_eq!(outcome.failed, victim, "seed {seed}");
                crashed += 1;
            }
            Ok(_) => {}
            Err(error) => panic!("seed {seed}: {error}"),
        }
    }
    assert!(crashed > 100, "only {crashed} crashes came before the end");
}

#[test]
fn a_seed_replays_exactly() {
    let run =
        || world(7, CENTRALIZED, |rng, _| Plan { latency: latency(rng), ..Plan::default() }).1;
    assert_eq!(run(), run());
}
