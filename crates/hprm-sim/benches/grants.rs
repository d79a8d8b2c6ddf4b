//! What a grant costs: `cargo bench -p hprm-sim`.
//!
//! Federations of many sizes and shapes run in the simulated network, which records the inputs of their
//! RTI. Then a new RTI gets the same inputs, and only that is timed. In all of them every federate has
//! an event of its own at every tag, so the work for each grows only as the RTI's does.

use std::fmt::Write as _;
use std::sync::Arc;
use std::time::{Duration, Instant};

use hprm_core::{PhysicalTime, Program};
use hprm_federated::{Frame, Rti, RtiInput, RtiOutput};
use hprm_sim::{Latency, Plan, Rng, World, scenario};

const SIZES: [usize; 4] = [2, 10, 100, 1_000];

/// The time between two tags.
const PERIOD: usize = 1_000;

/// How long replays are repeated.
const ENOUGH: Duration = Duration::from_millis(300);

/// What connects the federates, as pairs of their numbers.
fn edges(shape: &str, size: usize) -> Vec<(usize, usize)> {
    let mut rng = Rng::new(size as u64);
    let below = |rng: &mut Rng, limit: usize| {
        usize::try_from(rng.below(limit as u64)).expect("it is below a size")
    };
    match shape {
        "chain" => (1..size).map(|to| (to - 1, to)).collect(),
        "one to all" => (1..size).map(|to| (0, to)).collect(),
        "all to one" => (1..size).map(|from| (from, 0)).collect(),
        _ => {
            let mut edges: Vec<_> = (1..size)
                .flat_map(|to| [below(&mut rng, to), below(&mut rng, to)].map(|from| (from, to)))
                .collect();
            edges.sort_unstable();
            edges.dedup();
            edges
        }
    }
}

fn program(shape: &str, size: usize, tags: usize) -> Arc<Program> {
    let mut text = format!("timeout {}\n", (tags - 1) * PERIOD);
    let edges = edges(shape, size);
    for me in 0..size {
        let targets = edges.iter().filter(|(from, _)| *from == me);
        let targets: Vec<_> = targets.map(|(_, to)| format!("f{to}")).collect();
        let _ = writeln!(text, "f{me}: every {PERIOD} > {}", targets.join(" "));
    }
    for (from, to) in edges {
        let _ = writeln!(text, "f{to}: on f{from}");
    }
    scenario(&text)
}

fn is(input: &RtiInput, kind: &str) -> bool {
    matches!(input, RtiInput::Frame { frame, .. } if frame.name() == kind)
}

/// The inputs of an RTI while all federates run: between the last one's readiness and the first end.
struct Tape {
    /// The RTI when it begins.
    rti: Rti,
    inputs: Vec<RtiInput>,
}

impl Tape {
    fn cut(mut rti: Rti, mut inputs: Vec<RtiInput>) -> Self {
        let is = |input: &RtiInput, kind: &str| matches!(input, RtiInput::Frame { frame, .. } if frame.name() == kind);
        let end = inputs.iter().position(|input| is(input, "Resign"));
        inputs.truncate(end.expect("some federate ends"));
        let ready = inputs.iter().rposition(|input| is(input, "Ready")).expect("all get ready");
        for input in inputs.drain(..=ready) {
            rti.handle(PhysicalTime(0), input).expect("it was accepted before");
        }
        while rti.poll().is_some() {}
        Self { rti, inputs }
    }

    /// Replays the inputs. Returns how many frames the RTI sends, how many are grants, and the time.
    fn replay(&self) -> (usize, usize, Duration) {
        let (mut rti, inputs) = (self.rti.clone(), self.inputs.clone());
        let mut outputs = Vec::with_capacity(inputs.len() * 2);
        let begun = Instant::now();
        for input in inputs {
            rti.handle(PhysicalTime(0), input).expect("it was accepted before");
            outputs.extend(std::iter::from_fn(|| rti.poll()));
        }
        let time = begun.elapsed();
        let is_grant = |output: &&RtiOutput| {
            matches!(output, RtiOutput::Send { frame: Frame::TagAdvanceGrant { .. }, .. })
        };
        (outputs.len(), outputs.iter().filter(is_grant).count(), time)
    }
}

fn row(shape: &str, size: usize) -> String {
    let tags = if size < 1_000 { 40 } else { 10 };
    let program = program(shape, size, tags);
    let plan = Plan { latency: Latency { jitter: 300, ..Latency::default() }, ..Plan::default() };
    let world = World::new(&program, Rng::new(1), plan);
    let (rti, inputs) = world.record().expect("no fault is planned");
    let tape = Tape::cut(rti, inputs);
    let begun = Instant::now();
    let (sent, grants, mut time) = tape.replay();
    while begun.elapsed() < ENOUGH {
        time = time.min(tape.replay().2);
    }
    let completed = tape.inputs.iter().filter(|input| is(input, "LatestTagConfirmed")).count();
    format!(
        "{shape:<12} {size:>9} {:>10.2} {:>10.2} {:>10.2} {:>11.2} {:>11.2}",
        ratio(tape.inputs.len(), completed),
        ratio(sent, completed),
        ratio(grants, completed),
        micros(time, grants.max(1)),
        micros(time, tape.inputs.len()),
    )
}

#[expect(clippy::cast_precision_loss, reason = "there are few frames")]
fn ratio(part: usize, whole: usize) -> f64 {
    part as f64 / whole.max(1) as f64
}

fn micros(time: Duration, count: usize) -> f64 {
    let count = u32::try_from(count).expect("there are fewer frames than that");
    (time / count).as_secs_f64() * 1e6
}

#[expect(clippy::print_stdout, reason = "a benchmark prints its result")]
fn main() {
    println!(
        "             federates  in / tag  out / tag  grants / tag  us / grant  us / frame in"
    );
    for shape in ["chain", "one to all", "all to one", "random"] {
        for size in SIZES {
            println!("{}", row(shape, size));
        }
    }
}
