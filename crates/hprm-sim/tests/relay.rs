//! Random relayed links over random carriers: nothing is lost, nothing comes twice, and both ends learn of an end.

use hprm_sim::RelayTrial;

/// Links of every build.
const SEEDS: u64 = 5_000;

#[test]
fn relayed_links_keep_their_promises_whatever_the_carrier_does() {
    let (mut frames, mut lost, mut failed) = (0, 0, 0);
    for seed in 0..SEEDS {
        let trial = RelayTrial::draw(seed);
        let verdict = trial.run().unwrap_or_else(|wrong| panic!("seed {seed}: {wrong}\n{trial}"));
        frames += verdict.frames as u64;
        lost += verdict.lost;
        failed += u64::from(verdict.failed);
    }
    // Otherwise the seeds would test little.
    assert!(frames > 20 * SEEDS, "only {frames} frames");
    assert!(lost > 5 * SEEDS, "only {lost} packets were lost");
    assert!(failed > SEEDS / 10, "only {failed} links failed as they must");
}

#[test]
fn little_is_sent_again_that_is_only_late() {
    let (mut frames, mut duplicates) = (0, 0);
    for seed in 0..50 {
        let trial = RelayTrial::draw_late(seed);
        let verdict = trial.run().unwrap_or_else(|wrong| panic!("seed {seed}: {wrong}\n{trial}"));
        frames += verdict.frames as u64;
        duplicates += verdict.duplicates;
        assert_eq!(verdict.lost, 0, "seed {seed}");
    }
    assert!(duplicates < frames / 200, "{duplicates} of {frames} frames came once more");
}

#[test]
fn more_gaps_than_an_answer_can_tell_of_are_filled() {
    for seed in 0..500 {
        let trial = RelayTrial::draw_gaps(seed);
        let verdict = trial.run().unwrap_or_else(|wrong| panic!("seed {seed}: {wrong}\n{trial}"));
        assert_eq!(verdict.frames, 200, "seed {seed}");
    }
}

#[test]
fn a_seed_of_a_link_does_the_same_each_time() {
    for seed in 0..100 {
        assert_eq!(RelayTrial::draw(seed).run(), RelayTrial::draw(seed).run(), "seed {seed}");
    }
}
