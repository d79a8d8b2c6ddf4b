//! The scheduler's workloads in HPRM and in boomerang, in one run, in turn.
//!
//! Every repetition runs each workload in both, in an order that changes, so that what the machine
//! does at the same time meets both. Ratios are taken within repetitions. Prints a table; writes
//! out/boomerang.json.

mod peer;
#[path = "../../../crates/hprm/benches/scheduler/workloads.rs"]
mod workloads;

use std::error::Error;
use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use serde_json::json;
use workloads::{WORKLOADS, Workload, properties};

const REPETITIONS: usize = 7;

/// How many units the first run of a workload, which counts for nothing, is shortened by.
const WARM_UP: u64 = 10;

/// The rates of one contender, or ratios, by repetition.
struct Samples(Vec<f64>);

impl Samples {
    /// Minimum, median, maximum.
    fn summary(&self) -> [f64; 3] {
        let mut sorted = self.0.clone();
        sorted.sort_by(f64::total_cmp);
        [sorted[0], sorted[sorted.len() / 2], sorted[sorted.len() - 1]]
    }

    fn text(&self) -> String {
        let [min, median, max] = self.summary();
        format!("{median:.2} ({min:.2}–{max:.2})")
    }

    fn json(&self) -> serde_json::Value {
        let [min, median, max] = self.summary();
        json!({ "min": min, "median": median, "max": max, "all": self.0 })
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    println!("million/s, one thread: median (min–max) of {REPETITIONS}\n");
    println!("| workload | counted | HPRM | boomerang 0.3 | ratio |");
    println!("|---|---|---|---|---|");
    let mut results = Vec::new();
    for workload in &WORKLOADS {
        let [ours, theirs, ratio] = compare(workload)?;
        let Workload { name, unit, .. } = workload;
        println!("| {name} | {unit} | {} | {} | {} |", ours.text(), theirs.text(), ratio.text());
        results.push(json!({
            "workload": name,
            "unit": unit,
            "hprm": ours.json(),
            "boomerang": theirs.json(),
            "ratio": ratio.json(),
        }));
    }
    let out = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../out");
    fs::create_dir_all(&out)?;
    let report = json!({ "million_per_second": results, "repetitions": REPETITIONS });
    fs::write(out.join("boomerang.json"), serde_json::to_string_pretty(&report)?)?;
    Ok(())
}

/// Our rates, theirs, and the ratios.
fn compare(workload: &Workload) -> Result<[Samples; 3], Box<dyn Error>> {
    let mut samples = [const { Vec::new() }; 3];
    ours(workload, workload.units / WARM_UP)?;
    theirs(workload, workload.units / WARM_UP)?;
    for repetition in 0..REPETITIONS {
        let (ours, theirs) = if repetition % 2 == 0 {
            let first = ours(workload, workload.units)?;
            (first, theirs(workload, workload.units)?)
        } else {
            let first = theirs(workload, workload.units)?;
            (ours(workload, workload.units)?, first)
        };
        let rate = |time: Duration| workload.units as f64 / time.as_secs_f64() / 1e6;
        let ratio = theirs.as_secs_f64() / ours.as_secs_f64();
        for (samples, sample) in samples.iter_mut().zip([rate(ours), rate(theirs), ratio]) {
            samples.push(sample);
        }
    }
    Ok(samples.map(Samples))
}

fn ours(workload: &Workload, units: u64) -> Result<Duration, Box<dyn Error>> {
    let program = (workload.build)(units, properties());
    let begin = Instant::now();
    program.run()?;
    Ok(begin.elapsed())
}

fn theirs(workload: &Workload, units: u64) -> Result<Duration, Box<dyn Error>> {
    let mut scheduler = peer::build(workload.name, units)?;
    let begin = Instant::now();
    scheduler.event_loop();
    let elapsed = begin.elapsed();
    peer::check(workload.name, units, scheduler)?;
    Ok(elapsed)
}
