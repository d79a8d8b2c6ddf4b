//! A federate that leaves while the rest of its program goes on, all in one scheduler.

use crate::common::{START, at, on, run};
use hprm_core::{
    Delay, Direction, Effect, Nanos, PortId, Program, ProgramBuilder, Properties, ReactionSpec,
    Scheduled, Scheduler, Scope, Tag, Trigger,
};

/// `a` sends to `b` with a delay of 15, and `b` to `a` with one of 5. Both have a timer of 10, and
/// `b`, too, sends at the end.
fn pair(timeout: Option<Nanos>) -> Program {
    let properties = Properties { timeout, ..Properties::default() };
    let mut b = ProgramBuilder::new("Main", properties);
    let mut ends = Vec::new();
    for name in ["a", "b"] {
        let reactor = b.reactor(b.main(), name);
        let input = b.port(reactor, "in", Direction::Input);
        let output = b.port(reactor, "out", Direction::Output);
        let timer = b.timer(reactor, "t", 0, if timeout.is_some() { 10 } else { 0 });
        for trigger in [Trigger::Timer(timer), Trigger::Port(input), Trigger::Shutdown] {
            let effects = vec![Effect::Port(output)];
            b.reaction(reactor, ReactionSpec { effects, ..on(&[trigger]) });
        }
        b.federate(reactor, name, Nanos::MAX, None);
        ends.push((input, output));
    }
    b.connect(ends[0].1, ends[1].0, Delay::Time(15));
    b.connect(ends[1].1, ends[0].0, Delay::Time(5));
    b.build().unwrap()
}

fn output(program: &Program, federate: &str) -> PortId {
    let name = format!("Main.{federate}.out");
    program.ports.ids().find(|port| program.port_name(*port) == name).unwrap()
}

#[test]
fn it_stops_at_the_next_microstep_and_what_it_has_sent_arrives() {
    let program = pair(Some(30));
    let (a_out, b_out) = (output(&program, "a"), output(&program, "b"));
    let log = run(program.clone(), |scheduler, reaction| {
        match scheduler.program().reaction_name(reaction).as_str() {
            "Main.a.1" if scheduler.tag().time == 10 => scheduler.leave(),
            "Main.a.3" => _ = scheduler.set(a_out, 1),
            // It would arrive at 15, when the other federate has left.
            "Main.b.1" => _ = scheduler.set(b_out, 2),
            _ => {}
        }
    });
    let expected = [
        at(0, 0, "Main.a.1"),
        at(0, 0, "Main.b.1"),
        at(5, 0, "Main.a.2"),
        at(10, 0, "Main.a.1"),
        at(10, 0, "Main.b.1"),
        at(10, 1, "Main.a.3"),
        at(20, 0, "Main.b.1"),
        at(25, 0, "Main.b.2"),
        at(30, 0, "Main.b.1"),
        at(30, 0, "Main.b.3"),
    ];
    assert_eq!(log, expected);
}

#[test]
fn the_program_ends_after_the_last_that_leaves() {
    let log = run(pair(Some(30)), |scheduler, reaction| {
        match scheduler.program().reaction_name(reaction).as_str() {
            "Main.a.1" | "Main.b.1" if scheduler.tag().time == 10 => scheduler.leave(),
            _ => {}
        }
    });
    assert_eq!(log[4..], [at(10, 1, "Main.a.3"), at(10, 1, "Main.b.3")]);
}

#[test]
fn a_program_in_which_nothing_is_left_ends_after_a_departure() {
    let log = run(pair(None), |scheduler, reaction| {
        if scheduler.program().reaction_name(reaction) == "Main.a.1" {
            scheduler.leave();
        }
    });
    assert_eq!(log[2..], [at(0, 1, "Main.a.3"), at(0, 2, "Main.b.3")]);
}

