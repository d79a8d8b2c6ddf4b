//! The rules of the reactor model, each by a small program that runs without waiting.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use crate::common::{START, at, on, run};
use hprm_core::{
    Body, Delay, Direction, Effect, FederateId, Nanos, Origin, PortId, Program, ProgramBuilder,
    Properties, ReactionId, ReactionSpec, Scheduled, Scheduler, Scope, Tag, Trigger,
};

fn timeout(nanos: Nanos) -> Properties {
    Properties { timeout: Some(nanos), ..Properties::default() }
}

#[test]
fn a_timer_fires_at_its_offset_and_periodically_up_to_the_timeout() {
    let mut b = ProgramBuilder::new("Main", timeout(20));
    let timer = b.timer(b.main(), "t", 0, 10);
    b.reaction(b.main(), on(&[Trigger::Startup]));
    b.reaction(b.main(), on(&[Trigger::Timer(timer)]));
    b.reaction(b.main(), on(&[Trigger::Shutdown]));
    assert_eq!(
        run(b.build().unwrap(), |_, _| {}),
        [
            at(0, 0, "Main.1"),
            at(0, 0, "Main.2"),
            at(10, 0, "Main.2"),
            at(20, 0, "Main.2"),
            at(20, 0, "Main.3"),
        ]
    );
}

#[test]
fn a_timer_without_period_fires_once() {
    let mut b = ProgramBuilder::new("Main", Properties::default());
    let timer = b.timer(b.main(), "t", 5, 0);
    b.reaction(b.main(), on(&[Trigger::Timer(timer)]));
    b.reaction(b.main(), on(&[Trigger::Shutdown]));
    assert_eq!(
        run(b.build().unwrap(), |_, _| {}),
        [at(5, 0, "Main.1"), at(5, 1, "Main.2")],
        "and the program ends one microstep after its last event"
    );
}

#[test]
fn with_a_timeout_of_zero_everything_happens_at_the_start() {
    let mut b = ProgramBuilder::new("Main", timeout(0));
    b.reaction(b.main(), on(&[Trigger::Startup]));
    b.reaction(b.main(), on(&[Trigger::Shutdown]));
    assert_eq!(run(b.build().unwrap(), |_, _| {}), [at(0, 0, "Main.1"), at(0, 0, "Main.2")]);
}

#[test]
fn a_reaction_runs_once_at_a_tag_whatever_triggers_it() {
    let mut b = ProgramBuilder::new("Main", timeout(0));
    let timer = b.timer(b.main(), "t", 0, 0);
    b.reaction(b.main(), on(&[Trigger::Startup, Trigger::Timer(timer), Trigger::Shutdown]));
    assert_eq!(run(b.build().unwrap(), |_, _| {}), [at(0, 0, "Main.1")]);
}

#[test]
fn request_stop_ends_at_the_next_microstep() {
    let mut b = ProgramBuilder::new("Main", Properties::default());
    let timer = b.timer(b.main(), "t", 0, 1);
    let reaction = b.reaction(b.main(), on(&[Trigger::Timer(timer)]));
    b.reaction(b.main(), on(&[Trigger::Shutdown]));
    let log = run(b.build().unwrap(), |scheduler, id| {
        if id == reaction && scheduler.tag().time == 2 {
            scheduler.request_stop();
        }
    });
    assert_eq!(log[2..], [at(2, 0, "Main.1"), at(2, 1, "Main.2")]);
}

#[test]
fn a_program_that_is_stopped_before_it_starts_has_one_tag() {
    let mut b = ProgramBuilder::new("Main", Properties::default());
    b.reaction(b.main(), on(&[Trigger::Startup]));
    b.reaction(b.main(), on(&[Trigger::Shutdown]));
    let mut scheduler = Scheduler::<i64>::new(Arc::new(b.build().unwrap()), Scope::Whole);
    scheduler.request_stop();
    scheduler.start(START);
    assert_eq!(scheduler.next_tag(), Tag::START);
    scheduler.begin(Tag::START);
    for _ in 0..2 {
        let (reaction, _) = scheduler.next_reaction(START).unwrap();
        scheduler.finish(reaction);
    }
    assert!(scheduler.end(START));
}

