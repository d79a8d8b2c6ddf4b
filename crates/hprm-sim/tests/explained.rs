//! What federates and the RTI say they wait for is true. The simulation compares it with what they do; here are
//! only the kinds that it must have come across.

use std::collections::BTreeSet;

use hprm_sim::Trial;

/// Seeds after which every kind has been seen.
const SEEDS: u64 = 3_000;

#[test]
fn everything_that_a_federate_can_wait_for_is_explained() {
    let mut seen = BTreeSet::new();
    for seed in 0..SEEDS {
        let trial = Trial::draw(seed);
        let verdict = trial.run().unwrap_or_else(|wrong| panic!("seed {seed}: {wrong}\n{trial}"));
        seen.extend(verdict.waits);
    }
    let all = [
        "Bound",
        "BrokenLink",
        "Due",
        "Events",
        "Grant",
        "InTransit",
        "Message",
        "Starvation",
        "Stop",
        "Time",
        "Unprocessed",
        "Upstream",
    ];
    let missing: Vec<_> = all.iter().filter(|kind| !seen.contains(*kind)).collect();
    assert!(missing.is_empty(), "no seed has {missing:?}");
}
