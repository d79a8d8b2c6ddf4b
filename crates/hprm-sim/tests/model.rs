//! Small federations do what their program does in one process, in all their runs.
//!
//! The search visits every state that follows from deliveries in any order, from federates of any
//! speed, and from whatever else may happen. `make check-model` prints how many there were, and goes on
//! with federations that take minutes.

use hprm_core::{FederateId, Nanos};
use hprm_federated::DnetMode;
use hprm_sim::Happening::{Arrive, Break, Crash, Depart, Disconnect, Event, Leave, Stop};
use hprm_sim::{Happening, Setting, explore, scenario};

/// Tag zero was so long ago that everything is due at once.
const PAST: Nanos = -1_000_000_000;

const A: FederateId = FederateId(0);
const B: FederateId = FederateId(1);
const C: FederateId = FederateId(2);

const PAIR: &str = "
    a: every 1 > b
    b: on a";
const AFTER: &str = "
    a: every 1 > b
    b: on a
    a > b after 1";
const CYCLE: &str = "
    a: every 1 > b
    b: on a > a
    a: on b";
const DELAYED_CYCLE: &str = "
    a: every 1 > b
    b: on a > a
    a: on b
    b > a after 1";
const CHAIN: &str = "
    a: every 1 > b
    b: on a > c
    c: on b";
const DELAYED_CHAIN: &str = "
    a: every 1 > b
    b: on a > c
    c: on b
    b > c after 0";
const FAN_IN: &str = "
    a: every 1 > c
    b: every 1 > c
    c: on a
    c: on b";
const DIAMOND: &str = "
    a: every 1 > b c
    b: on a > c
    c: on a
    c: on b";
/// At the last tag `b` may send a message before it reads the one that comes at that tag.
const LAST_WORDS: &str = "
    a: every 1 > b
    b: shutdown > c
    b: on a
    c: on b
    a > b after 0";
/// When `a` leaves before the others, it sends a message that `b` does not expect.
const LEAVER: &str = "
    a: every 3 > b
    a: shutdown > b
    a: shutdown > b
    b: every 1
    b: on a";
/// The same, of one that does nothing else.
const QUIET_LEAVER: &str = "
    a: shutdown > b
    a: shutdown > b
    b: every 1
    b: on a";
/// One that gets an answer to its last message before its last tag is over.
const LEAVER_ON_A_CYCLE: &str = "
    a: shutdown > b
    a: shutdown > b
    b: every 1
    b: on a > a
    a: on b";
const CYCLE_OF_THREE: &str = "
    a: every 1 > b
    b: on a > c
    c: on b > a
    a: on c";
/// The receiver does something of its own less often than the sender, which skips reports meanwhile.
const SLOW: &str = "
    a: every 1
    a: every 2 > b
    b: every 3
    b: on a";
const SLOW_CHAIN: &str = "
    a: every 1
    a: every 2 > b
    b: on a > c
    c: every 2
    c: on b";
/// One sender skips reports until the other one has sent a message to their receiver, which waits then.
const RECALLED: &str = "
    a: every 1
    a: every 3 > c
    b: every 2 > c
    c: on a
    c: on b";
/// A clock is read, so time matters: it is reported every ten million nanoseconds.
const CLOCK: &str = "
    a: event > b
    b: on a";
const CLOCK_AND_TIMER: &str = "
    a: event > b
    a: every 5000000 > b
    b: on a
    a > b after 5000000";
const CLOCK_CYCLE: &str = "
    a: event > b
    b: on a > a
    a: on b";
/// The federate that reads the clock waits for another one, which waits for nothing but that clock.
const CLOCK_ON_A_CYCLE: &str = "
    a: event > b
    a: every 15000000
    b: on a > a
    a: on b
    b > a after 1";
const CLOCK_CHAIN: &str = "
    a: event > b
    b: on a > c
    c: on b";

/// A program, its last tag, and what may happen from outside.
type Case<'a> = (&'a str, &'a str, Nanos, &'a [Happening]);

/// Explores all cases; each line of the table is one.
fn look(coordination: &str, start_delay: Nanos, cases: &[Case]) {
    let dnet = DnetMode::Off;
    look_with(Setting { start_delay, dnet, ..Setting::default() }, coordination, cases);
}

