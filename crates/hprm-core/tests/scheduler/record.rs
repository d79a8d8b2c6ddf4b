//! What the scheduler records of reactions, and how the mark of the physical world spreads.

use std::sync::Arc;

use hprm_core::{
    ActionId, Body, ChannelId, Connection, Delay, Direction, Effect, FederateId, InputId,
    InputValue, ModalElement, Nanos, Origin, PhysicalTime, PortId, Program, ProgramBuilder,
    Properties, ReactionId, ReactionRecord, ReactionSpec, ReactorId, ScheduleRequest, Scheduled,
    Scheduler, Scope, Tag, Transition, Trigger,
};

/// The physical time of tag zero.
const START: PhysicalTime = PhysicalTime(1_000_000);

/// A reaction that has triggers and nothing else.
fn on(triggers: &[Trigger]) -> ReactionSpec {
    ReactionSpec { triggers: triggers.to_vec(), ..ReactionSpec::default() }
}

fn properties(timeout: i64) -> Properties {
    Properties { timeout: Some(timeout), ..Properties::default() }
}

/// Runs a program to its end and returns what was recorded. `before` is called for each tag.
fn record(
    program: Program,
    mut before: impl FnMut(&mut Scheduler<i64>),
    mut body: impl FnMut(&mut Scheduler<i64>, &str),
) -> Vec<ReactionRecord<i64>> {
    let mut scheduler = Scheduler::new(Arc::new(program), Scope::Whole);
    scheduler.start_recording();
    scheduler.start(START);
    let mut records = Vec::new();
    loop {
        before(&mut scheduler);
        let tag = scheduler.next_tag();
        scheduler.begin(tag);
        while let Some((reaction, _)) = scheduler.next_reaction(tag.due(START)) {
            let name = scheduler.program().reaction_name(reaction);
            body(&mut scheduler, &name);
            assert_eq!(
                scheduler.poll_record(),
                None,
                "a record is there when its reaction is done"
            );
            scheduler.finish(reaction);
            records.extend(scheduler.poll_record());
        }
        if scheduler.end(tag.due(START)) {
            return records;
        }
    }
}

/// Which records are marked, in order.
fn marks(records: &[ReactionRecord<i64>]) -> Vec<(i64, u32, bool)> {
    records.iter().map(|r| (r.tag.time, r.reaction.0, r.physical)).collect()
}

fn with_effects(triggers: &[Trigger], effects: &[Effect]) -> ReactionSpec {
    ReactionSpec { effects: effects.to_vec(), ..on(triggers) }
}

/// A reactor that sets its output to the value of its input.
fn relay(b: &mut ProgramBuilder, name: &str) -> (ReactorId, PortId, PortId) {
    let reactor = b.reactor(b.main(), name);
    let input = b.port(reactor, "in", Direction::Input);
    let output = b.port(reactor, "out", Direction::Output);
    b.reaction(reactor, with_effects(&[Trigger::Port(input)], &[Effect::Port(output)]));
    (reactor, input, output)
}

