//! Random federations, with whatever befalls them. `hprm sim --seed N` tells what a seed does.

use hprm_sim::Trial;

/// Seeds of every build; `make sim-nightly` looks at a million.
const SEEDS: u64 = 20_000;

#[test]
fn random_federations_do_what_their_program_does() {
    let (mut compared, mut failed, mut tardy) = (0, 0, 0);
    for seed in 0..SEEDS {
        let trial = Trial::draw(seed);
        let verdict = trial.run().unwrap_or_else(|wrong| panic!("seed {seed}: {wrong}\n{trial}"));
        compared += u64::from(verdict.compared);
        failed += u64::from(verdict.failed);
        tardy += u64::from(verdict.tardy > 0);
    }
    // Otherwise the seeds would not say much.
    assert!(compared > SEEDS / 2, "only {compared} were compared");
    assert!(failed > SEEDS / 20, "only {failed} failed as they must");
    assert!(tardy > SEEDS / 50, "only {tardy} had tardy messages");
}

#[test]
fn a_seed_tells_the_same_each_time() {
    for seed in 0..50 {
        assert_eq!(Trial::draw(seed).tell(), Trial::draw(seed).tell(), "seed {seed}");
    }
}
