//! Several workers: what they run at the same time, and that nothing of it shows.

use std::sync::mpsc::{self, Receiver, channel};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use hprm::prelude::*;
use proptest::prelude::*;

/// Far longer than anything here takes.
const PATIENCE: Duration = Duration::from_secs(60);

/// How much one reactor does.
const ENOUGH: usize = 100;

fn properties(workers: u32) -> Properties {
    let timeout = Some(40);
    Properties { fast: true, timeout, workers: Some(workers), ..Properties::default() }
}

/// A reactor of a random program.
#[derive(Clone, Debug)]
struct Node {
    /// The outputs that it reads, by index, each with a delay in nanoseconds. Without one, only
    /// those of reactors before it count.
    reads: Vec<(usize, Option<u64>)>,
    period: u64,
    spacing: Option<Policy>,
}

fn nodes() -> impl Strategy<Value = Vec<Node>> {
    let policy = prop_oneof![
        Just(Policy::Defer),
        Just(Policy::Drop),
        Just(Policy::Replace),
        Just(Policy::Update),
    ];
    let read = (0_usize..12, prop::option::weighted(0.4, 0_u64..4));
    let node = (prop::collection::vec(read, 0..4), 0_u64..7, prop::option::of(policy))
        .prop_map(|(reads, period, spacing)| Node { reads, period, spacing });
    prop::collection::vec(node, 1..12)
}

/// What one reactor saw and did, in order.
type Log = Arc<Mutex<Vec<String>>>;

/// What a reactor does depends on all that it has seen, so a difference spreads.
struct State {
    seen: u64,
    log: Log,
}

impl State {
    fn see(&mut self, value: u64) -> u64 {
        self.seen = (self.seen ^ value).wrapping_mul(0x0100_0000_01b3);
        self.seen >> 16
    }
}

fn assemble(
    reactor: &mut ReactorBuilder<'_, State>,
    node: &Node,
    inputs: usize,
) -> (Vec<InputPort<u64>>, OutputPort<u64>) {
    let inputs = reactor.inputs("inp", inputs);
    let out = reactor.output("out");
    let ns = Duration::from_nanos;
    let tick = reactor.timer("tick", ns(node.period), ns(node.period));
    let action = reactor.logical_action("act", Duration::ZERO);
    if let Some(policy) = node.spacing {
        reactor.space(action, Spacing { min: 3, policy });
    }
    reactor.reaction().on(tick).schedules(action).sets(out).run(move |state, ctx| {
        let chance = state.see(ctx.elapsed().as_nanos() as u64);
        ctx.schedule(action, ns(chance % 3), chance);
        if chance.is_multiple_of(5) {
            ctx.set(out, chance % 100);
            ctx.set(out, chance % 10);
        }
        if chance % 50 == 7 {
            ctx.request_stop();
        }
    });
    let reaction = reactor.reaction().on(action).on(&inputs).schedules(action).sets(out);
    let read = inputs.clone();
    reaction.run(move |state, ctx| {
        let values: Vec<_> = read.iter().map(|input| ctx.get(*input).copied()).collect();
        let (before, scheduled) = (ctx.get(out).copied(), ctx.get(action).copied());
        let text = format!("{} {values:?} {before:?} {scheduled:?}", ctx.tag());
        let mut log = state.log.lock().unwrap();
        log.push(text);
        // A program that feeds itself without a delay would never see the end of its time.
        if log.len() > ENOUGH {
            return;
        }
        drop(log);
        let chance = values.iter().flatten().fold(state.seen, |all, value| all ^ value);
        let chance = state.see(chance ^ scheduled.unwrap_or(99));
        if !chance.is_multiple_of(3) {
            ctx.set(out, chance % 1_000);
            assert_eq!(ctx.get(out), Some(&(chance % 1_000)));
        }
        if chance.is_multiple_of(4) {
            ctx.schedule(action, ns(chance % 7), chance % 11);
        }
    });
    (inputs, out)
}

