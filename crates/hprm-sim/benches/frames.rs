//! How many frames a centralized federation takes: `cargo bench -p hprm-sim --bench frames`.
//!
//! Federations run for a second of simulated time, once with every next event reported to the RTI, and
//! once without the reports that no federate waits for (downstream next event tags). The numbers are
//! exact and the same on each run; nothing is timed.

use std::fmt::Write as _;

use hprm_federated::DnetMode;
use hprm_sim::{Latency, Plan, Rng, World, scenario};

/// Milliseconds, as texts of programs have them.
const MS: &str = "000000";

const TIMEOUT: &str = "timeout 1000";

/// A sender that acts every millisecond and sends four times a second; a slow receiver.
fn sparse() -> String {
    chain(2)
}

/// The same with federates between them that forward what comes.
fn chain(length: usize) -> String {
    let mut text = format!("{TIMEOUT}{MS}\nf0: every 1{MS}\nf0: every 250{MS} > f1\n");
    for me in 1..length {
        let _ = match me + 1 {
            next if next < length => writeln!(text, "f{me}: on f{} > f{next}", me - 1),
            _ => writeln!(text, "f{me}: on f{}\nf{me}: every 100{MS}", me - 1),
        };
    }
    text
}

/// Many such senders to one receiver, or one sender to many.
fn star(size: usize, gathers: bool) -> String {
    let mut text = format!("{TIMEOUT}{MS}\n");
    for me in 1..size {
        let (from, to) = if gathers { (me, 0) } else { (0, me) };
        let _ = writeln!(text, "f{from}: every 250{MS} > f{to}\nf{to}: on f{from}");
        if gathers || me == 1 {
            let _ = writeln!(text, "f{from}: every 1{MS}");
        }
        if !gathers || me == 1 {
            let _ = writeln!(text, "f{to}: every 100{MS}");
        }
    }
    text
}

/// A robot's chain: each stage has a period of its own, and forwards what comes.
fn stages() -> String {
    let mut text = format!("{TIMEOUT}{MS}\n");
    for (me, period) in ["1", "10", "33", "100"].into_iter().enumerate() {
        let target = if me < 3 { format!(" > f{}", me + 1) } else { String::new() };
        let _ = writeln!(text, "f{me}: every {period}{MS}{target}");
        if me > 0 {
            let _ = writeln!(text, "f{me}: on f{}{target}", me - 1);
        }
    }
    text
}

/// Two that send to each other at every tag: nothing can be left out.
fn ping_pong() -> String {
    format!("{TIMEOUT}{MS}\na: every 1{MS} > b\nb: on a > a\na: on b\nb > a after 1{MS}\n")
}

fn frames(text: &str, dnet: DnetMode) -> (usize, usize) {
    let latency = Latency { least: 20_000, jitter: 20_000, spikes: 0 };
    let plan = Plan { latency, dnet, ..Plan::default() };
    let outcome = World::new(&scenario(text), Rng::new(1), plan).run();
    outcome.expect("no fault is planned").frames
}

#[expect(clippy::print_stdout, reason = "a benchmark prints its result")]
fn main() {
    println!("                                all events reported     only what is needed");
    println!("                                 to RTI    from RTI     to RTI    from RTI");
    for (name, text) in [
        ("sparse sender", sparse()),
        ("chain of 3", chain(3)),
        ("chain of 10", chain(10)),
        ("99 senders to one", star(100, true)),
        ("one sender to 99", star(100, false)),
        ("stages of 1, 10, 33, 100 ms", stages()),
        ("ping-pong", ping_pong()),
    ] {
        let [all, needed] = [DnetMode::Off, DnetMode::Usual].map(|dnet| frames(&text, dnet));
        println!("{name:<28} {:>10} {:>11} {:>10} {:>11}", all.0, all.1, needed.0, needed.1);
    }
}
