//! Federates skip the reports that no other federate needs, and nothing else changes.

use std::fmt::Write as _;

use hprm_core::Tag;
use hprm_federated::DnetMode;
use hprm_sim::{Latency, Outcome, Plan, Rng, World, difference, reference, scenario};

/// Milliseconds, as texts of programs have them.
const MS: &str = "000000";

/// A sender that acts every millisecond and seldom sends a message; its receiver is slow.
fn sparse() -> String {
    format!(
        "timeout 1000{MS}\n a: every 1{MS}\n a: every 250{MS} > b\n b: every 100{MS}\n b: on a\n"
    )
}

/// The same, with federates between them that only forward what comes.
fn chain(length: usize) -> String {
    let mut text = format!("timeout 1000{MS}\n f0: every 1{MS}\n f0: every 250{MS} > f1\n");
    for me in 1..length {
        let _ = write!(text, " f{me}: on f{}", me - 1);
        let _ = match me + 1 {
            next if next < length => writeln!(text, " > f{next}"),
            _ => writeln!(text, "\n f{me}: every 100{MS}"),
        };
    }
    text
}

/// What the federation of a text does.
fn outcome(text: &str, dnet: DnetMode) -> Outcome {
    let program = scenario(text);
    let latency = Latency { least: 20_000, jitter: 20_000, spikes: 0 };
    let plan = Plan { latency, dnet, ..Plan::default() };
    let outcome = World::new(&program, Rng::new(1), plan).run().unwrap();
    let wrong = difference(&program, &outcome.log, &reference(&program), Tag::FOREVER);
    assert_eq!(wrong, None, "{dnet:?}: {text}");
    outcome
}

/// How many frames go to the RTI and come from it, if federates report everything and if not.
fn frames(text: &str) -> (usize, usize) {
    [DnetMode::Off, DnetMode::Usual]
        .map(|dnet| {
            let (to_rti, from_rti) = outcome(text, dnet).frames;
            to_rti + from_rti
        })
        .into()
}

#[test]
fn a_sender_for_which_no_other_federate_waits_skips_its_reports() {
    for text in [sparse(), chain(3), chain(10)] {
        let (all, needed) = frames(&text);
        assert!(needed * 5 < all, "{needed} of {all} frames: {text}");
    }
}

#[test]
fn a_sender_that_always_sends_costs_no_more_than_before() {
    let text = format!("timeout 300{MS}\n a: every 1{MS} > b\n b: on a > a\n a: on b\n");
    let delayed = format!("{text} b > a after 1{MS}\n");
    for text in [text, delayed] {
        let (all, needed) = frames(&text);
        assert!(needed * 100 <= all * 102, "{needed} instead of {all} frames: {text}");
    }
}
