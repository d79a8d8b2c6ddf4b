//! Modes: what is active when, and what becomes of events while it is not.

use crate::common::{START, at, on, run};
use hprm_core::{
    Delay, Direction, Effect, ModalElement, ModeId, Nanos, Origin, PortId, ProgramBuilder,
    ProgramError, Properties, ReactionId, ReactionSpec, ReactorId, Transition, Trigger,
};

fn builder(timeout: Nanos) -> ProgramBuilder {
    let properties = Properties { timeout: Some(timeout), ..Properties::default() };
    ProgramBuilder::new("Main", properties)
}

/// Modes `a`, the initial one, and `b`.
fn two_modes(b: &mut ProgramBuilder, reactor: ReactorId) -> [ModeId; 2] {
    [b.mode(reactor, "a", true), b.mode(reactor, "b", false)]
}

/// A reaction in a mode.
fn reaction_in(
    b: &mut ProgramBuilder,
    mode: ModeId,
    reactor: ReactorId,
    on: Trigger,
) -> ReactionId {
    let spec = ReactionSpec { triggers: vec![on], ..ReactionSpec::default() };
    let id = b.reaction(reactor, spec);
    b.put_in_mode(ModalElement::Reaction(id), mode);
    id
}

/// A timer in a mode, and a reaction to it.
fn timer_in(b: &mut ProgramBuilder, mode: ModeId, offset: Nanos, period: Nanos) -> ReactionId {
    let main = b.main();
    let timer = b.timer(main, "t", offset, period);
    b.put_in_mode(ModalElement::Timer(timer), mode);
    reaction_in(b, mode, main, Trigger::Timer(timer))
}

/// A reaction of the main reactor, outside its modes, at the given times.
fn at_times(b: &mut ProgramBuilder, times: &[Nanos]) -> ReactionId {
    let main = b.main();
    let triggers: Vec<_> =
        times.iter().map(|time| Trigger::Timer(b.timer(main, "at", *time, 0))).collect();
    b.reaction(main, on(&triggers))
}

/// Changes modes of the main reactor from outside at the given times, and logs the rest.
fn switching(
    mut b: ProgramBuilder,
    plan: &[(Nanos, ModeId, Transition)],
) -> Vec<(Nanos, u32, String)> {
    let times: Vec<_> = plan.iter().map(|(time, ..)| *time).collect();
    let switch = at_times(&mut b, &times);
    let program = b.build().unwrap();
    let name = program.reaction_name(switch);
    let log = run(program, |scheduler, reaction| {
        let now = scheduler.tag().time;
        for (_, mode, transition) in plan.iter().filter(|(time, ..)| *time == now) {
            if reaction == switch {
                scheduler.enter(*mode, *transition);
            }
        }
    });
    log.into_iter().filter(|(_, _, reaction)| *reaction != name).collect()
}

#[test]
fn a_timer_stands_still_while_its_mode_is_left() {
    let mut b = builder(100);
    let main = b.main();
    let [first, second] = two_modes(&mut b, main);
    timer_in(&mut b, first, 10, 20);
    // At 15 there are 15 left of the wait until 30.
    let plan = [(15, second, Transition::Reset), (50, first, Transition::History)];
    assert_eq!(
        switching(b, &plan),
        [at(10, 0, "Main.1"), at(65, 0, "Main.1"), at(85, 0, "Main.1"),]
    );
}

#[test]
fn of_many_readers_only_those_of_the_active_mode_run() {
    let mut b = builder(10);
    let main = b.main();
    let modes = two_modes(&mut b, main);
    let timer = b.timer(main, "t", 5, 0);
    let out = b.port(main, "out", Direction::Output);
    let effects = vec![Effect::Port(out)];
    let set = b.reaction(main, ReactionSpec { effects, ..on(&[Trigger::Timer(timer)]) });
    let readers: Vec<_> =
        (0..140).map(|i| reaction_in(&mut b, modes[i % 2], main, Trigger::Port(out))).collect();
    let program = b.build().unwrap();
    let active: Vec<_> =
        readers.iter().step_by(2).map(|reader| program.reaction_name(*reader)).collect();
    let log = run(program, |scheduler, reaction| {
        if reaction == set {
            scheduler.set(out, 1);
        }
    });
    assert!(log.iter().skip(1).map(|(_, _, name)| name).eq(&active));
}

#[test]
fn a_reset_starts_the_timers_of_a_mode_over() {
    let mut b = builder(80);
    let main = b.main();
    let [first, second] = two_modes(&mut b, main);
    timer_in(&mut b, first, 10, 20);
    timer_in(&mut b, second, 0, 10);
    let plan = [(15, second, Transition::Reset), (50, first, Transition::Reset)];
    assert_eq!(
        switching(b, &plan),
        [
            at(10, 0, "Main.1"),
            at(15, 1, "Main.2"),
            at(25, 0, "Main.2"),
            at(35, 0, "Main.2"),
            at(45, 0, "Main.2"),
            at(60, 0, "Main.1"),
            at(80, 0, "Main.1"),
        ]
    );
}