/// What all reactors saw.
fn run(nodes: &[Node], workers: u32) -> Vec<Vec<String>> {
    let mut program = Program::new("Main").properties(properties(workers));
    let logs: Vec<_> = nodes.iter().map(|_| Log::default()).collect();
    let mut ends: Vec<(Vec<InputPort<u64>>, OutputPort<u64>)> = Vec::new();
    let mut connections = Vec::new();
    for (i, node) in nodes.iter().enumerate() {
        let state = State { seen: i as u64, log: Arc::clone(&logs[i]) };
        let reads: Vec<_> = node
            .reads
            .iter()
            .map(|(from, delay)| (from % nodes.len(), *delay))
            .filter(|(from, delay)| delay.is_some() || *from < i)
            .collect();
        ends.push(
            program.reactor(&format!("node[{i}]"), state, |r| assemble(r, node, reads.len())),
        );
        connections.extend(reads.into_iter().zip(0..).map(|(read, input)| (i, input, read)));
    }
    for (to, input, (from, delay)) in connections {
        let (out, inp) = (ends[from].1, ends[to].0[input]);
        match delay {
            Some(nanos) => _ = program.connect(out, inp).after(Duration::from_nanos(nanos)),
            None => _ = program.connect(out, inp),
        }
    }
    program.run().unwrap();
    logs.iter().map(|log| log.lock().unwrap().clone()).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn the_number_of_workers_does_not_show(nodes in nodes()) {
        let alone = run(&nodes, 1);
        prop_assert_eq!(&alone, &run(&nodes, 2));
        prop_assert_eq!(&alone, &run(&nodes, 8));
    }
}

/// One reaction to the start for each body, in reactors of their own.
fn side_by_side(
    workers: u32,
    bodies: Vec<Box<dyn FnMut() -> Result<(), String> + Send>>,
) -> Program {
    let mut program = Program::new("Main").properties(properties(workers));
    for (i, mut body) in bodies.into_iter().enumerate() {
        program.reactor(&format!("r[{i}]"), (), |reactor| {
            reactor.reaction().on(Startup).run(move |(), _| body());
        });
    }
    program
}

/// Signals the other reaction, then waits for the signal of that one.
fn meet(sender: &mpsc::Sender<()>, receiver: &Receiver<()>) {
    sender.send(()).unwrap();
    receiver.recv_timeout(PATIENCE).unwrap();
}

#[test]
fn reactions_of_one_level_run_at_the_same_time() {
    let ((to_a, from_b), (to_b, from_a)) = (channel(), channel());
    let (mut a, mut b) = (Some((to_b, from_b)), Some((to_a, from_a)));
    let bodies: Vec<Box<dyn FnMut() -> Result<(), String> + Send>> = vec![
        Box::new(move || a.take().map(|(to, from)| meet(&to, &from)).ok_or_else(String::new)),
        Box::new(move || b.take().map(|(to, from)| meet(&to, &from)).ok_or_else(String::new)),
    ];
    side_by_side(2, bodies).run().unwrap();
}

#[test]
fn of_two_failures_the_first_in_the_program_counts() {
    let (failed, later) = channel::<()>();
    let mut failed = Some(failed);
    let bodies: Vec<Box<dyn FnMut() -> Result<(), String> + Send>> = vec![
        Box::new(move || {
            // The other one has dropped its end.
            assert!(later.recv_timeout(PATIENCE).is_err());
            Err("first".to_owned())
        }),
        Box::new(move || {
            drop(failed.take());
            Err("second".to_owned())
        }),
    ];
    let failure = side_by_side(2, bodies).run().unwrap_err();
    assert_eq!(failure.to_string(), "reaction Main.r[0].1 failed at (0 ns, 0): first");
}

#[test]
#[should_panic(expected = "the first panic")]
fn of_two_panics_the_first_in_the_program_counts() {
    let bodies: Vec<Box<dyn FnMut() -> Result<(), String> + Send>> = vec![
        Box::new(|| Ok(())),
        Box::new(|| panic!("the first panic")),
        Box::new(|| panic!("the second panic")),
        Box::new(|| Ok(())),
    ];
    let _ = side_by_side(3, bodies).run();
}

#[test]
fn a_deadline_that_a_reaction_changes_is_in_force_at_once() {
    let mut program = Program::new("Main").properties(properties(2));
    for name in ["a", "b"] {
        program.reactor(name, 0, |reactor| {
            let tick = reactor.timer("tick", Duration::ZERO, Duration::from_nanos(30));
            reactor
                .reaction()
                .on(tick)
                .deadline(PATIENCE, |late, ctx| {
                    assert_eq!(ctx.elapsed().as_nanos(), 30);
                    *late += 1;
                })
                .run(|_, ctx| {
                    assert!(!ctx.misses_deadline());
                    ctx.set_deadline(Duration::ZERO);
                    assert!(ctx.misses_deadline());
                });
            reactor.reaction().on(Shutdown).run(|late, _| assert_eq!(*late, 1));
        });
    }
    program.run().unwrap();
}

#[test]
fn as_many_workers_as_processors() {
    let program = side_by_side(0, vec![Box::new(|| Ok(())), Box::new(|| Ok(()))]);
    program.run().unwrap();
}