#[test]
fn a_record_has_all_that_a_reaction_did() {
    let mut b = ProgramBuilder::new("Main", properties(10));
    let source = b.reactor(b.main(), "source");
    let [first, second] = ["a", "b"].map(|name| b.port(source, name, Direction::Output));
    let action = b.action(source, "act", Origin::Logical, 3);
    let effects = [Effect::Port(first), Effect::Port(second), Effect::Action(action)];
    b.reaction(source, with_effects(&[Trigger::Startup], &effects));
    b.reaction(source, on(&[Trigger::Action(action)]));
    let records = record(
        b.build().unwrap(),
        |_| {},
        |scheduler, reaction| {
            if reaction == "Main.source.1" {
                scheduler.set(second, 1);
                scheduler.set(first, 2);
                scheduler.set(second, 3);
                scheduler.schedule(action, 0, Some(4), START);
                scheduler.schedule(action, 100, None, START);
            } else {
                scheduler.request_stop();
            }
        },
    );
    let empty = ReactionRecord {
        tag: Tag::START,
        reaction: ReactionId(0),
        body: Body::Main,
        tardy: None,
        physical: false,
        ports: Vec::new(),
        actions: Vec::new(),
        modes: Vec::new(),
        stops: false,
        leaves: false,
    };
    let outcome = Scheduled::At(Tag::new(3, 0));
    let actions = vec![
        ScheduleRequest { action, value: Some(4), outcome },
        ScheduleRequest { action, value: None, outcome: Scheduled::AfterStop },
    ];
    let first = ReactionRecord { ports: vec![(first, 2), (second, 3)], actions, ..empty.clone() };
    let second =
        ReactionRecord { tag: Tag::new(3, 0), reaction: ReactionId(1), stops: true, ..empty };
    assert_eq!(records, [first, second]);
}

#[test]
fn a_reaction_finds_its_triggers_and_sources_as_they_are_when_it_begins() {
    let mut b = ProgramBuilder::new("Main", properties(5));
    let source = b.reactor(b.main(), "source");
    let [one, two] = ["one", "two"].map(|name| b.port(source, name, Direction::Output));
    let action = b.action(source, "act", Origin::Logical, 5);
    let effects = [Effect::Port(one), Effect::Port(two), Effect::Action(action)];
    b.reaction(source, with_effects(&[Trigger::Startup], &effects));
    let sink = b.reactor(b.main(), "sink");
    let inputs = ["a", "b", "absent"].map(|name| b.port(sink, name, Direction::Input));
    b.connect(one, inputs[0], Delay::None);
    b.connect(two, inputs[1], Delay::None);
    // A source may be a trigger, too.
    let reads = |port| ReactionSpec { sources: inputs.to_vec(), ..on(&[Trigger::Port(port)]) };
    let reader = b.reaction(sink, reads(inputs[1]));
    let later = b.reaction(source, ReactionSpec { ..on(&[Trigger::Action(action)]) });
    let mut scheduler = Scheduler::new(Arc::new(b.build().unwrap()), Scope::Whole);
    scheduler.keep(inputs[0], 7);
    scheduler.start(START);
    scheduler.begin(Tag::START);
    let (reaction, _) = scheduler.next_reaction(START).unwrap();
    assert_eq!(scheduler.inputs(reaction), []);
    scheduler.set(two, 2);
    scheduler.schedule(action, 0, None, START);
    scheduler.finish(reaction);
    let found = |input, value, remembered| InputValue { input, value, remembered };
    let kept = found(InputId::Port(inputs[0]), Some(&7), true);
    let present = found(InputId::Port(inputs[1]), Some(&2), false);
    assert_eq!(scheduler.inputs(reader), [kept, present]);
    let (reaction, _) = scheduler.next_reaction(START).unwrap();
    scheduler.finish(reaction);
    scheduler.end(START);
    scheduler.begin(Tag::new(5, 0));
    assert_eq!(scheduler.inputs(later), [found(InputId::Action(action), None, false)]);
}

#[test]
fn nothing_is_recorded_unless_recording_is_on() {
    let mut b = ProgramBuilder::new("Main", properties(0));
    b.reaction(b.main(), on(&[Trigger::Startup]));
    let mut scheduler = Scheduler::<i64>::new(Arc::new(b.build().unwrap()), Scope::Whole);
    scheduler.start(START);
    scheduler.begin(Tag::START);
    let (reaction, _) = scheduler.next_reaction(START).unwrap();
    scheduler.mark_physical();
    scheduler.finish(reaction);
    assert_eq!(scheduler.poll_record(), None);
}

