//! Bounds of physical connections: with modes, and where a sender may be blocked.

use crate::common::{on, run};
use hprm_core::{
    Bound, Connection, Coordination, Delay, Direction, Effect, Nanos, Overflow, Program,
    ProgramBuilder, ProgramError, Properties, ReactionSpec, Transition, Trigger,
};

const fn physical(
    from: hprm_core::PortId,
    to: hprm_core::PortId,
    (delay, bound): (Delay, Option<Bound>),
) -> Connection {
    let (serializer, mode) = (None, None);
    Connection {
        from,
        to,
        delay,
        physical: true,
        serializer,
        absent_after: 0,
        compress: false,
        bound,
        mode,
    }
}

#[test]
fn a_message_that_is_suspended_with_its_mode_does_not_wait_and_then_waits_again() {
    let properties = Properties { timeout: Some(100_000), ..Properties::default() };
    let mut b = ProgramBuilder::new("Main", properties);
    let main = b.main();
    let modes = [b.mode(main, "a", true), b.mode(main, "b", false)];
    let [source, sink] = ["source", "sink"].map(|name| b.reactor(main, name));
    let out = b.port(source, "out", Direction::Output);
    let inp = b.port(sink, "inp", Direction::Input);
    // Messages arrive 50,000 later; in between, the mode of their connection is left for a while.
    let times: [Nanos; 4] = [1_000, 2_000, 40_000, 41_000];
    let timers = times.map(|time| Trigger::Timer(b.timer(source, "t", time, 0)));
    let send = ReactionSpec {
        triggers: timers.to_vec(),
        effects: vec![Effect::Port(out)],
        ..ReactionSpec::default()
    };
    let send = b.reaction(source, send);
    let receive = b.reaction(sink, on(&[Trigger::Port(inp)]));
    let switches = [10_000, 30_000].map(|time| Trigger::Timer(b.timer(main, "switch", time, 0)));
    let switch = b.reaction(main, on(&switches));
    let bound = Bound { messages: 2, overflow: Overflow::Replace };
    let connection = physical(out, inp, (Delay::Time(50_000), Some(bound)));
    b.connection(Connection { mode: Some(modes[0]), ..connection });
    let mut values = Vec::new();
    let program = b.build().unwrap();
    run(program, |scheduler, reaction| {
        let now = scheduler.tag().time;
        if reaction == send {
            scheduler.set(out, now);
        } else if reaction == receive {
            values.extend(scheduler.port(inp).copied());
        } else if reaction == switch {
            let mode = if now == 10_000 { modes[1] } else { modes[0] };
            scheduler.enter(mode, Transition::History);
        }
    });
    // Two wait, are suspended, and wait again when two others arrive.
    assert_eq!(values, [40_000, 41_000]);
}

/// What a connection from `a` to `b` that blocks its sender is refused for, beside these between federates.
fn refusal(others: &[(&str, &str, bool)]) -> Option<String> {
    let properties = Properties {
        timeout: Some(1),
        coordination: Coordination::Decentralized,
        ..Properties::default()
    };
    let mut b = ProgramBuilder::new("Main", properties);
    let names = ["a", "b", "c", "d"];
    let reactors = names.map(|name| b.reactor(b.main(), name));
    for (name, reactor) in names.iter().zip(reactors) {
        b.federate(reactor, name, 0, None);
    }
    let mut connect = |from: &str, to: &str, blocks: bool| {
        let number = |name: &str| names.iter().position(|other| *other == name).unwrap();
        let (sender, receiver) = (reactors[number(from)], reactors[number(to)]);
        let from = b.port(sender, "out", Direction::Output);
        let to = b.port(receiver, "in", Direction::Input);
        let bound = blocks.then_some(Bound { messages: 1, overflow: Overflow::Block });
        let connection = physical(from, to, (Delay::None, bound));
        let effects = vec![Effect::Port(from)];
        let triggers = vec![Trigger::Startup];
        b.reaction(sender, ReactionSpec { triggers, effects, ..ReactionSpec::default() });
        b.reaction(receiver, on(&[Trigger::Port(to)]));
        b.connection(Connection { physical: blocks, delay: Delay::Time(1), ..connection })
    };
    let first = connect("a", "b", true);
    for (from, to, blocks) in others {
        connect(from, to, *blocks);
    }
    match b.build() {
        Ok(_) => None,
        Err(ProgramError::Blocking { connection, why, .. }) => {
            assert_eq!(connection, first);
            Some(why)
        }
        Err(error) => panic!("{error}"),
    }
}

#[test]
fn a_sender_waits_only_for_a_receiver_that_does_not_wait_for_it() {
    assert_eq!(refusal(&[]), None);
    assert_eq!(refusal(&[("b", "c", true), ("c", "d", false), ("a", "c", true)]), None);
    // The receiver may wait for messages of the sender, or the sender for the receiver to process them.
    for others in [
        &[("a", "b", false)][..],
        &[("b", "a", false)],
        &[("b", "a", true)],
        &[("b", "c", true), ("c", "a", true)],
        &[("b", "c", false), ("a", "c", false)],
        &[("c", "b", false), ("c", "d", true), ("d", "a", false)],
    ] {
        let why = refusal(others).unwrap_or_else(|| panic!("{others:?} is safe"));
        assert!(why.starts_with("its receiver b may wait for its sender a"), "{why}");
    }
    let why = refusal(&[("b", "c", true), ("c", "a", false)]).unwrap();
    assert!(why.contains("by the connections between b, c, a,"), "{why}");
}

#[test]
fn nothing_waits_for_its_own_process() {
    let mut b = ProgramBuilder::new("Main", Properties::default());
    let [from, to] = ["a", "b"].map(|name| b.reactor(b.main(), name));
    let (from, to) = (b.port(from, "out", Direction::Output), b.port(to, "in", Direction::Input));
    let bound = Bound { messages: 1, overflow: Overflow::Block };
    b.connection(physical(from, to, (Delay::None, Some(bound))));
    let error = b.build().map(|_: Program| ()).unwrap_err().to_string();
    assert!(
        error.contains("Main.a.out ~> Main.b.in must not block its sender: its ends"),
        "{error}"
    );
}
