//! What is sent between the machines of a large fleet: `cargo bench -p hprm-sim --bench fleet`.
//!
//! A thousand federates are on a hundred machines, ten on each; agents lead all links between machines as relayed links. Each
//! program does the same every 10 ms, and runs for some such periods and for more of them: the difference is what one takes
//! when all have joined. The numbers are exact, and the same on each run; nothing is timed.

use std::fmt::Write as _;

use hprm_sim::{Machines, Plan, Rng, Traffic, World, scenario};

const MACHINES: usize = 100;
const EACH: usize = 10;

/// Milliseconds, as texts of programs have them.
const MS: &str = "000000";

/// How many milliseconds a period has, and how many periods there are.
const PERIOD: usize = 10;
const FEW: usize = 3;
const MORE: usize = 8;

/// The name of a federate.
fn name(number: usize) -> String {
    format!("m{}f{}", number / EACH, number % EACH)
}

/// On each machine a chain of ten, whose last one sends to the first one of the next machine, 1 ms later.
fn neighbours() -> String {
    let mut text = String::new();
    for me in 0..MACHINES * EACH {
        let (name, next, last) = (name(me), name(me + 1), me + 1 == MACHINES * EACH);
        let to = if last { String::new() } else { format!(" > {next}") };
        match me % EACH {
            0 => {
                let _ = writeln!(text, "{name}: every {PERIOD}{MS}{to}");
            }
            _ => {
                let _ = writeln!(text, "{name}: on {}{to}", self::name(me - 1));
            }
        }
        if me % EACH == EACH - 1 && !last {
            let _ = writeln!(text, "{name} > {next} after 1{MS}\n{next}: on {name}");
        }
    }
    text
}

/// One sends to all others, or all others to one.
fn star(gathers: bool) -> String {
    let mut text = String::new();
    for me in 1..MACHINES * EACH {
        let (from, to) = if gathers { (me, 0) } else { (0, me) };
        let (from, to) = (name(from), name(to));
        let _ = writeln!(text, "{from}: every {PERIOD}{MS} > {to}\n{to}: on {from}");
    }
    text
}

fn run(text: &str, coordination: &str, periods: usize) -> Traffic {
    let text = format!("{coordination}\ntimeout {}{MS}\n{text}", periods * PERIOD - PERIOD / 2);
    let machines = (0..MACHINES * EACH).map(|number| number / EACH).collect();
    let machines = Machines::in_a_good_network(machines, 0);
    let plan = Plan { machines: Some(machines), ..Plan::default() };
    let program = scenario(&text);
    let outcome = World::new(&program, Rng::new(1), plan).run_large();
    outcome.expect("no fault is planned").traffic
}

#[expect(clippy::print_stdout, reason = "a benchmark prints its result")]
fn main() {
    println!(
        "                                  links    frames   packets     bytes of packets, in 10 ms"
    );
    for (what, text) in
        [("neighbours", neighbours()), ("one to 999", star(false)), ("999 to one", star(true))]
    {
        for coordination in ["centralized", "decentralized"] {
            let [few, more] = [FEW, MORE].map(|periods| run(&text, coordination, periods));
            let of_one =
                |count: fn(&Traffic) -> u64| (count(&more) - count(&few)) / (MORE - FEW) as u64;
            println!(
                "{what:<14} {coordination:<14} {:>9} {:>9} {:>9} {:>9}",
                more.links,
                of_one(|it| it.frames),
                of_one(|it| it.packets),
                of_one(|it| it.bytes),
            );
        }
    }
}