#[test]
fn logical_actions_add_their_minimum_delay_and_pile_up() {
    let mut b = ProgramBuilder::new("Main", Properties::default());
    let action = b.action(b.main(), "a", Origin::Logical, 10);
    let start = b.reaction(
        b.main(),
        ReactionSpec { effects: vec![Effect::Action(action)], ..on(&[Trigger::Startup]) },
    );
    b.reaction(b.main(), on(&[Trigger::Action(action)]));
    let mut seen = Vec::new();
    run(b.build().unwrap(), |scheduler, id| {
        if id == start {
            for value in [1, 2] {
                scheduler.schedule(action, 5, Some(value), START);
            }
            scheduler.schedule(action, -3, None, START);
        } else {
            seen.push((scheduler.tag(), scheduler.action(action).unwrap().copied()));
        }
    });
    assert_eq!(
        seen,
        [(Tag::new(10, 0), None), (Tag::new(15, 0), Some(1)), (Tag::new(15, 1), Some(2))]
    );
}

#[test]
fn an_action_without_delay_is_one_microstep_away() {
    let mut b = ProgramBuilder::new("Main", timeout(7));
    let action = b.action(b.main(), "a", Origin::Logical, 0);
    b.reaction(
        b.main(),
        ReactionSpec { effects: vec![Effect::Action(action)], ..on(&[Trigger::Startup]) },
    );
    let mut answers = Vec::new();
    run(b.build().unwrap(), |scheduler, _| {
        answers.push(scheduler.schedule(action, 0, None, START));
        answers.push(scheduler.schedule(action, 7, None, START));
        answers.push(scheduler.schedule(action, 7, None, START));
    });
    assert_eq!(
        answers,
        [Scheduled::At(Tag::new(0, 1)), Scheduled::At(Tag::new(7, 0)), Scheduled::AfterStop,],
        "the last one would have piled up beyond the end"
    );
}

#[test]
fn a_physical_action_has_the_time_of_the_clock() {
    let mut b = ProgramBuilder::new("Main", timeout(100));
    let action = b.action(b.main(), "a", Origin::Physical, 3);
    b.reaction(b.main(), on(&[Trigger::Startup]));
    let mut answer = None;
    run(b.build().unwrap(), |scheduler, _| {
        answer = Some(scheduler.schedule(action, 1, None, START.plus(20)));
    });
    assert_eq!(answer, Some(Scheduled::At(Tag::new(24, 0))));
}

/// `source.out -> sink.inp` with a delay; the source sets its microstep index at (0,0), (0,1), (5,0).
fn pipe(delay: Delay) -> (Program, ReactionId, PortId) {
    let mut b = ProgramBuilder::new("Main", Properties::default());
    let [source, sink] = ["source", "sink"].map(|name| b.reactor(b.main(), name));
    let out = b.port(source, "out", Direction::Output);
    let inp = b.port(sink, "inp", Direction::Input);
    let action = b.action(source, "a", Origin::Logical, 0);
    b.connect(out, inp, delay);
    let send = b.reaction(
        source,
        ReactionSpec {
            effects: vec![Effect::Port(out), Effect::Action(action)],
            ..on(&[Trigger::Startup, Trigger::Action(action)])
        },
    );
    b.reaction(sink, on(&[Trigger::Port(inp)]));
    (b.build().unwrap(), send, inp)
}