#[test]
fn a_reset_of_the_current_mode_leaves_its_timers_alone() {
    let mut b = builder(40);
    let main = b.main();
    let [first, _] = two_modes(&mut b, main);
    timer_in(&mut b, first, 10, 20);
    timer_in(&mut b, first, 5, 0);
    let plan = [(15, first, Transition::Reset)];
    assert_eq!(
        switching(b, &plan),
        [at(5, 0, "Main.2"), at(10, 0, "Main.1"), at(20, 0, "Main.2"), at(30, 0, "Main.1")],
        "but one that has ended starts again"
    );
}

#[test]
fn events_of_actions_wait_with_their_mode_or_are_forgotten() {
    for (transition, expected) in [
        (Transition::History, vec![at(0, 0, "Main.1"), at(70, 0, "Main.2")]),
        (Transition::Reset, vec![at(0, 0, "Main.1")]),
    ] {
        let mut b = builder(100);
        let main = b.main();
        let [first, second] = two_modes(&mut b, main);
        let action = b.action(main, "act", Origin::Logical, 30);
        b.put_in_mode(ModalElement::Action(action), first);
        let ask = reaction_in(&mut b, first, main, Trigger::Startup);
        reaction_in(&mut b, first, main, Trigger::Action(action));
        let switch = at_times(&mut b, &[10, 50]);
        let log = run(b.build().unwrap(), |scheduler, reaction| {
            if reaction == ask {
                let now = scheduler.tag().due(START);
                scheduler.schedule(action, 0, Some(1), now);
            } else if reaction == switch && scheduler.tag().time == 10 {
                scheduler.enter(second, Transition::Reset);
            } else if reaction == switch {
                scheduler.enter(first, transition);
            }
        });
        let log: Vec<_> = log.into_iter().filter(|(_, _, name)| name != "Main.3").collect();
        assert_eq!(log, expected);
    }
}

#[test]
fn what_is_scheduled_in_a_mode_that_is_not_active_waits_for_it() {
    let mut b = builder(100);
    let main = b.main();
    let [_, second] = two_modes(&mut b, main);
    let action = b.action(main, "act", Origin::Physical, 7);
    b.put_in_mode(ModalElement::Action(action), second);
    reaction_in(&mut b, second, main, Trigger::Action(action));
    let outside = at_times(&mut b, &[10, 50]);
    let log = run(b.build().unwrap(), |scheduler, reaction| {
        if reaction == outside && scheduler.tag().time == 10 {
            let now = scheduler.tag().due(START);
            let answer = scheduler.schedule(action, 0, Some(1), now);
            assert_eq!(answer, hprm_core::Scheduled::Suspended);
        } else if reaction == outside {
            scheduler.enter(second, Transition::History);
        }
    });
    assert_eq!(log, [at(10, 0, "Main.2"), at(50, 0, "Main.2"), at(57, 0, "Main.1")]);
}

#[test]
fn startup_runs_at_the_first_activity_and_shutdown_if_there_was_any() {
    let mut b = builder(60);
    let main = b.main();
    let [first, second] = two_modes(&mut b, main);
    let never = b.mode(main, "c", false);
    for mode in [first, second, never] {
        reaction_in(&mut b, mode, main, Trigger::Startup);
        reaction_in(&mut b, mode, main, Trigger::Shutdown);
    }
    let plan = [
        (10, second, Transition::History),
        (20, first, Transition::Reset),
        (30, second, Transition::Reset),
    ];
    assert_eq!(
        switching(b, &plan),
        [at(0, 0, "Main.1"), at(10, 1, "Main.3"), at(30, 1, "Main.2"), at(30, 1, "Main.4"),]
    );
}

#[test]
fn reset_reactions_run_when_their_mode_is_reset_and_only_then() {
    let mut b = builder(60);
    let main = b.main();
    let [first, second] = two_modes(&mut b, main);
    reaction_in(&mut b, first, main, Trigger::Reset);
    let inner = b.reactor(main, "inner");
    b.put_in_mode(ModalElement::Reactor(inner), second);
    b.reaction(inner, on(&[Trigger::Reset]));
    let plan = [
        (10, second, Transition::Reset),
        (20, first, Transition::History),
        (30, second, Transition::History),
        (40, first, Transition::Reset),
    ];
    assert_eq!(switching(b, &plan), [at(10, 1, "Main.inner.1"), at(40, 1, "Main.1")]);
}