/// Explores all cases in such a setting.
#[expect(clippy::print_stdout, reason = "`make check-model` prints the table")]
fn look_with(given: Setting, coordination: &str, cases: &[Case]) {
    for (name, text, timeout, happenings) in cases {
        let program = scenario(&format!("{coordination}\n timeout {timeout}\n{text}"));
        let happenings = happenings.to_vec();
        let shown = format!("{happenings:?}").replace("FederateId", "");
        let horizon = (given.start_delay + timeout).max(0) + 10_000_000;
        let setting = Setting { happenings, horizon, ..given.clone() };
        let seen = explore(&program, &setting)
            .unwrap_or_else(|wrong| panic!("{coordination}: {name} {shown}: {wrong}"));
        println!(
            "{coordination:13} {name:15} until {timeout:8} {shown:28} {:>8} states {:>8} transitions \
             {:>6} ends",
            seen.states, seen.transitions, seen.ends
        );
        assert!(seen.messages > 0, "{name} exchanges nothing");
        assert!(seen.ends > 0, "{name} never ends");
    }
}

/// Two federates that may be disturbed in every way.
fn disturbed<'a>(name: &'a str, text: &'a str, timeout: Nanos) -> Vec<Case<'a>> {
    const DISTURBANCES: [&[Happening]; 9] = [
        &[Stop(A)],
        &[Stop(B)],
        &[Stop(A), Stop(B)],
        &[Crash(A)],
        &[Crash(B)],
        &[Disconnect(A)],
        &[Disconnect(B)],
        &[Leave(A)],
        &[Leave(B)],
    ];
    DISTURBANCES.map(|disturbance| (name, text, timeout, disturbance)).to_vec()
}

#[test]
fn centralized() {
    let undisturbed: [Case; 9] = [
        ("pair", PAIR, 2, &[]),
        ("after", AFTER, 2, &[]),
        ("cycle", CYCLE, 2, &[]),
        ("delayed cycle", DELAYED_CYCLE, 2, &[]),
        ("chain", CHAIN, 2, &[]),
        ("delayed chain", DELAYED_CHAIN, 1, &[]),
        ("fan-in", FAN_IN, 1, &[]),
        ("diamond", DIAMOND, 1, &[]),
        ("cycle of three", CYCLE_OF_THREE, 1, &[]),
    ];
    look("centralized", PAST, &undisturbed);
}

#[test]
fn centralized_and_disturbed() {
    let three: [Case; 9] = [
        ("last words", LAST_WORDS, 1, &[Stop(A)]),
        ("chain", CHAIN, 0, &[Stop(A), Stop(C)]),
        ("chain", CHAIN, 1, &[Crash(B)]),
        ("chain", CHAIN, 1, &[Disconnect(A)]),
        ("chain", CHAIN, 1, &[Leave(B)]),
        ("diamond", DIAMOND, 0, &[Stop(B)]),
        ("fan-in", FAN_IN, 1, &[Leave(A)]),
        ("cycle of three", CYCLE_OF_THREE, 0, &[Stop(B)]),
        ("cycle of three", CYCLE_OF_THREE, 1, &[Leave(C)]),
    ];
    look("centralized", PAST, &disturbed("pair", PAIR, 1));
    look("centralized", PAST, &disturbed("cycle", CYCLE, 1));
    look("centralized", PAST, &three);
}

#[test]
fn centralized_with_clocks() {
    let cases: [Case; 5] = [
        ("clock", CLOCK, 20_000_000, &[Event(A)]),
        ("clock and timer", CLOCK_AND_TIMER, 10_000_000, &[Event(A)]),
        ("clock cycle", CLOCK_CYCLE, 10_000_000, &[Event(A)]),
        ("clock chain", CLOCK_CHAIN, 10_000_000, &[Event(A)]),
        ("clock", CLOCK, 10_000_000, &[Event(A), Stop(B)]),
    ];
    look("centralized", 1_000, &cases);
}