fn arrivals(delay: Delay) -> Vec<(Tag, i64)> {
    let (program, send, inp) = pipe(delay);
    let action = hprm_core::ActionId(0);
    let out = PortId(0);
    let mut count = 0;
    let mut seen = Vec::new();
    run(program, |scheduler, id| {
        if id != send {
            seen.push((scheduler.tag(), *scheduler.port(inp).unwrap()));
            return;
        }
        scheduler.set(out, -1);
        assert_eq!(scheduler.set(out, count), Some(-1), "the last value wins");
        match count {
            0 => _ = scheduler.schedule(action, 0, None, START),
            1 => _ = scheduler.schedule(action, 5, None, START),
            _ => {}
        }
        count += 1;
    });
    seen
}

#[test]
fn connections_delay() {
    let none = [(Tag::new(0, 0), 0), (Tag::new(0, 1), 1), (Tag::new(5, 0), 2)];
    assert_eq!(arrivals(Delay::None), none);
    let microstep = [(Tag::new(0, 1), 0), (Tag::new(0, 2), 1), (Tag::new(5, 1), 2)];
    assert_eq!(arrivals(Delay::Microstep), microstep);
    let time = [(Tag::new(3, 0), 0), (Tag::new(3, 1), 1), (Tag::new(8, 0), 2)];
    assert_eq!(arrivals(Delay::Time(3)), time, "two messages for one tag pile up");
}

#[test]
fn ports_are_absent_again_at_the_next_tag() {
    let (program, send, inp) = pipe(Delay::None);
    let timer_free = run(program, |scheduler, id| {
        assert!(scheduler.port(inp).is_none() || id != send);
        if id == send {
            scheduler.set(PortId(0), 1);
        }
    });
    assert_eq!(timer_free.len(), 2);
}

#[test]
fn levels_order_what_is_connected_and_the_program_orders_the_rest() {
    let mut b = ProgramBuilder::new("Main", timeout(0));
    let names = ["last", "first", "between"];
    let [last, first, between] = names.map(|name| b.reactor(b.main(), name));
    let a = b.port(first, "out", Direction::Output);
    let b_in = b.port(between, "inp", Direction::Input);
    let b_out = b.port(between, "out", Direction::Output);
    let c = b.port(last, "inp", Direction::Input);
    b.connect(a, b_in, Delay::None);
    b.connect(b_out, c, Delay::None);
    b.reaction(last, on(&[Trigger::Startup, Trigger::Port(c)]));
    let effects = vec![Effect::Port(a)];
    b.reaction(first, ReactionSpec { effects, ..on(&[Trigger::Startup]) });
    let effects = vec![Effect::Port(b_out)];
    b.reaction(between, ReactionSpec { effects, ..on(&[Trigger::Port(b_in)]) });
    let log = run(b.build().unwrap(), |scheduler, id| match id {
        ReactionId(1) => _ = scheduler.set(a, 1),
        ReactionId(2) => _ = scheduler.set(b_out, 2),
        _ => assert_eq!(scheduler.port(c), Some(&2)),
    });
    let names: Vec<_> = log.iter().map(|(_, _, name)| name.as_str()).collect();
    assert_eq!(names, ["Main.first.1", "Main.between.1", "Main.last.1"]);
}

#[test]
fn a_value_reaches_many_readers_once_each_in_their_order() {
    let mut b = ProgramBuilder::new("Main", timeout(1));
    let main = b.main();
    let timer = b.timer(main, "t", 0, 1);
    let outs = ["even", "all"].map(|name| b.port(main, name, Direction::Output));
    let effects = outs.map(Effect::Port).to_vec();
    b.reaction(main, ReactionSpec { effects, ..on(&[Trigger::Timer(timer)]) });
    let readers: Vec<_> = (0..150)
        .map(|index| {
            let reads = if index % 2 == 0 { outs.as_slice() } else { &outs[1..] };
            b.reaction(main, on(&reads.iter().copied().map(Trigger::Port).collect::<Vec<_>>()))
        })
        .collect();
    let program = b.build().unwrap();
    let expected: Vec<_> = readers.iter().map(|reader| program.reaction_name(*reader)).collect();
    let log = run(program, |scheduler, id| {
        // Only the first of them at the second tag.
        let set = if scheduler.tag() == Tag::START { &outs[..] } else { &outs[..1] };
        if id == ReactionId(0) {
            set.iter().for_each(|out| _ = scheduler.set(*out, 1));
        }
    });
    let at_tag = |time| log.iter().filter(move |entry| entry.0 == time).map(|entry| &entry.2);
    assert!(at_tag(0).skip(1).eq(&expected));
    assert!(at_tag(1).skip(1).eq(expected.iter().step_by(2)));
}

