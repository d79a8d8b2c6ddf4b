//! Federations of HPRM in Rust and processes with iceoryx2, in one run, in turn.
//!
//! Every repetition runs each cell with each contender, in an order that changes. Ratios are taken within repetitions.
//! Prints a table; writes out/rust-federations.json. With words, it is one of the processes that it starts.

mod cell;
mod ours;
mod theirs;

use std::env;
use std::error::Error;
use std::fs;
use std::path::Path;
use std::process::Command;

use cell::{Cell, Contender, Waiting, Workload, median};
use serde_json::json;

const REPETITIONS: usize = 5;

const CONTENDERS: [Contender; 3] =
    [Contender::Decentralized, Contender::Iceoryx2, Contender::Centralized];

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<_> = env::args().skip(1).collect();
    let words: Vec<_> = words.iter().map(String::as_str).collect();
    match *words.as_slice() {
        ["cell", cell] => {
            let cell: Cell = serde_json::from_str(cell)?;
            match cell.contender {
                Contender::Iceoryx2 => theirs::run(&cell),
                _ => Ok(ours::run(&cell)?),
            }
        }
        ["node", cell, name] => theirs::node(&serde_json::from_str(cell)?, name),
        [] => compare(""),
        [only] => compare(only),
        _ => Err("words: none, or a part of the names of the rows that are wanted".into()),
    }
}

/// A row of the table: what is measured, and for how many messages.
struct Row {
    name: &'static str,
    waiting: Waiting,
    workload: Workload,
    rounds: u64,
}

fn rows() -> Vec<Row> {
    use Waiting::{Polling, Sleeping};
    let row = |name, waiting, workload, rounds| Row { name, waiting, workload, rounds };
    vec![
        row("array of 64 B, polling", Polling, Workload::Array, 20_000),
        row("struct of 64 B, polling", Polling, Workload::Struct, 20_000),
        row("array of 64 B, sleeping", Sleeping, Workload::Array, 3_000),
        row("struct of 64 B, sleeping", Sleeping, Workload::Struct, 3_000),
        row("loan of 1 MB, polling", Polling, Workload::Loan(1_000_000), 300),
        row("loan of 10 MB, polling", Polling, Workload::Loan(10_000_000), 300),
        row("loan of 50 MB, polling", Polling, Workload::Loan(50_000_000), 300),
        row("loan of 1 MB, sleeping", Sleeping, Workload::Loan(1_000_000), 300),
        row("loan of 10 MB, sleeping", Sleeping, Workload::Loan(10_000_000), 300),
        row("loan of 50 MB, sleeping", Sleeping, Workload::Loan(50_000_000), 300),
        row("each of many of 1 KB, polling", Polling, Workload::Rate(1024), 30_000),
        row("each of many of 1 KB, sleeping", Sleeping, Workload::Rate(1024), 30_000),
    ]
}

fn compare(only: &str) -> Result<(), Box<dyn Error>> {
    let out = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../out");
    fs::create_dir_all(&out)?;
    println!("one way in µs: median (min–max) of {REPETITIONS}; a processor for each of both\n");
    println!("| | decentralized | iceoryx2 | ratio | centralized |");
    println!("|---|---|---|---|---|");
    let mut results = Vec::new();
    for row in rows().iter().filter(|row| row.name.contains(only)) {
        let [ours, theirs, centralized] = repeat(row, &out)?;
        let ratios: Vec<_> = ours.iter().zip(&theirs).map(|(ours, theirs)| ours / theirs).collect();
        let cells = [&ours, &theirs, &ratios, &centralized].map(|samples| text(samples));
        println!("| {} | {} |", row.name, cells.join(" | "));
        results.push(json!({
            "name": row.name, "decentralized": ours, "iceoryx2": theirs, "ratios": ratios,
            "centralized": centralized,
        }));
    }
    let report = json!({ "microseconds": results, "repetitions": REPETITIONS });
    fs::write(out.join("rust-federations.json"), serde_json::to_string_pretty(&report)?)?;
    Ok(())
}

/// What each contender has taken in each repetition.
fn repeat(row: &Row, out: &Path) -> Result<[Vec<f64>; 3], Box<dyn Error>> {
    let mut samples = [const { Vec::new() }; 3];
    for repetition in 0..REPETITIONS {
        for turn in 0..CONTENDERS.len() {
            let which = (turn + repetition) % CONTENDERS.len();
            samples[which].push(measure(row, CONTENDERS[which], out)?);
        }
    }
    Ok(samples)
}

/// Microseconds.
fn measure(row: &Row, contender: Contender, out: &Path) -> Result<f64, Box<dyn Error>> {
    let Row { waiting, workload, rounds, .. } = *row;
    let result = out.join("rust-federations.result");
    let cell = Cell { contender, waiting, workload, rounds, warm_up: rounds / 10, result };
    let words = ["cell", &serde_json::to_string(&cell)?];
    let status = Command::new(env::current_exe()?).args(words).status()?;
    if !status.success() {
        return Err(format!("{}, {contender:?}: {status}", row.name).into());
    }
    Ok(cell.read()? / 1000.0)
}

fn text(samples: &[f64]) -> String {
    let least = samples.iter().copied().fold(f64::INFINITY, f64::min);
    let greatest = samples.iter().copied().fold(0.0, f64::max);
    format!("{:.2} ({least:.2}–{greatest:.2})", median(samples.to_vec()))
}