/// Federates that read one another's boards find out for themselves how far they may advance.
#[test]
fn boards() {
    let cases: [Case; 9] = [
        ("pair", PAIR, 2, &[]),
        ("after", AFTER, 2, &[]),
        ("cycle", CYCLE, 1, &[]),
        ("delayed cycle", DELAYED_CYCLE, 1, &[]),
        ("slow", SLOW, 3, &[]),
        ("leaver", LEAVER, 2, &[Depart(A)]),
        ("pair", PAIR, 1, &[Depart(B)]),
        ("cycle", CYCLE, 0, &[Depart(A)]),
        ("delayed cycle", DELAYED_CYCLE, 1, &[Depart(B)]),
    ];
    // Where tags have to become due, a federate may ask to leave while it sleeps, after it has promised more.
    let clocks: [Case; 4] = [
        ("clock", CLOCK, 10_000_000, &[Event(A)]),
        ("quiet leaver", QUIET_LEAVER, 2, &[Depart(A)]),
        // What has left has relied on the one that leaves after it, too.
        ("quiet leaver", QUIET_LEAVER, 1, &[Depart(A), Depart(B)]),
        // What has followed from its own promise has come back to the one that leaves.
        ("leaver on cycle", LEAVER_ON_A_CYCLE, 2, &[Depart(A)]),
    ];
    let setting = Setting { start_delay: PAST, boards: true, ..Setting::default() };
    look_with(Setting { start_delay: 1_000, ..setting.clone() }, "centralized", &clocks);
    look_with(setting.clone(), "centralized", &cases);
    look_with(setting.clone(), "centralized", &disturbed("pair", PAIR, 0));
    look_with(setting, "centralized", &disturbed("cycle", CYCLE, 0));
}

/// What they show travels to federates that share no memory with them, and takes its time.
#[test]
fn boards_elsewhere() {
    for elsewhere in [A, C] {
        let cases = [("delayed chain", DELAYED_CHAIN, 0, &[] as &[Happening])];
        look_with(apart(elsewhere), "centralized", &cases);
    }
    look_with(apart(A), "centralized", &[("fan-in", FAN_IN, 0, &[])]);
}

/// Federates read boards, but for one that shares no memory with the others.
fn apart(elsewhere: FederateId) -> Setting {
    let elsewhere = vec![elsewhere];
    Setting { start_delay: PAST, boards: true, elsewhere, ..Setting::default() }
}

#[test]
fn decentralized() {
    let undisturbed: [Case; 8] = [
        ("pair", PAIR, 2, &[]),
        ("after", AFTER, 2, &[]),
        ("cycle", CYCLE, 1, &[]),
        ("delayed cycle", DELAYED_CYCLE, 1, &[]),
        ("chain", CHAIN, 0, &[]),
        ("delayed chain", DELAYED_CHAIN, 0, &[]),
        ("fan-in", FAN_IN, 0, &[]),
        ("diamond", DIAMOND, 0, &[]),
    ];
    look("decentralized", PAST, &undisturbed);
}

#[test]
fn decentralized_and_disturbed() {
    let three: [Case; 2] = [("chain", CHAIN, 0, &[Crash(B)]), ("chain", CHAIN, 0, &[Leave(B)])];
    look("decentralized", PAST, &disturbed("pair", PAIR, 0));
    look("decentralized", PAST, &disturbed("cycle", CYCLE, 0));
    look("decentralized", PAST, &three);
}

#[test]
fn decentralized_with_clocks() {
    let cases: [Case; 3] = [
        ("clock", CLOCK, 20_000_000, &[Event(A)]),
        ("clock and timer", CLOCK_AND_TIMER, 10_000_000, &[Event(A)]),
        ("clock cycle", CLOCK_CYCLE, 10_000_000, &[Event(A)]),
    ];
    look("decentralized", 1_000, &cases);
}

/// A federate for which no other one waits skips its reports, and reports again when another one waits.
#[test]
fn downstream_next_event_tags() {
    let cases: [Case; 16] = [
        ("pair", PAIR, 2, &[]),
        ("after", AFTER, 2, &[]),
        ("cycle", CYCLE, 2, &[]),
        ("delayed cycle", DELAYED_CYCLE, 2, &[]),
        ("chain", CHAIN, 2, &[]),
        ("chain", CHAIN, 0, &[Stop(A), Stop(C)]),
        ("fan-in", FAN_IN, 1, &[]),
        ("diamond", DIAMOND, 1, &[]),
        ("pair", PAIR, 1, &[Disconnect(B)]),
        ("slow", SLOW, 4, &[]),
        ("slow", SLOW, 3, &[Stop(A)]),
        ("slow", SLOW, 3, &[Stop(B), Crash(A)]),
        ("slow", SLOW, 3, &[Leave(A)]),
        ("slow chain", SLOW_CHAIN, 2, &[]),
        ("recalled", RECALLED, 2, &[]),
        ("recalled", RECALLED, 1, &[Stop(C)]),
    ];
    let clocks: [Case; 3] = [
        ("clock", CLOCK, 20_000_000, &[Event(A)]),
        ("clock and timer", CLOCK_AND_TIMER, 10_000_000, &[Event(A)]),
        ("clock on a cycle", CLOCK_ON_A_CYCLE, 30_000_000, &[Event(A)]),
    ];
    let setting = Setting { dnet: DnetMode::Eager, ..Setting::default() };
    look_with(Setting { start_delay: 1_000, ..setting.clone() }, "centralized", &clocks);
    look_with(Setting { start_delay: PAST, ..setting }, "centralized", &cases);
}

