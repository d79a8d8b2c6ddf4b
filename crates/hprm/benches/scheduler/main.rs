//! How fast the scheduler is, in Rust alone: `cargo bench -p hprm`. A few seconds.
//!
//! Rates of one run on one machine; `bench/boomerang` sets them beside another runtime's. Whatever
//! cargo passes on is ignored, but for words: then only workloads that contain one are run.

use std::time::Instant;

mod workloads;

use workloads::{WORKLOADS, Workload, properties};

const REPETITIONS: usize = 5;

#[allow(clippy::print_stdout, reason = "a benchmark prints what it measured")]
fn main() {
    let words: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with('-')).collect();
    println!("{:<16} {:>10} million/s: median (min–max)", "workload", "unit");
    for workload in &WORKLOADS {
        if words.is_empty() || words.iter().any(|word| workload.name.contains(word)) {
            let [min, median, max] = measure(workload);
            println!("{:<16} {:>10} {median:.2} ({min:.2}–{max:.2})", workload.name, workload.unit);
        }
    }
}

/// The rate in millions a second: minimum, median, maximum.
fn measure(workload: &Workload) -> [f64; 3] {
    let mut rates: Vec<f64> = (0..REPETITIONS)
        .map(|_| {
            let program = (workload.build)(workload.units, properties());
            let begin = Instant::now();
            program.run().expect("no body fails");
            workload.units as f64 / begin.elapsed().as_secs_f64() / 1e6
        })
        .collect();
    rates.sort_by(f64::total_cmp);
    [rates[0], rates[REPETITIONS / 2], rates[REPETITIONS - 1]]
}