/// A sensor with a physical action and a timer, and the receivers of both.
fn sensing() -> (Program, ActionId, [PortId; 2]) {
    let mut b = ProgramBuilder::new("Main", properties(30));
    let sensor = b.reactor(b.main(), "sensor");
    let [sensed, ticked] = ["sensed", "ticked"].map(|name| b.port(sensor, name, Direction::Output));
    let action = b.action(sensor, "detect", Origin::Physical, 0);
    let timer = b.timer(sensor, "t", 0, 10);
    b.reaction(sensor, with_effects(&[Trigger::Action(action)], &[Effect::Port(sensed)])); // 0
    b.reaction(sensor, with_effects(&[Trigger::Timer(timer)], &[Effect::Port(ticked)])); // 1
    let (_, sensed_in, _) = relay(&mut b, "of_sensed"); // 2
    b.connect(sensed, sensed_in, Delay::Time(2));
    let (_, ticked_in, _) = relay(&mut b, "of_ticked"); // 3
    b.connect(ticked, ticked_in, Delay::None);
    (b.build().unwrap(), action, [sensed, ticked])
}

#[test]
fn a_physical_event_marks_what_may_have_seen_it() {
    let (program, action, [sensed, ticked]) = sensing();
    let detected = |scheduler: &mut Scheduler<i64>| {
        if scheduler.tag() == Tag::START {
            scheduler.schedule(action, 0, None, START.plus(15));
        }
    };
    let records = record(program, detected, |scheduler, reaction| match reaction {
        "Main.sensor.1" => _ = scheduler.set(sensed, 1),
        "Main.sensor.2" => _ = scheduler.set(ticked, 2),
        _ => {}
    });
    let expected = [
        (0, 1, false),
        (0, 3, false),
        (10, 1, false),
        (10, 3, false),
        (15, 0, true), // the event itself
        (17, 2, true), // its message
        (20, 1, true), // the state of the reactor that had it
        (20, 3, true),
        (30, 1, true),
        (30, 3, true),
    ];
    assert_eq!(marks(&records), expected);
}

#[test]
fn reading_the_clock_marks_the_reaction_once_and_what_it_sets_from_then_on() {
    let mut b = ProgramBuilder::new("Main", properties(10));
    let source = b.reactor(b.main(), "source");
    let [early, late] = ["early", "late"].map(|name| b.port(source, name, Direction::Output));
    let timer = b.timer(source, "t", 0, 10);
    let effects = [Effect::Port(early), Effect::Port(late)];
    b.reaction(source, with_effects(&[Trigger::Timer(timer)], &effects)); // 0
    for (output, name) in [(early, "of_early"), (late, "of_late")] {
        let (_, input, _) = relay(&mut b, name); // 1, 2
        b.connect(output, input, Delay::None);
    }
    let records = record(
        b.build().unwrap(),
        |_| {},
        |scheduler, reaction| {
            if reaction == "Main.source.1" && scheduler.tag() == Tag::START {
                scheduler.set(early, 1);
                scheduler.mark_physical();
                scheduler.set(late, 2);
            }
        },
    );
    let expected = [(0, 0, true), (0, 1, false), (0, 2, true), (10, 0, false)];
    assert_eq!(marks(&records), expected);
}

#[test]
fn a_physical_connection_marks_its_messages() {
    let mut b = ProgramBuilder::new("Main", properties(10));
    let source = b.reactor(b.main(), "source");
    let output = b.port(source, "out", Direction::Output);
    b.reaction(source, with_effects(&[Trigger::Startup], &[Effect::Port(output)]));
    let (_, input, _) = relay(&mut b, "sink");
    b.connection(Connection {
        from: output,
        to: input,
        delay: Delay::None,
        physical: true,
        serializer: None,
        absent_after: 0,
        compress: false,
        bound: None,
        mode: None,
    });
    let records = record(
        b.build().unwrap(),
        |_| {},
        |scheduler, reaction| {
            if reaction == "Main.source.1" {
                scheduler.set(output, 1);
            }
        },
    );
    assert_eq!(records.iter().map(|r| r.physical).collect::<Vec<_>>(), [false, true]);
}