#[test]
fn a_deadline_handler_runs_instead_when_physical_time_is_ahead() {
    let mut b = ProgramBuilder::new("Main", timeout(0));
    b.reaction(b.main(), ReactionSpec { deadline: Some(0), ..on(&[Trigger::Startup]) });
    b.reaction(b.main(), ReactionSpec { deadline: Some(1), ..on(&[Trigger::Startup]) });
    assert_eq!(
        run(b.build().unwrap(), |_, _| {}),
        [at(0, 0, "Main.1 deadline"), at(0, 0, "Main.2")],
        "a deadline of zero is always missed"
    );
}

/// Federate `b` of `a.out -> b.inp -> b.out ~ nothing`.
fn receiver(handles_tardy: bool) -> (Arc<Program>, FederateId) {
    let mut b = ProgramBuilder::new(
        "Main",
        Properties { keepalive: true, timeout: Some(1_000), ..Properties::default() },
    );
    let [source, sink] = ["a", "b"].map(|name| b.reactor(b.main(), name));
    let [_, receiver] =
        [(source, "a"), (sink, "b")].map(|(r, name)| b.federate(r, name, Nanos::MAX, None));
    let out = b.port(source, "out", Direction::Output);
    let inp = b.port(sink, "inp", Direction::Input);
    b.connect(out, inp, Delay::None);
    b.reaction(
        source,
        ReactionSpec { effects: vec![Effect::Port(out)], ..on(&[Trigger::Startup]) },
    );
    b.reaction(sink, ReactionSpec { handles_tardy, ..on(&[Trigger::Port(inp)]) });
    (Arc::new(b.build().unwrap()), receiver)
}

#[test]
fn a_tardy_message_runs_the_handler_at_the_next_free_tag() {
    let channel = hprm_core::ChannelId(0);
    for (handles, body, unhandled) in
        [(true, Body::Tardy, None), (false, Body::Main, Some(Tag::new(2, 0)))]
    {
        let (program, me) = receiver(handles);
        let mut scheduler = Scheduler::new(program, Scope::Federate(me));
        scheduler.start(START);
        scheduler.begin(Tag::START);
        scheduler.end(START);
        scheduler.deliver(channel, Tag::new(5, 0), 1_i64, false);
        assert_eq!(scheduler.next_tag(), Tag::new(5, 0));
        scheduler.begin(Tag::new(5, 0));
        assert_eq!(scheduler.deliver(channel, Tag::new(2, 0), 2, false), Some(Tag::new(5, 1)));
        assert_eq!(scheduler.deliver(channel, Tag::new(3, 0), 3, false), Some(Tag::new(5, 2)));
        let (on_time, which) = scheduler.next_reaction(START).unwrap();
        assert_eq!(which, Body::Main);
        assert_eq!(scheduler.unhandled_tardy(), None);
        scheduler.finish(on_time);
        scheduler.end(START);
        scheduler.begin(Tag::new(5, 1));
        let (_, which) = scheduler.next_reaction(START).unwrap();
        assert_eq!(which, body);
        assert_eq!(scheduler.unhandled_tardy(), unhandled);
        assert_eq!(scheduler.intended_tag(PortId(1)), Some(Tag::new(2, 0)));
    }
}