#[test]
fn a_reset_sends_nested_reactors_to_their_initial_modes() {
    let mut b = builder(100);
    let main = b.main();
    let [first, second] = two_modes(&mut b, main);
    let inner = b.reactor(main, "inner");
    b.put_in_mode(ModalElement::Reactor(inner), first);
    let [inner_first, inner_second] = two_modes(&mut b, inner);
    for (mode, period) in [(inner_first, 10), (inner_second, 15)] {
        let timer = b.timer(inner, "t", period, period);
        b.put_in_mode(ModalElement::Timer(timer), mode);
        reaction_in(&mut b, mode, inner, Trigger::Timer(timer));
    }
    let plan = [
        (12, inner_second, Transition::Reset),
        (30, second, Transition::Reset),
        (50, first, Transition::History),
        (70, second, Transition::Reset),
        (80, first, Transition::Reset),
    ];
    assert_eq!(
        switching(b, &plan),
        [
            at(10, 0, "Main.inner.1"),
            at(27, 0, "Main.inner.2"),
            // At 30, there were 12 left until 42.
            at(62, 0, "Main.inner.2"),
            at(90, 0, "Main.inner.1"),
            at(100, 0, "Main.inner.1"),
        ]
    );
}

/// Main has an instance with an input, two sources, and a connection from each source in a mode.
fn two_connections(b: &mut ProgramBuilder, delay: Delay) -> ([ModeId; 2], [PortId; 2], PortId) {
    let main = b.main();
    let modes = two_modes(b, main);
    let reader = b.reactor(main, "reader");
    let input = b.port(reader, "inp", Direction::Input);
    b.reaction(reader, on(&[Trigger::Port(input)]));
    let sources = modes.map(|mode| {
        let source = b.reactor(main, "source");
        let output = b.port(source, "out", Direction::Output);
        let timer = b.timer(source, "t", 0, 10);
        let (triggers, effects) = (vec![Trigger::Timer(timer)], vec![Effect::Port(output)]);
        b.reaction(source, ReactionSpec { triggers, effects, ..ReactionSpec::default() });
        let connection = b.connect(output, input, delay);
        b.put_in_mode(ModalElement::Connection(connection), mode);
        output
    });
    (modes, sources, input)
}

#[test]
fn a_port_has_one_source_in_each_mode() {
    for (delay, expected) in [
        (Delay::None, vec![(0, 0), (10, 0), (20, 1), (30, 1)]),
        // The message that was sent at 10 had not arrived when the mode was left, and stays suspended.
        (Delay::Time(5), vec![(5, 0), (25, 1), (35, 1)]),
    ] {
        let mut b = builder(35);
        let main = b.main();
        let ([_, second], sources, input) = two_connections(&mut b, delay);
        let triggers = vec![Trigger::Timer(b.timer(main, "switch", 11, 0))];
        let switch = b.reaction(main, ReactionSpec { triggers, ..ReactionSpec::default() });
        let program = b.build().unwrap();
        let mut read = Vec::new();
        let log = run(program, |scheduler, reaction| {
            let spec = &scheduler.program().reactions[reaction];
            let output = sources.iter().position(|s| spec.effects.contains(&Effect::Port(*s)));
            match output {
                Some(source) => {
                    scheduler.set(sources[source], source as i64);
                }
                None if reaction == switch => scheduler.enter(second, Transition::Reset),
                None => read.push((scheduler.tag().time, *scheduler.port(input).unwrap())),
            }
        });
        assert!(log.iter().any(|(_, _, name)| name == "Main.reader.1"));
        assert_eq!(read, expected);
    }
}

#[test]
fn sources_of_one_mode_are_refused() {
    let mut b = builder(1);
    let ([first, _], sources, input) = two_connections(&mut b, Delay::None);
    let connection = b.connect(sources[1], input, Delay::None);
    b.put_in_mode(ModalElement::Connection(connection), first);
    let error = b.build().unwrap_err();
    assert!(matches!(error, ProgramError::TwoSources { port, .. } if port == input), "{error}");
}

#[test]
fn exactly_one_mode_is_initial() {
    for initial in [[true, true], [false, false]] {
        let mut b = builder(1);
        let main = b.main();
        for initial in initial {
            b.mode(main, "m", initial);
        }
        let error = b.build().unwrap_err();
        assert!(error.to_string().contains("exactly one of them is initial"), "{error}");
    }
}

#[test]
fn the_last_request_of_a_tag_wins() {
    let mut b = builder(20);
    let main = b.main();
    let [first, second] = two_modes(&mut b, main);
    timer_in(&mut b, second, 0, 0);
    let plan = [(5, second, Transition::Reset), (5, first, Transition::Reset)];
    assert_eq!(switching(b, &plan), []);
}
