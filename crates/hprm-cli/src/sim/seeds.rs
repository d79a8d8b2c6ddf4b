//! Federations from seeds, in a simulated network.
//!
//! What a seed means and what must be true of it is `hprm-sim`'s business; this spreads many seeds
//! over the processors, adds up, and shows what is wrong. How long it took is not a result: it goes
//! to the standard error.

use std::process::ExitCode;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::{self, Builder};
use std::time::Instant;

use hprm_sim::Trial;

use crate::args::Sim;
use crate::message::{Error, print_error, print_line};

/// How many seeds a thread takes at a time.
const CHUNK: u64 = 500;

/// What many seeds have in common.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
struct Sum {
    federations: u64,
    events: usize,
    compared: u64,
    failed: u64,
    tardy: u64,
    /// The first seed with which something is wrong.
    wrong: Option<u64>,
    /// How many there are.
    wrongs: u64,
}

/// Runs the seeds and shows the outcome.
///
/// # Errors
///
/// None; that something is wrong is an outcome.
pub(crate) fn sim(arguments: &Sim) -> Result<ExitCode, Error> {
    let last = arguments.seed.saturating_add(arguments.seeds - 1);
    if arguments.seeds == 1 {
        return Ok(one(arguments.seed, arguments.schedule));
    }
    let begun = Instant::now();
    let sum = many(arguments.seed, last);
    let minutes = begun.elapsed().as_secs_f64() / 60.0;
    print_line(&format!(
        "seeds {} to {last}: {} federations, {} events; {} compared with one scheduler, {} failed as \
         they must, {} had tardy messages; {} wrong",
        arguments.seed,
        sum.federations,
        sum.events,
        sum.compared,
        sum.failed,
        sum.tardy,
        sum.wrongs
    ));
    // A rate for people; that it is not exact is of no importance.
    #[expect(clippy::cast_precision_loss, reason = "it is rounded to millions anyway")]
    let rate = sum.events as f64 / minutes / 1e6;
    print_error(format!("{rate:.1} million events per minute\n").as_bytes());
    let Some(seed) = sum.wrong else { return Ok(ExitCode::SUCCESS) };
    print_line(Trial::draw(seed).tell().trim_end());
    Ok(ExitCode::FAILURE)
}

fn one(seed: u64, schedule: bool) -> ExitCode {
    let trial = Trial::draw(seed);
    let outcome = trial.run();
    match &outcome {
        Ok(verdict) if !schedule => print_line(&format!("{trial}{verdict}")),
        _ => print_line(trial.tell().trim_end()),
    }
    if outcome.is_ok() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

fn many(first: u64, last: u64) -> Sum {
    let threads = thread::available_parallelism().map_or(1, usize::from);
    // The next chunk of seeds. Each thread takes one after the other, so it does not matter how many threads
    // the system lets there be.
    let next = AtomicU64::new(0);
    let share = || {
        let mut sum = Sum::default();
        loop {
            let chunk = next.fetch_add(1, Ordering::Relaxed);
            let Some(from) = chunk.checked_mul(CHUNK).and_then(|chunk| first.checked_add(chunk))
            else {
                return sum;
            };
            if from > last {
                return sum;
            }
            (from..=last.min(from.saturating_add(CHUNK - 1))).for_each(|seed| sum.add(seed));
        }
    };
    thread::scope(|scope| {
        let workers = (1..threads).map_while(|_| Builder::new().spawn_scoped(scope, share).ok());
        let workers: Vec<_> = workers.collect();
        let own = share();
        let sums = workers.into_iter().map(|worker| worker.join().expect("a seed does not panic"));
        sums.fold(own, Sum::plus)
    })
}

impl Sum {
    fn add(&mut self, seed: u64) {
        self.federations += 1;
        match Trial::draw(seed).run() {
            Ok(verdict) => {
                self.events += verdict.events;
                self.compared += u64::from(verdict.compared);
                self.failed += u64::from(verdict.failed);
                self.tardy += u64::from(verdict.tardy > 0);
            }
            Err(_) => {
                self.wrong = Some(self.wrong.map_or(seed, |known| known.min(seed)));
                self.wrongs += 1;
            }
        }
    }

    fn plus(self, other: Self) -> Self {
        Self {
            federations: self.federations + other.federations,
            events: self.events + other.events,
            compared: self.compared + other.compared,
            failed: self.failed + other.failed,
            tardy: self.tardy + other.tardy,
            wrong: self.wrong.into_iter().chain(other.wrong).min(),
            wrongs: self.wrongs + other.wrongs,
        }
    }
}