#[test]
fn a_mode_that_a_physical_event_has_entered_marks_all_inside() {
    let mut b = ProgramBuilder::new("Main", properties(20));
    let modal = b.reactor(b.main(), "modal");
    let [first, second] = [b.mode(modal, "first", true), b.mode(modal, "second", false)];
    let action = b.action(modal, "detect", Origin::Physical, 0);
    b.reaction(modal, on(&[Trigger::Action(action)])); // 0
    let inside = b.reactor(modal, "inside");
    b.put_in_mode(ModalElement::Reactor(inside), second);
    let timer = b.timer(inside, "t", 0, 10);
    b.reaction(inside, on(&[Trigger::Timer(timer)])); // 1
    let beside = b.reactor(b.main(), "beside");
    let timer = b.timer(beside, "t", 0, 10);
    b.reaction(beside, on(&[Trigger::Timer(timer)])); // 2
    let detected = |scheduler: &mut Scheduler<i64>| {
        if scheduler.tag() == Tag::START {
            scheduler.schedule(action, 0, None, START.plus(5));
        }
    };
    let records = record(b.build().unwrap(), detected, |scheduler, reaction| {
        if reaction == "Main.modal.1" {
            scheduler.enter(second, Transition::Reset);
            assert!(scheduler.is_active(first));
        }
    });
    let expected = [(0, 2, false), (5, 0, true), (5, 1, true), (10, 2, false), (15, 1, true)];
    assert_eq!(marks(&records)[..5], expected);
    assert_eq!(records[1].modes, [(second, Transition::Reset)]);
}

#[test]
fn the_mark_travels_with_a_message_to_another_federate() {
    let mut b = ProgramBuilder::new("Main", properties(10));
    let source = b.reactor(b.main(), "source");
    let output = b.port(source, "out", Direction::Output);
    b.reaction(source, with_effects(&[Trigger::Startup], &[Effect::Port(output)]));
    let (sink, input, _) = relay(&mut b, "sink");
    b.connect(output, input, Delay::Time(5));
    for (reactor, name) in [(source, "source"), (sink, "sink")] {
        b.federate(reactor, name, Nanos::MAX, None);
    }
    let program = Arc::new(b.build().unwrap());
    let of = |federate| Scheduler::new(Arc::clone(&program), Scope::Federate(FederateId(federate)));
    let (mut sender, mut receiver) = (of(0), of(1));
    for scheduler in [&mut sender, &mut receiver] {
        scheduler.start_recording();
        scheduler.start(START);
        scheduler.begin(Tag::START);
    }
    let (reaction, _) = sender.next_reaction(START).unwrap();
    sender.mark_physical();
    sender.set(output, 1_i64);
    sender.finish(reaction);
    sender.end(START);
    receiver.end(START);
    let message = sender.poll_outbound().unwrap();
    assert!(message.physical);
    receiver.deliver(ChannelId(0), message.tag, message.value, message.physical);
    receiver.begin(message.tag);
    let (reaction, _) = receiver.next_reaction(START).unwrap();
    receiver.finish(reaction);
    assert!(receiver.poll_record().unwrap().physical);
}

#[test]
fn an_end_that_the_physical_world_asked_for_is_known_as_such() {
    for (physical, expected) in [(false, false), (true, true)] {
        let mut b = ProgramBuilder::new("Main", Properties::default());
        b.reaction(b.main(), on(&[Trigger::Startup]));
        let mut scheduler = Scheduler::<i64>::new(Arc::new(b.build().unwrap()), Scope::Whole);
        scheduler.start_recording();
        scheduler.start(START);
        scheduler.begin(Tag::START);
        let (reaction, _) = scheduler.next_reaction(START).unwrap();
        if physical {
            scheduler.mark_physical();
        }
        scheduler.request_stop();
        scheduler.finish(reaction);
        assert_eq!(scheduler.stops_physically(), expected);
    }
}