#[test]
fn a_tardy_message_cannot_be_delivered_after_the_last_tag() {
    let channel = hprm_core::ChannelId(0);
    let (program, me) = receiver(true);
    let [before, last] = [Tag::new(999, 0), Tag::new(1_000, 0)];
    let mut scheduler = Scheduler::new(program, Scope::Federate(me));
    scheduler.start(START);
    scheduler.begin(Tag::START);
    scheduler.end(START);
    scheduler.deliver(channel, before, 1_i64, false);
    scheduler.begin(before);
    while let Some((reaction, _)) = scheduler.next_reaction(START) {
        scheduler.finish(reaction);
    }
    scheduler.end(START);
    // A tag is left for it.
    assert_eq!(scheduler.deliver(channel, Tag::new(998, 0), 2, false), Some(before.succ()));
    assert_eq!(scheduler.deliver(channel, last, 3, false), Some(last));
    assert_eq!(scheduler.next_tag(), before.succ());
    for tag in [before.succ(), last] {
        scheduler.begin(tag);
        while let Some((reaction, _)) = scheduler.next_reaction(START) {
            scheduler.finish(reaction);
        }
        scheduler.end(START);
    }
    assert_eq!(scheduler.deliver(channel, last, 4, false), None);
}

#[test]
fn what_comes_before_a_late_starter_has_started_happens_at_its_first_tag() {
    let (channel, first) = (hprm_core::ChannelId(0), Tag::new(700, 0));
    let late = || {
        let (program, me) = receiver(true);
        let mut scheduler = Scheduler::<i64>::new(program, Scope::Federate(me));
        scheduler.start_late(START, first);
        scheduler
    };
    let mut physical = late();
    assert_eq!(physical.deliver_physical(channel, START.plus(650), 1), Some(first));
    physical.begin(first);
    assert_eq!(physical.next_reaction(START).map(|(_, body)| body), Some(Body::Main));

    let mut logical = late();
    assert_eq!(logical.deliver(channel, Tag::new(650, 0), 1, false), Some(first));
    logical.begin(first);
    assert_eq!(logical.next_reaction(START).map(|(_, body)| body), Some(Body::Tardy));
    assert_eq!(logical.intended_tag(PortId(1)), Some(Tag::new(650, 0)));
}

#[test]
fn a_federate_sends_and_asks_to_stop_but_does_not_stop_by_itself() {
    let (program, _) = receiver(false);
    let mut scheduler = Scheduler::new(program, Scope::Federate(FederateId(0)));
    scheduler.start(START);
    scheduler.begin(Tag::START);
    let (reaction, _) = scheduler.next_reaction(START).unwrap();
    scheduler.set(PortId(0), 7_i64);
    scheduler.request_stop();
    scheduler.finish(reaction);
    assert!(!scheduler.end(START));
    let message = scheduler.poll_outbound().unwrap();
    assert_eq!((message.tag, message.value), (Tag::START, 7));
    assert!(scheduler.take_stop_request() && !scheduler.take_stop_request());
    assert_eq!(scheduler.next_tag(), Tag::new(1_000, 0));
    scheduler.set_stop(Tag::new(0, 1));
    assert_eq!(scheduler.next_tag(), Tag::new(0, 1));
}

/// A value that counts how often it is cloned.
struct Counted(Arc<AtomicU32>);

impl Clone for Counted {
    fn clone(&self) -> Self {
        self.0.fetch_add(1, Ordering::Relaxed);
        Self(Arc::clone(&self.0))
    }
}

#[test]
fn a_value_for_one_receiver_is_not_cloned() {
    let (program, _) = receiver(false);
    let clones = Arc::new(AtomicU32::new(0));
    let mut scheduler = Scheduler::new(program, Scope::Federate(FederateId(0)));
    scheduler.start(START);
    scheduler.begin(Tag::START);
    let (reaction, _) = scheduler.next_reaction(START).unwrap();
    scheduler.set(PortId(0), Counted(Arc::clone(&clones)));
    scheduler.finish(reaction);
    assert!(!scheduler.end(START));
    assert!(scheduler.poll_outbound().is_some_and(|it| Arc::ptr_eq(&it.value.0, &clones)));
    assert_eq!(clones.load(Ordering::Relaxed), 0);
}
