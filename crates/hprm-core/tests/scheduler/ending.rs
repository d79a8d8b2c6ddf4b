//! Where a program ends: after a request to stop, and when nothing is left to happen.

use std::sync::Arc;

use crate::common::{START, at, on, run};
use hprm_core::{
    ActionId, Connection, Delay, Direction, Effect, FederateId, ModalElement, Nanos, Origin,
    Policy, PortId, Program, ProgramBuilder, Properties, ReactionSpec, ReactorId, Scheduled,
    Scheduler, Scope, Spacing, Tag, Trigger,
};

fn effects(triggers: &[Trigger], effects: &[Effect]) -> ReactionSpec {
    ReactionSpec { effects: effects.to_vec(), ..on(triggers) }
}

/// A federate with an action that drops what comes within 10 of the event before.
fn spaced() -> (Arc<Program>, ActionId) {
    let mut b = ProgramBuilder::new("Main", Properties::default());
    let reactor = b.reactor(b.main(), "a");
    b.federate(reactor, "a", Nanos::MAX, None);
    let action = b.action(reactor, "act", Origin::Logical, 0);
    b.space(action, Spacing { min: 10, policy: Policy::Drop });
    let calls = [Effect::Action(action)];
    b.reaction(reactor, effects(&[Trigger::Startup, Trigger::Action(action)], &calls));
    (Arc::new(b.build().unwrap()), action)
}

#[test]
fn what_becomes_of_an_action_does_not_depend_on_when_the_end_is_known() {
    // Schedules for 20 and 25 at tag zero, and is told before, between or after that it ends at 3.
    let answers = |told: usize| {
        let (program, action) = spaced();
        let mut scheduler = Scheduler::<i64>::new(program, Scope::Federate(FederateId(0)));
        scheduler.start(START);
        scheduler.begin(Tag::START);
        let (reaction, _) = scheduler.next_reaction(START).unwrap();
        let mut answers = Vec::new();
        for (number, offset) in [20, 25].into_iter().enumerate() {
            if told == number {
                scheduler.set_stop(Tag::new(3, 0));
            }
            answers.push(scheduler.schedule(action, offset, None, START));
        }
        scheduler.finish(reaction);
        assert!(!scheduler.end(START));
        scheduler.set_stop(Tag::new(3, 0));
        assert_eq!(scheduler.next_tag(), Tag::new(3, 0));
        assert_eq!(scheduler.next_event(), Tag::FOREVER, "nothing happens at its last tag");
        scheduler.begin(Tag::new(3, 0));
        assert_eq!(scheduler.next_reaction(START), None);
        assert!(scheduler.end(START));
        answers
    };
    let expected = [Scheduled::At(Tag::new(20, 0)), Scheduled::Dropped];
    for told in 0..3 {
        assert_eq!(answers(told), expected, "told at {told}");
    }
}

#[test]
fn a_federate_that_leaves_takes_what_no_reaction_reads_with_it() {
    let Unread { mut b, out, ports: [inp, _], inner } = unread();
    b.connect(out, inp, Delay::Time(5));
    let timer = b.timer(inner, "t", 3, 0);
    b.reaction(inner, on(&[Trigger::Timer(timer)]));
    let log = run(b.build().unwrap(), |scheduler, reaction| {
        if reaction.0 == 0 {
            scheduler.set(out, 1);
            scheduler.leave();
        }
    });
    let expected = [at(0, 0, "Main.a.1"), at(0, 1, "Main.a.2"), at(3, 0, "Main.b.inner.1")];
    assert_eq!(log, expected);
}

#[test]
fn what_waits_for_the_last_tag_happens_and_what_is_later_does_not() {
    let mut b = ProgramBuilder::new("Main", Properties::default());
    let main = b.main();
    let timer = b.timer(main, "t", 0, 1);
    let [next, later] = [0, 1].map(|delay| b.action(main, "a", Origin::Logical, delay));
    let calls = [next, later].map(Effect::Action);
    b.reaction(main, effects(&[Trigger::Timer(timer)], &calls)); // 1
    b.reaction(main, on(&[Trigger::Action(next)])); // 2
    b.reaction(main, on(&[Trigger::Action(later)])); // 3
    b.reaction(main, on(&[Trigger::Shutdown])); // 4
    let log = run(b.build().unwrap(), |scheduler, reaction| {
        if reaction.0 == 0 {
            scheduler.request_stop();
            scheduler.schedule(next, 0, None, START);
            scheduler.schedule(later, 0, None, START);
        }
    });
    assert_eq!(log, [at(0, 0, "Main.1"), at(0, 1, "Main.2"), at(0, 1, "Main.4")]);
}

/// `a.out -> b.inp` and `b.inp -> b.inner.inp`, each perhaps with a delay. No reaction reads.
struct Unread {
    b: ProgramBuilder,
    out: PortId,
    inner: ReactorId,
    ports: [PortId; 2],
}

