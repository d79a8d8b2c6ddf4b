//! Random federations with random faults. `hprm sim --seed N` shows what a seed does.

use std::sync::Arc;

use hprm_core::{Coordination, Nanos};
use hprm_federated::DnetMode;
use hprm_sim::{Latency, Plan, Rng, Shape, Traffic, Trial, World, generate, scenario};

/// Seeds of every build; `make sim-nightly` looks at a million.
const SEEDS: u64 = 20_000;

/// Seeds among millions that have found faults which those do not.
const LATER: [u64; 7] = [24_367, 87_629, 3_771_157, 6_577_067, 7_086_814, 9_192_273, 9_583_016];

/// Seeds among the first ones that alone find some mutant. It names the test of these, which then need not try all before them.
const RARE: [u64; 3] = [1_318, 4_349, 5_492];

#[test]
fn seeds_that_found_rare_faults_do_what_their_program_does() {
    for seed in LATER.into_iter().chain(RARE) {
        let trial = Trial::draw(seed);
        trial.run().unwrap_or_else(|wrong| panic!("seed {seed}: {wrong}\n{trial}"));
    }
}

#[test]
fn random_federations_do_what_their_program_does() {
    let (mut compared, mut failed, mut tardy) = (0, 0, 0);
    let (mut apart, mut broken, mut mended, mut withdrawn) = (0, 0, 0, 0);
    for seed in 0..SEEDS {
        let trial = Trial::draw(seed);
        let verdict = trial.run().unwrap_or_else(|wrong| panic!("seed {seed}: {wrong}\n{trial}"));
        compared += u64::from(verdict.compared);
        failed += u64::from(verdict.failed);
        tardy += u64::from(verdict.tardy > 0);
        withdrawn += u64::from(verdict.withdrawn > 0);
        let Traffic { links, lost, ref severed, .. } = verdict.traffic;
        apart += u64::from(links > 0);
        broken += u64::from(!severed.is_empty());
        mended += u64::from(lost > 0 && severed.is_empty() && verdict.compared);
    }
    // Otherwise the seeds would test little.
    assert!(compared > SEEDS / 2, "only {compared} were compared");
    assert!(failed > SEEDS / 20, "only {failed} failed as they must");
    assert!(tardy > SEEDS / 50, "only {tardy} had tardy messages");
    assert!(withdrawn > SEEDS / 100, "only {withdrawn} had a successor that did not take part");
    assert!(apart > SEEDS / 5, "only {apart} ran on several machines");
    assert!(broken > SEEDS / 100, "only {broken} lost a link between machines");
    assert!(mended > SEEDS / 20, "only {mended} lost packets and nothing else");
}

#[test]
fn a_seed_shows_the_same_each_time() {
    for seed in 0..50 {
        assert_eq!(Trial::draw(seed).tell(), Trial::draw(seed).tell(), "seed {seed}");
    }
}

#[test]
fn a_federation_that_goes_on_for_ever_is_found() {
    for coordination in ["centralized", "decentralized"] {
        let program = scenario(&format!("{coordination}\n a: every 1 > b\n b: on a"));
        let outcome = World::new(&program, Rng::new(0), Plan::default()).run();
        assert_eq!(outcome.err().as_deref(), Some("it goes on for ever"), "{coordination}");
    }
}

/// By how much a tag begins too late, at most, if nothing takes longer than a nanosecond or two, and
/// events are hundreds of them apart.
fn lag(seed: u64, dnet: DnetMode) -> Nanos {
    let shape = Shape {
        coordination: Coordination::Centralized,
        maxwait: 0,
        physical: false,
        cycles: seed.is_multiple_of(2),
    };
    let mut rng = Rng::new(seed);
    let program = Arc::new(generate(&mut rng, shape));
    let latency = Latency { least: 1, jitter: 2, spikes: 0 };
    let plan = Plan { latency, dnet, ..Plan::default() };
    let outcome = World::new(&program, rng, plan).run();
    outcome.unwrap_or_else(|error| panic!("seed {seed}: {error}")).lag
}

#[test]
fn no_federate_waits_for_reports_that_another_one_skips() {
    for dnet in [DnetMode::Off, DnetMode::Usual, DnetMode::Eager] {
        for seed in 0..2_000 {
            let lag = lag(seed, dnet);
            assert!(lag < 150, "seed {seed}: a tag begins {lag} ns late, {dnet:?}");
        }
    }
}