/// No federate begins a tag before its receivers have processed all messages of earlier tags.
#[test]
fn flow_control() {
    let centralized: [Case; 8] = [
        ("pair", PAIR, 2, &[]),
        ("after", AFTER, 2, &[]),
        ("cycle", CYCLE, 2, &[]),
        ("delayed cycle", DELAYED_CYCLE, 2, &[]),
        ("chain", CHAIN, 1, &[]),
        ("diamond", DIAMOND, 1, &[]),
        ("pair", PAIR, 1, &[Stop(A), Crash(B)]),
        ("chain", CHAIN, 1, &[Leave(B)]),
    ];
    let decentralized: [Case; 6] = [
        ("pair", PAIR, 2, &[]),
        ("after", AFTER, 2, &[]),
        ("cycle", CYCLE, 1, &[]),
        ("delayed cycle", DELAYED_CYCLE, 1, &[]),
        ("pair", PAIR, 1, &[Stop(B)]),
        ("pair", PAIR, 1, &[Leave(B)]),
    ];
    let flow_limit = Some(0);
    let setting = Setting { start_delay: PAST, flow_limit, ..Setting::default() };
    look_with(setting.clone(), "centralized", &centralized);
    look_with(setting, "decentralized", &decentralized);
}

/// A federate that joins late, leaves, dies or joins again stops no other one, on a cycle or not.
#[test]
fn transient_federates() {
    let pair = format!("transient b\n{PAIR}");
    let sender = format!("transient a\n{PAIR}");
    let cycle = format!("transient b\n{CYCLE}");
    let delayed = format!("transient b\n{DELAYED_CYCLE}");
    let cases: [Case; 8] = [
        ("transient pair", &pair, 2, &[Arrive(B)]),
        ("transient pair", &pair, 1, &[Arrive(B), Depart(B)]),
        ("transient pair", &pair, 1, &[Arrive(B), Crash(B)]),
        ("transient sender", &sender, 2, &[Arrive(A)]),
        ("transient sender", &sender, 1, &[Arrive(A), Crash(A)]),
        ("transient cycle", &cycle, 1, &[Arrive(B)]),
        ("transient delayed", &delayed, 2, &[Arrive(B)]),
        ("transient delayed", &delayed, 1, &[Arrive(B), Crash(B)]),
    ];
    let shorter: [Case; 7] = [
        ("transient pair", &pair, 1, &[Arrive(B)]),
        ("transient pair", &pair, 0, &[Arrive(B), Depart(B)]),
        ("transient pair", &pair, 0, &[Arrive(B), Crash(B)]),
        ("transient sender", &sender, 1, &[Arrive(A)]),
        ("transient sender", &sender, 0, &[Arrive(A), Crash(A)]),
        ("transient cycle", &cycle, 0, &[Arrive(B)]),
        ("transient delayed", &delayed, 1, &[Arrive(B)]),
    ];
    let setting = Setting { dnet: DnetMode::Off, ..Setting::default() };
    look_with(setting.clone(), "centralized", &cases);
    look_with(setting.clone(), "decentralized", &shorter);
    let after = format!("transient b\n{AFTER}");
    let often = format!("transient b\na: every 1 > b\na: every 1 > b\n{CYCLE}");
    // On a cycle, with a delay on the other half.
    let back = format!("transient b\n{CYCLE}\na > b after 1");
    let on_boards: [Case; 7] = [
        ("transient cycle", &often, 2, &[Arrive(B)]),
        ("transient after", &after, 1, &[Arrive(B)]),
        ("transient after", &after, 1, &[Arrive(B), Depart(B)]),
        ("transient after", &after, 1, &[Arrive(B), Crash(B)]),
        ("transient sender", &sender, 1, &[Arrive(A)]),
        ("transient sender", &sender, 1, &[Arrive(A), Crash(A)]),
        ("transient after", &back, 1, &[Arrive(B)]),
    ];
    look_with(Setting { boards: true, ..setting }, "centralized", &on_boards);
}