#[test]
fn nothing_is_scheduled_where_a_federate_ends() {
    let mut b = ProgramBuilder::new("Main", Properties::default());
    let mut actions = Vec::new();
    for name in ["a", "b"] {
        let reactor = b.reactor(b.main(), name);
        let action = b.action(reactor, "x", hprm_core::Origin::Logical, 10);
        let effects = vec![Effect::Action(action)];
        let triggers = on(&[Trigger::Startup, Trigger::Shutdown, Trigger::Action(action)]);
        b.reaction(reactor, ReactionSpec { effects, ..triggers });
        b.federate(reactor, name, Nanos::MAX, None);
        actions.push(action);
    }
    let mut outcomes = Vec::new();
    let log = run(b.build().unwrap(), |scheduler, reaction| {
        let (tag, name) = (scheduler.tag(), scheduler.program().reaction_name(reaction));
        match (name.as_str(), tag.microstep) {
            ("Main.a.1", 0) => {
                // Before that is known, as in the scheduler of one federate.
                scheduler.leave();
                outcomes.push(scheduler.schedule(actions[0], 0, None, START));
            }
            ("Main.a.1", 1) => outcomes.push(scheduler.schedule(actions[0], 0, None, START)),
            ("Main.b.1", 0) if tag == Tag::START => {
                scheduler.schedule(actions[1], 0, None, START);
            }
            _ => {}
        }
    });
    assert_eq!(outcomes, [Scheduled::At(Tag::new(10, 0)), Scheduled::AfterStop]);
    let ends = [at(0, 1, "Main.a.1"), at(10, 0, "Main.b.1"), at(10, 1, "Main.b.1")];
    assert_eq!(log[2..], ends);
}

#[test]
fn the_scheduler_of_one_federate_asks_to_leave_and_sends_beyond_its_end() {
    let program = std::sync::Arc::new(pair(Some(100)));
    let me = program.federate_named("a").unwrap();
    let out = output(&program, "a");
    let mut scheduler = Scheduler::new(program, Scope::Federate(me));
    scheduler.start(START);
    let mut reactions = 0;
    let mut sent = Vec::new();
    loop {
        let tag = scheduler.next_tag();
        scheduler.begin(tag);
        while let Some((reaction, _)) = scheduler.next_reaction(START) {
            scheduler.set(out, 1);
            scheduler.leave();
            scheduler.finish(reaction);
            reactions += 1;
        }
        let last = scheduler.end(START);
        sent.extend(std::iter::from_fn(|| scheduler.poll_outbound()).map(|message| message.tag));
        if last {
            break;
        }
        assert!(scheduler.take_departure() && !scheduler.take_departure());
        scheduler.leave_at(Tag::START);
    }
    assert_eq!((reactions, scheduler.tag()), (2, Tag::new(0, 1)));
    assert_eq!(sent, [Tag::new(15, 0), Tag::new(15, 1)]);
    assert!(scheduler.leaves_early());
}

/// Others rely on the next event that it has told them, also if it ends before that.
#[test]
fn a_last_tag_before_the_next_event_makes_no_earlier_event() {
    let mut b = ProgramBuilder::new("Main", Properties::default());
    let [a, other] = ["a", "b"].map(|name| b.reactor(b.main(), name));
    let out = b.port(a, "out", Direction::Output);
    let timer = b.timer(a, "t", 0, 20);
    let effects = vec![Effect::Port(out)];
    b.reaction(a, ReactionSpec { effects, ..on(&[Trigger::Timer(timer)]) });
    let not_read = b.port(other, "inp", Direction::Input);
    b.connect(out, not_read, Delay::Time(5));
    for (reactor, name) in [(a, "a"), (other, "b")] {
        b.federate(reactor, name, Nanos::MAX, None);
    }
    let program = std::sync::Arc::new(b.build().unwrap());
    let me = program.federate_named("a").unwrap();
    let mut scheduler = Scheduler::new(program, Scope::Federate(me));
    scheduler.start(START);
    scheduler.begin(Tag::START);
    let (reaction, _) = scheduler.next_reaction(START).unwrap();
    scheduler.set(out, 1_i64);
    scheduler.finish(reaction);
    scheduler.end(START);
    assert_eq!(scheduler.next_event(), Tag::new(20, 0));
    scheduler.leave_at(Tag::new(10, 0));
    assert_eq!(scheduler.next_event(), Tag::FOREVER);
    assert_eq!(scheduler.next_tag(), Tag::new(10, 0));
}
