//! Reactions whose effects are kept apart leave the scheduler as if they had run one after the other.

use std::sync::Arc;

use hprm_core::{
    ActionId, Body, Delay, Direction, Effect, Effects, ModeId, Origin, PhysicalTime, PortId,
    Program, ProgramBuilder, Properties, ReactionId, ReactionSpec, Scheduler, Scope, Transition,
    Trigger, Turn,
};

/// The physical time of tag zero, and of everything else.
const START: PhysicalTime = PhysicalTime(1_000_000);

/// What the reactions of a program use.
struct Parts {
    program: Arc<Program>,
    outputs: [PortId; 2],
    input: PortId,
    action: ActionId,
    other_mode: ModeId,
    sources: [ReactionId; 2],
}

/// Two sources at one level, of which the first has modes and an action, and a sink with memory.
fn parts() -> Parts {
    let properties = Properties { timeout: Some(50), ..Properties::default() };
    let mut b = ProgramBuilder::new("Main", properties);
    let [first, second, sink] = ["a", "b", "sink"].map(|name| b.reactor(b.main(), name));
    b.mode(first, "initial", true);
    let other_mode = b.mode(first, "other", false);
    let action = b.action(first, "act", Origin::Logical, 2);
    let outputs = [first, second].map(|reactor| b.port(reactor, "out", Direction::Output));
    let inputs = ["x", "y"].map(|name| b.port(sink, name, Direction::Input));
    b.connect(outputs[0], inputs[0], Delay::None);
    b.connect(outputs[1], inputs[1], Delay::Time(3));
    let sources = [first, second].map(|reactor| {
        let timer = b.timer(reactor, "t", 0, 10);
        let mut triggers = vec![Trigger::Timer(timer)];
        let mut effects = outputs.map(Effect::Port).to_vec();
        effects.retain(|effect| *effect == Effect::Port(outputs[usize::from(reactor == second)]));
        if reactor == first {
            triggers.push(Trigger::Action(action));
            effects.push(Effect::Action(action));
            effects.push(Effect::Mode(other_mode, Transition::History));
        }
        let deadline = Some(1_000);
        b.reaction(reactor, ReactionSpec { triggers, effects, deadline, ..Default::default() })
    });
    let triggers = inputs.map(Trigger::Port).to_vec();
    b.reaction(sink, ReactionSpec { triggers, ..Default::default() });
    let program = Arc::new(b.build().unwrap());
    Parts { program, outputs, input: inputs[0], action, other_mode, sources }
}

/// Runs the body of a reaction directly on the scheduler.
fn alone(parts: &Parts, scheduler: &mut Scheduler<i64>, reaction: ReactionId, seen: &mut Vec<i64>) {
    let time = scheduler.tag().time;
    if reaction == parts.sources[0] {
        scheduler.set(parts.outputs[0], time);
        scheduler.set(parts.outputs[0], time + 1);
        seen.extend(scheduler.port(parts.outputs[0]));
        scheduler.mark_physical();
        scheduler.schedule(parts.action, 1, Some(time), START);
        scheduler.enter(parts.other_mode, Transition::History);
    } else if reaction == parts.sources[1] {
        scheduler.set(parts.outputs[1], -time);
        scheduler.set_deadline(reaction, 0);
        seen.push(i64::from(scheduler.misses_deadline(reaction, START)));
        if time == 30 {
            scheduler.request_stop();
        }
    } else {
        seen.extend(scheduler.latest(parts.input));
        scheduler.keep(parts.input, 77);
        seen.extend(scheduler.latest(parts.input));
    }
}

/// Runs the body of a reaction on its own effects, as a worker does.
fn beside(
    parts: &Parts,
    (scheduler, effects): (&Scheduler<i64>, &mut Effects<i64>),
    reaction: ReactionId,
    seen: &mut Vec<i64>,
) {
    let time = scheduler.tag().time;
    if reaction == parts.sources[0] {
        effects.set(parts.outputs[0], time);
        effects.set(parts.outputs[0], time + 1);
        seen.extend(effects.port(scheduler, parts.outputs[0]));
        effects.mark_physical();
        effects.schedule(scheduler, parts.action, 1, Some(time), START);
        effects.enter(parts.other_mode, Transition::History);
    } else if reaction == parts.sources[1] {
        effects.set(parts.outputs[1], -time);
        effects.set_deadline(0);
        seen.push(i64::from(effects.misses_deadline(scheduler, reaction, START)));
        if time == 30 {
            effects.request_stop();
        }
    } else {
        seen.extend(effects.latest(scheduler, parts.input));
        effects.keep(parts.input, 77);
        seen.extend(effects.latest(scheduler, parts.input));
    }
}

#[test]
fn effects_kept_apart_lead_to_the_same_state() {
    let parts = parts();
    let new = || {
        let mut scheduler = Scheduler::new(Arc::clone(&parts.program), Scope::Whole);
        scheduler.start_recording();
        scheduler.start(START);
        scheduler
    };
    let (mut direct, mut apart) = (new(), new());
    let mut turns = Vec::<Turn>::new();
    let (mut widest, mut late, mut marked) = (0, 0, false);
    loop {
        let tag = direct.next_tag();
        assert_eq!(tag, apart.next_tag());
        direct.begin(tag);
        apart.begin(tag);
        let (mut seen, mut seen_apart) = (Vec::new(), Vec::new());
        while let Some((reaction, body)) = direct.next_reaction(START) {
            late += u32::from(body == Body::Deadline);
            alone(&parts, &mut direct, reaction, &mut seen);
            direct.finish(reaction);
        }
        loop {
            apart.next_turns(START, &mut turns);
            if turns.is_empty() {
                break;
            }
            widest = widest.max(turns.len());
            let mut done = Vec::new();
            for turn in &turns {
                let mut effects = Effects::default();
                beside(&parts, (&apart, &mut effects), turn.reaction, &mut seen_apart);
                done.push(effects);
            }
            for (turn, effects) in turns.iter().zip(&mut done) {
                apart.commit(turn, effects);
                assert_eq!(*effects, Effects::default());
            }
        }
        assert_eq!(seen, seen_apart, "at {tag}");
        direct.take_displaced();
        assert_eq!(direct, apart, "at {tag}");
        while let Some(record) = direct.poll_record() {
            marked |= record.physical && !record.ports.is_empty();
            assert_eq!(Some(record), apart.poll_record());
        }
        if direct.end(START) {
            break;
        }
        apart.end(START);
    }
    assert_eq!((widest, direct.tag().time), (2, 30));
    assert!(marked);
    assert!(late > 0, "a deadline that was changed holds from the next turn on");
}