/// A federate that is killed may have passed the tag at which the others agree to stop: messages for that tag
/// are no mistake.
#[test]
fn transient_federates_and_a_stop() {
    let after = format!("transient b\n{AFTER}");
    let cases: [Case; 1] = [("transient after", &after, 2, &[Arrive(B), Stop(A), Crash(B)])];
    let setting = Setting { dnet: DnetMode::Off, ..Setting::default() };
    look_with(setting, "centralized", &cases);
}

/// When a direct link breaks, no federate goes on without what the link has lost.
#[test]
fn broken_links() {
    let cases: [Case; 2] = [("pair", PAIR, 1, &[Break(A, B)]), ("cycle", CYCLE, 0, &[Break(A, B)])];
    look("decentralized", PAST, &cases);
}

#[test]
#[ignore = "takes minutes"]
fn at_length() {
    let centralized: [Case; 4] = [
        ("chain", CHAIN, 2, &[Stop(A), Stop(B), Stop(C)]),
        ("diamond", DIAMOND, 2, &[Stop(A), Stop(B)]),
        ("fan-in", FAN_IN, 2, &[Stop(C), Crash(A)]),
        ("cycle of three", CYCLE_OF_THREE, 2, &[Stop(A), Stop(C)]),
    ];
    let decentralized: [Case; 5] = [
        ("chain", CHAIN, 0, &[Stop(A), Stop(C)]),
        ("diamond", DIAMOND, 0, &[Stop(B)]),
        ("fan-in", FAN_IN, 0, &[Stop(C)]),
        ("cycle of three", CYCLE_OF_THREE, 0, &[]),
        ("cycle", CYCLE, 1, &[Stop(A), Stop(B)]),
    ];
    let clocks: [Case; 1] = [("clock chain", CLOCK_CHAIN, 10_000_000, &[Event(A)])];
    let boards: [Case; 6] = [
        ("chain", CHAIN, 0, &[]),
        ("delayed chain", DELAYED_CHAIN, 0, &[]),
        ("fan-in", FAN_IN, 0, &[]),
        ("diamond", DIAMOND, 0, &[]),
        ("chain", CHAIN, 0, &[Crash(B)]),
        ("chain", CHAIN, 0, &[Leave(B)]),
    ];
    look("centralized", PAST, &centralized);
    look("decentralized", PAST, &decentralized);
    look("decentralized", 1_000, &clocks);
    let with_clocks: [Case; 3] = [
        ("clock", CLOCK, 20_000_000, &[Event(A)]),
        ("clock and timer", CLOCK_AND_TIMER, 10_000_000, &[Event(A)]),
        ("clock cycle", CLOCK_CYCLE, 10_000_000, &[Event(A)]),
    ];
    let setting = Setting { start_delay: PAST, boards: true, ..Setting::default() };
    look_with(setting.clone(), "centralized", &boards);
    look_with(Setting { start_delay: 1_000, ..setting }, "centralized", &with_clocks);
    for elsewhere in [A, C] {
        look_with(apart(elsewhere), "centralized", &[("chain", CHAIN, 0, &[])]);
    }
    look_with(apart(B), "centralized", &[("chain", CHAIN, 0, &[Depart(A)])]);
    look_with(apart(C), "centralized", &[("cycle of three", CYCLE_OF_THREE, 0, &[])]);
}

#[test]
fn joining() {
    for coordination in ["centralized", "decentralized"] {
        for happenings in
            [vec![], vec![Crash(A)], vec![Crash(B)], vec![Disconnect(A)], vec![Stop(A), Stop(B)]]
        {
            let program = scenario(&format!("{coordination}\n timeout 0\n{PAIR}"));
            let start_delay = PAST;
            let setting =
                Setting { happenings, start_delay, from_launch: true, ..Setting::default() };
            let seen = explore(&program, &setting);
            let seen = seen.unwrap_or_else(|wrong| panic!("{coordination}, joining: {wrong}"));
            assert!(seen.states > 100 && seen.ends > 0, "{seen:?}");
        }
    }
}
