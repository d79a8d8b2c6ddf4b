//! Once it has warmed up, a program in one process allocates nothing: a longer run makes as many
//! allocations as a shorter one.

use std::sync::Arc;
use std::time::Duration;

use allocation_counter::measure;
use hprm::prelude::*;
use hprm::{Host, Inbox, run_whole};
use hprm_core::{
    ActionId, Body, ChannelId, Delay, Direction, Effect, Nanos, Origin, Payload, PortId,
    ProgramBuilder, ReactionId, ReactionSpec, Reading, Scheduler, Trigger,
};
use hprm_store::{Object, StoreAllocator};

/// Sets the ports and schedules the actions that each reaction declares.
struct Everything {
    program: Arc<hprm_core::Program>,
    runs: u64,
}

impl Host for Everything {
    type Value = u64;

    fn react(
        &mut self,
        scheduler: &mut Scheduler<u64>,
        reaction: ReactionId,
        _: Body,
    ) -> Result<(), Failure> {
        self.runs += 1;
        let now = scheduler.tag().due(scheduler.start_time());
        for effect in &self.program.reactions[reaction].effects {
            match effect {
                Effect::Port(port) => _ = scheduler.set(*port, self.runs),
                Effect::Action(action) => {
                    scheduler.schedule(*action, 0, Some(self.runs), now);
                }
                Effect::Mode(mode, transition) => scheduler.enter(*mode, *transition),
            }
        }
        Ok(())
    }

    fn encode(
        &mut self,
        _: &StoreAllocator,
        _: ChannelId,
        _: &u64,
        _: bool,
    ) -> Result<Payload, Failure> {
        unreachable!("there is no network")
    }

    fn receive(
        &mut self,
        _: ChannelId,
        _: Payload,
        _: Vec<Object>,
        _: impl Reading,
        _: bool,
    ) -> Result<u64, Failure> {
        unreachable!("there is no network")
    }

    fn warn(&mut self, message: &str) {
        panic!("{message}");
    }
}

/// Three timers of different periods, an action, and a pipe with and without a delay.
fn program(timeout: Nanos, fast: bool) -> Arc<hprm_core::Program> {
    let properties = Properties { timeout: Some(timeout), fast, ..Properties::default() };
    let mut b = ProgramBuilder::new("Main", properties);
    let [source, sink] = ["source", "sink"].map(|name| b.reactor(b.main(), name));
    let [direct, delayed] =
        ["direct", "delayed"].map(|name| b.port(source, name, Direction::Output));
    let [now, later] = ["now", "later"].map(|name| b.port(sink, name, Direction::Input));
    b.connect(direct, now, Delay::None);
    b.connect(delayed, later, Delay::Time(15));
    let action: ActionId = b.action(source, "a", Origin::Logical, 7);
    for period in [10, 20, 35] {
        let timer = b.timer(source, "t", 0, period);
        let triggers = vec![Trigger::Timer(timer)];
        let effects = vec![Effect::Port(direct), Effect::Port(delayed), Effect::Action(action)];
        b.reaction(source, ReactionSpec { triggers, effects, ..ReactionSpec::default() });
    }
    let on = |triggers: &[Trigger]| ReactionSpec {
        triggers: triggers.to_vec(),
        ..ReactionSpec::default()
    };
    b.reaction(source, on(&[Trigger::Action(action)]));
    let either = |ports: [PortId; 2]| ports.map(Trigger::Port);
    b.reaction(sink, on(&either([now, later])));
    Arc::new(b.build().unwrap())
}

/// How many allocations a whole run makes, and how many reactions.
fn allocations(timeout: Nanos, fast: bool) -> (u64, u64) {
    let program = program(timeout, fast);
    let inbox = Inbox::new().unwrap();
    let mut host = Everything { program: Arc::clone(&program), runs: 0 };
    let counted = measure(|| run_whole(&program, &mut host, &inbox).unwrap());
    (counted.count_total, host.runs)
}

#[test]
fn a_steady_program_allocates_nothing() {
    let (short, few) = allocations(1_000, true);
    let (long, many) = allocations(1_000_000, true);
    assert!(short > 0 && many > 900 * few, "{short} allocations, {few} and {many} reactions");
    assert_eq!(short, long, "allocations of {few} and of {many} reactions");
}

#[test]
fn waiting_for_physical_time_allocates_nothing() {
    let (short, few) = allocations(1_000, false);
    let (long, many) = allocations(100_000, false);
    assert!(many > 90 * few);
    assert_eq!(short, long, "allocations of {few} and of {many} reactions");
}

/// A value of eight words, and one that is larger.
type Small = (u64, f64, [u64; 6]);
type Large = [u64; 20];

/// How many allocations a program in Rust makes: a timer and an action, a direct and a delayed connection, with values
/// of this type.
fn allocations_with<T: Message + Copy>(value: T, timeout: Duration) -> u64 {
    let mut program = Program::new("Main").fast().timeout(timeout);
    let outs = program.reactor("source", (), |source| {
        let tick = source.timer("tick", Duration::ZERO, Duration::from_nanos(10));
        let outs = source.outputs::<T>("out", 2);
        let action = source.logical_action::<T>("act", Duration::from_nanos(3));
        let all = [outs[0], outs[1]];
        source.reaction().on(tick).sets(&outs).schedules(action).run(move |(), ctx| {
            all.iter().for_each(|out| ctx.set(*out, value));
            ctx.schedule(action, Duration::ZERO, value);
        });
        source.reaction().on(action).run(move |(), ctx| assert!(ctx.get(action).is_some()));
        outs
    });
    let inputs = program.reactor("sink", (), |sink| {
        let inputs = sink.inputs::<T>("inp", 2);
        let all = [inputs[0], inputs[1]];
        sink.reaction().on(&inputs).run(move |(), ctx| assert!(ctx.present(&all).count() > 0));
        inputs
    });
    program.connect(outs[0], inputs[0]);
    program.connect(outs[1], inputs[1]).after(Duration::from_nanos(15));
    let program = program.build().unwrap();
    measure(|| program.run().unwrap()).count_total
}

#[test]
fn small_values_of_any_type_need_no_allocation() {
    // The first run leaves the thread boxes for the others.
    let [_, short, long] = [1, 1, 100]
        .map(|times| allocations_with::<Small>((1, 2.0, [3; 6]), times * Duration::from_micros(1)));
    assert_eq!(short, long);
}

#[test]
fn a_large_value_is_allocated_once_for_all_its_readers() {
    let [_, short, long] = [1, 1, 101]
        .map(|times| allocations_with::<Large>([7; 20], times * Duration::from_micros(1)));
    // 100 further microseconds have 10,000 ticks, each with two ports and an action.
    assert_eq!(long - short, 100 * 100 * 3);
}
