//! How fast the scheduler is, in Rust alone: `cargo bench -p hprm`. A few seconds.
//!
//! The last rows are about workers: a level of a hundred reactions, each of which computes for some
//! microseconds. Where they compute nothing, to wake another thread costs more than to run them.
//!
//! Rates of one run on one machine; `bench/boomerang` sets them beside another runtime's. Options of
//! cargo are ignored; with words, only workloads whose names contain one are run.

use std::hint::black_box;
use std::time::{Duration, Instant};

use hprm::prelude::*;

mod workloads;

use workloads::{WIDTH, WORKLOADS, Workload, properties};

const REPETITIONS: usize = 5;

#[allow(clippy::print_stdout, reason = "a benchmark prints what it measured")]
fn main() {
    let words: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with('-')).collect();
    let wanted = |name: &str| words.is_empty() || words.iter().any(|word| name.contains(word));
    println!("{:<26} {:>10} million/s: median (min–max)", "workload", "unit");
    for workload in WORKLOADS.iter().filter(|workload| wanted(workload.name)) {
        let [min, median, max] = measure(workload, None);
        println!("{:<26} {:>10} {median:.2} ({min:.2}–{max:.2})", workload.name, workload.unit);
    }
    for workers in [1, 2, 4] {
        if wanted(COMPUTING.name) {
            let [min, median, max] = measure(&COMPUTING, Some(workers));
            let name = format!("{}, workers: {workers}", COMPUTING.name);
            println!("{name:<26} {:>10} {median:.3} ({min:.3}–{max:.3})", COMPUTING.unit);
        }
    }
}

/// A timer that triggers a hundred reactions, which compute.
const COMPUTING: Workload =
    Workload { name: "computing", units: 10_000, build: computing, unit: "reactions" };

fn computing(reactions: u64, properties: Properties) -> Runnable {
    let mut program = Program::new("Computing").properties(properties);
    for i in 0..WIDTH {
        program.reactor(&format!("r[{i}]"), (0, i + 1), |reactor| {
            let tick = reactor.timer("tick", Duration::ZERO, Duration::from_nanos(1));
            reactor.reaction().on(tick).run(move |(count, random), ctx| {
                for _ in 0..10_000 {
                    *random ^= *random << 13;
                    *random ^= *random >> 7;
                    *random ^= *random << 17;
                }
                black_box(*random);
                *count += 1;
                if *count == reactions / WIDTH {
                    ctx.request_stop();
                }
            });
        });
    }
    program.build().expect("the program is fixed")
}

/// The rate in millions a second: minimum, median, maximum.
fn measure(workload: &Workload, workers: Option<u32>) -> [f64; 3] {
    let mut rates: Vec<f64> = (0..REPETITIONS)
        .map(|_| {
            let program = (workload.build)(workload.units, Properties { workers, ..properties() });
            let begin = Instant::now();
            program.run().expect("no body fails");
            workload.units as f64 / begin.elapsed().as_secs_f64() / 1e6
        })
        .collect();
    rates.sort_by(f64::total_cmp);
    [rates[0], rates[REPETITIONS / 2], rates[REPETITIONS - 1]]
}
