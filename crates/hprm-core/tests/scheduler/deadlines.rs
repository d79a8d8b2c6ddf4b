//! Deadlines: when they count as missed, how they change, and what they do to the order of
//! reactions.

use std::sync::Arc;

use hprm_core::{
    Body, Delay, Direction, Effect, Nanos, PhysicalTime, Program, ProgramBuilder, Properties,
    ReactionId, ReactionSpec, Scheduler, Scope, Tag, Trigger,
};

const START: PhysicalTime = PhysicalTime(1_000_000);

/// A reaction to a timer with period ten, whose deadline is `declared`.
fn periodic(declared: Option<Nanos>) -> Scheduler<()> {
    let mut b = ProgramBuilder::new("Main", Properties::default());
    let timer = b.timer(b.main(), "t", 0, 10);
    let triggers = vec![Trigger::Timer(timer)];
    b.reaction(b.main(), ReactionSpec { triggers, deadline: declared, ..ReactionSpec::default() });
    let mut scheduler = Scheduler::new(Arc::new(b.build().unwrap()), Scope::Whole);
    scheduler.start(START);
    scheduler
}

/// Which body runs at the next tag, `lag` after it. While it runs, the deadline may change.
fn react(scheduler: &mut Scheduler<()>, lag: Nanos, change: Option<Nanos>) -> Body {
    let tag = scheduler.next_tag();
    scheduler.begin(tag);
    let now = tag.due(START).plus(lag);
    let (reaction, body) = scheduler.next_reaction(now).unwrap();
    if let Some(deadline) = change {
        scheduler.set_deadline(reaction, deadline);
    }
    scheduler.finish(reaction);
    scheduler.end(now);
    body
}

#[test]
fn a_deadline_that_has_been_changed_holds_until_the_next_change() {
    let mut scheduler = periodic(Some(5));
    assert_eq!(react(&mut scheduler, 5, None), Body::Main);
    assert_eq!(react(&mut scheduler, 5, Some(3)), Body::Main);
    assert_eq!(react(&mut scheduler, 5, None), Body::Deadline);
    assert_eq!(react(&mut scheduler, 5, Some(0)), Body::Deadline, "a handler may change it too");
    assert_eq!(react(&mut scheduler, 0, Some(Nanos::MAX)), Body::Deadline);
    assert_eq!(react(&mut scheduler, 1_000, None), Body::Main);
}

#[test]
fn it_changes_while_the_reaction_runs() {
    let mut scheduler = periodic(Some(5));
    scheduler.begin(Tag::START);
    let (reaction, _) = scheduler.next_reaction(START).unwrap();
    let later = START.plus(4);
    assert!(!scheduler.misses_deadline(reaction, later));
    scheduler.set_deadline(reaction, 3);
    assert!(scheduler.misses_deadline(reaction, later));
}

#[test]
fn a_reaction_without_a_handler_always_runs_its_body() {
    let mut scheduler = periodic(None);
    assert!(!scheduler.misses_deadline(ReactionId(0), PhysicalTime::FOREVER));
    assert_eq!(react(&mut scheduler, 0, Some(3)), Body::Main);
    assert!(scheduler.misses_deadline(ReactionId(0), START.plus(4)));
    assert_eq!(react(&mut scheduler, 100, None), Body::Main);
}

/// Five reactors, of which `first` feeds `urgent` through `relay`, and `delayed` through a delay.
/// Returns what runs at the start, where all but the last two have something to do.
fn order(deadlines_first: bool) -> (Vec<String>, Program) {
    let properties = Properties { deadlines_first, ..Properties::default() };
    let mut b = ProgramBuilder::new("Main", properties);
    let names = ["idle", "lax", "first", "relay", "urgent", "delayed"];
    let [idle, lax, first, relay, urgent, delayed] = names.map(|name| b.reactor(b.main(), name));
    let out = b.port(first, "out", Direction::Output);
    let into = b.port(relay, "inp", Direction::Input);
    let onward = b.port(relay, "out", Direction::Output);
    let last = b.port(urgent, "inp", Direction::Input);
    let later = b.port(delayed, "inp", Direction::Input);
    b.connect(out, into, Delay::None);
    b.connect(onward, last, Delay::None);
    b.connect(onward, later, Delay::Time(5));
    let startup = || vec![Trigger::Startup];
    let plain = |triggers, deadline| ReactionSpec { triggers, deadline, ..Default::default() };
    b.reaction(idle, plain(startup(), None));
    b.reaction(lax, plain(startup(), Some(50)));
    b.reaction(
        first,
        ReactionSpec { effects: vec![Effect::Port(out)], ..plain(vec![Trigger::Startup], None) },
    );
    b.reaction(
        relay,
        ReactionSpec {
            effects: vec![Effect::Port(onward)],
            ..plain(vec![Trigger::Port(into)], Some(40))
        },
    );
    b.reaction(urgent, plain(vec![Trigger::Port(last)], Some(20)));
    b.reaction(delayed, plain(vec![Trigger::Port(later)], Some(1)));
    let program = b.build().unwrap();
    let mut scheduler = Scheduler::new(Arc::new(program.clone()), Scope::Whole);
    scheduler.start(START);
    scheduler.begin(Tag::START);
    let mut log = Vec::new();
    while let Some((reaction, _)) = scheduler.next_reaction(START) {
        log.push(program.reaction_name(reaction).replace("Main.", ""));
        for effect in &program.reactions[reaction].effects {
            if let Effect::Port(port) = effect {
                scheduler.set(*port, 0);
            }
        }
        scheduler.finish(reaction);
    }
    (log, program)
}

#[test]
fn what_precedes_a_deadline_inherits_it_but_not_through_a_delay() {
    let (_, program) = order(false);
    let inferred: Vec<_> = program.reactions.values().map(|r| r.inferred_deadline).collect();
    assert_eq!(inferred, [Nanos::MAX, 50, 20, 20, 20, 1]);
}

#[test]
fn a_deadlines_first_program_runs_first_what_leads_to_the_tightest_deadline() {
    let (by_level, _) = order(false);
    assert_eq!(by_level, ["idle.1", "lax.1", "first.1", "relay.1", "urgent.1"]);
    let (by_deadline, _) = order(true);
    assert_eq!(by_deadline, ["first.1", "relay.1", "urgent.1", "lax.1", "idle.1"]);
}