fn unread() -> Unread {
    let mut b = ProgramBuilder::new("Main", Properties::default());
    let [source, sink] = ["a", "b"].map(|name| b.reactor(b.main(), name));
    for (reactor, name) in [(source, "a"), (sink, "b")] {
        b.federate(reactor, name, Nanos::MAX, None);
    }
    let inner = b.reactor(sink, "inner");
    let out = b.port(source, "out", Direction::Output);
    let ports = [sink, inner].map(|reactor| b.port(reactor, "inp", Direction::Input));
    b.reaction(source, effects(&[Trigger::Startup], &[Effect::Port(out)]));
    b.reaction(source, on(&[Trigger::Shutdown]));
    Unread { b, out, inner, ports }
}

/// The last tag of a program whose first reaction sets a port at the start: in one process, and what
/// the federate of that reaction waits for.
fn ends(program: Program, out: PortId) -> (Tag, Tag) {
    let log = run(program.clone(), |scheduler, reaction| {
        if reaction.0 == 0 {
            scheduler.set(out, 1);
        }
    });
    let (time, microstep, _) = log.last().unwrap().clone();
    let mut federate = Scheduler::new(Arc::new(program), Scope::Federate(FederateId(0)));
    federate.start(START);
    federate.begin(Tag::START);
    let (reaction, _) = federate.next_reaction(START).unwrap();
    federate.set(out, 1_i64);
    federate.finish(reaction);
    federate.end(START);
    assert_eq!(federate.poll_outbound(), None, "what is not read is not sent");
    let mut last = Tag::START;
    while federate.next_event() < Tag::FOREVER {
        last = federate.next_event();
        federate.begin(last);
        federate.end(START);
    }
    (Tag::new(time, microstep), last)
}

#[test]
fn a_message_that_no_reaction_reads_is_waited_for_in_every_deployment() {
    for (delays, expected) in [
        ([Delay::None, Delay::None], Tag::START),
        ([Delay::Time(5), Delay::None], Tag::new(5, 0)),
        ([Delay::None, Delay::Time(3)], Tag::new(3, 0)),
        ([Delay::Time(5), Delay::Time(3)], Tag::new(8, 0)),
        ([Delay::Microstep, Delay::Microstep], Tag::new(0, 2)),
    ] {
        let Unread { mut b, out, ports: [inp, inner], .. } = unread();
        b.connect(out, inp, delays[0]);
        b.connect(inp, inner, delays[1]);
        assert_eq!(ends(b.build().unwrap(), out), (expected.succ(), expected), "{delays:?}");
    }
}

#[test]
fn a_message_that_is_read_elsewhere_arrives_as_ever() {
    let Unread { mut b, out, inner, ports: [inp, _] } = unread();
    b.connect(out, inp, Delay::Time(5));
    let other = b.port(inner, "other", Direction::Input);
    b.connect(out, other, Delay::Time(2));
    b.reaction(inner, on(&[Trigger::Port(other)]));
    let log = run(b.build().unwrap(), |scheduler, reaction| {
        if reaction.0 == 0 {
            scheduler.set(out, 1);
        }
    });
    let expected = [at(0, 0, "Main.a.1"), at(2, 0, "Main.b.inner.1"), at(5, 1, "Main.a.2")];
    assert_eq!(log, expected);
}

#[test]
fn in_a_mode_what_no_reaction_reads_counts_for_nothing() {
    let Unread { mut b, out, inner, ports: [inp, last] } = unread();
    b.connect(out, inp, Delay::Time(5));
    let connection = b.connect(inp, last, Delay::Time(3));
    let mode = b.mode(inner, "only", true);
    b.put_in_mode(ModalElement::Connection(connection), mode);
    assert_eq!(ends(b.build().unwrap(), out), (Tag::new(5, 1), Tag::new(5, 0)));
}

#[test]
fn an_end_that_the_clock_decides_on_is_said_to_be_physical() {
    for physical in [false, true] {
        let Unread { mut b, out, ports: [inp, _], .. } = unread();
        b.connection(Connection {
            from: out,
            to: inp,
            delay: Delay::Time(5),
            physical,
            serializer: None,
            absent_after: 0,
            compress: false,
            bound: None,
            mode: None,
        });
        let mut scheduler = Scheduler::new(Arc::new(b.build().unwrap()), Scope::Whole);
        scheduler.start_recording();
        scheduler.start(START);
        let mut last = false;
        while !last {
            scheduler.begin(scheduler.next_tag());
            while let Some((reaction, _)) = scheduler.next_reaction(START) {
                if scheduler.tag() == Tag::START {
                    scheduler.set(out, 1_i64);
                }
                scheduler.finish(reaction);
            }
            last = scheduler.end(START.plus(1));
        }
        let end = if physical { Tag::new(6, 1) } else { Tag::new(5, 1) };
        assert_eq!((scheduler.tag(), scheduler.stops_physically()), (end, physical));
    }
}
