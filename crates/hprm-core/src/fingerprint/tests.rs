//! How fingerprints are compared, and which facts programs in Rust have.

use super::*;
use crate::{
    Connection, Delay, Direction, Effect, Nanos, Origin, Program, ProgramBuilder, Properties,
    ReactionSpec, Trigger,
};

fn fact(subject: &str, text: &str) -> Fact {
    Fact::text(subject.to_owned(), text.to_owned())
}

fn told(ours: Vec<Fact>, theirs: Vec<Fact>) -> Vec<String> {
    let (ours, theirs) = (Fingerprint::new(ours), Fingerprint::new(theirs));
    let told = ours.differences("the RTI", &theirs.report(), "federate a");
    let same = told.is_empty() && ours.facts.len() == theirs.facts.len();
    assert_eq!(same, ours.digest() == theirs.digest());
    told
}

#[test]
fn a_digest_is_the_same_everywhere() {
    let facts = vec![fact("timer a.t", "(0, 1 s)").at("A.lf:3".to_owned())];
    assert_eq!(Fingerprint::new(facts).digest(), 13_402_968_995_855_969_477);
    assert_eq!(digest([&b"ab"[..], b"c"]), digest([&b"ab"[..], b"c"]));
    assert_ne!(digest([&b"ab"[..], b"c"]), digest([&b"a"[..], b"bc"]));
}

#[test]
fn a_place_may_differ() {
    let at = |place: &str| vec![fact("timer a.t", "0").at(place.to_owned())];
    assert!(told(at("A.lf:3"), at("A.lf:4")).is_empty());
}

#[test]
fn sentences_say_what_differs() {
    let long = |text: &str| fact("timer a.t", &text.repeat(200));
    assert_eq!(
        told(vec![fact("timer a.t", "1 s")], vec![fact("timer a.t", "4 s")]),
        ["timer a.t is 4 s at federate a and 1 s at the RTI"]
    );
    assert_eq!(told(vec![long("a")], vec![long("b")]), ["timer a.t differs"]);
    assert_eq!(
        told(vec![fact("timer a.t", "0").at("A.lf:3".to_owned())], vec![fact("timer a.u", "0")]),
        [
            "timer a.t (A.lf:3) is in the program of the RTI, not in that of federate a",
            "timer a.u is in the program of federate a, not in that of the RTI",
        ]
    );
    let many = |text: &str| (0..9).map(|n| fact(&format!("timer a.t{n}"), text)).collect();
    let told = told(many("0"), many("1"));
    assert_eq!((told.len(), told[5].as_str()), (6, "4 more differences"));
}

#[test]
fn facts_with_one_subject_are_numbered() {
    let two = |second: &str| vec![fact("timer a.t", "0"), fact("timer a.t", second)];
    assert_eq!(told(two("1"), two("2")), ["timer a.t [2] is 2 at federate a and 1 at the RTI"]);
}

#[test]
fn an_order_is_told_if_nothing_else_differs() {
    let order = |names: [&str; 2]| Fact::order("the order of x".to_owned(), names);
    let ours = vec![order(["a", "b"]), fact("timer a.t", "0")];
    assert_eq!(
        told(ours.clone(), vec![order(["b", "a"]), fact("timer a.t", "0")]),
        ["the order of x differs"]
    );
    assert_eq!(
        told(ours, vec![order(["b", "a"]), fact("timer a.t", "1")]),
        ["timer a.t is 1 at federate a and 0 at the RTI"]
    );
}

#[test]
fn what_a_process_may_lack_is_compared_where_both_have_it() {
    let module = |text: &[u8]| vec![Fact::digest("module m".to_owned(), [text]).if_present()];
    assert!(told(module(b"1"), Vec::new()).is_empty());
    assert!(told(Vec::new(), module(b"1")).is_empty());
    assert_eq!(told(module(b"1"), module(b"2")), ["module m differs"]);
}

#[test]
fn a_long_report_is_shortened_and_still_tells_what_differs() {
    for (name, words) in [("a.t", "timer a... differs"), ("t", "the program differs")] {
        let facts = |changed: usize| {
            let fact = |n| fact(&format!("timer {name}{n}"), if n == changed { "1" } else { "0" });
            (0..40_000).map(fact).collect::<Vec<_>>()
        };
        let [ours, theirs] = [facts(0), facts(39_000)].map(Fingerprint::new);
        assert!(is_short(&theirs.report()));
        assert_eq!(ours.differences("the RTI", &theirs.report(), "federate a"), [words]);
        assert!(ours.differences("the RTI", &ours.report(), "federate a").is_empty());
        let few = Fingerprint::new(vec![fact("timer b.t", "0")]);
        assert!(!few.differences("the RTI", &theirs.report(), "federate a").is_empty());
        assert!(!ours.differences("the RTI", &few.report(), "federate a").is_empty());
    }
}

/// What can be changed in a program of two federates that send to each other.
#[derive(Clone, Default)]
struct Sketch {
    /// The second federate is transient.
    transient: bool,
    /// The connection back has no delay, so the federates process tags level by level.
    cycle: bool,
    /// The period of a timer in the second federate.
    period: Nanos,
    /// A reaction of the second federate before the one that sends.
    more: bool,
    /// Whether there is a physical action.
    physical: bool,
    serializer: Option<String>,
}

fn sketched(sketch: &Sketch) -> Program {
    let mut b = ProgramBuilder::new("Main", Properties::default());
    let mut ends = Vec::new();
    for name in ["a", "b"] {
        let reactor = b.reactor(b.main(), name);
        let federate = b.federate(reactor, name, 0, None);
        let [input, output] = [("in", Direction::Input), ("out", Direction::Output)]
            .map(|(name, direction)| b.port(reactor, name, direction));
        if name == "b" {
            let timer = b.timer(reactor, "t", 0, sketch.period);
            let origin = if sketch.physical { Origin::Physical } else { Origin::Logical };
            b.action(reactor, "act", origin, 0);
            if sketch.more {
                let triggers = vec![Trigger::Timer(timer)];
                b.reaction(reactor, ReactionSpec { triggers, ..ReactionSpec::default() });
            }
            if sketch.transient {
                b.make_transient(federate);
            }
        }
        // In a cycle, the reaction that sends must not be the one that the other federate triggers.
        let (triggers, effects) = (vec![Trigger::Startup], vec![Effect::Port(output)]);
        b.reaction(reactor, ReactionSpec { triggers, effects, ..ReactionSpec::default() });
        let triggers = vec![Trigger::Port(input)];
        b.reaction(reactor, ReactionSpec { triggers, ..ReactionSpec::default() });
        ends.push((input, output));
    }
    let back = if sketch.cycle { Delay::None } else { Delay::Time(10) };
    for (from, to, delay) in [(0, 1, Delay::None), (1, 0, back)] {
        b.connection(Connection {
            from: ends[from].1,
            to: ends[to].0,
            delay,
            physical: false,
            serializer: sketch.serializer.clone(),
            absent_after: 0,
            compress: false,
            bound: None,
            mode: None,
        });
    }
    b.build().expect("the federation is sound")
}

fn told_of(one: &Sketch, other: &Sketch) -> Vec<String> {
    let [one, other] = [one, other].map(|sketch| sketched(sketch).fingerprint());
    one.differences("the RTI", &other.report(), "federate b")
}

#[test]
fn programs_in_rust_have_facts() {
    let one = Sketch { period: 1_000_000, ..Sketch::default() };
    let differs = |other: Sketch, words: &str| {
        let told = told_of(&one, &other);
        assert!(told.iter().any(|told| told.starts_with(words)), "{words}: {told:?}");
    };
    assert!(told_of(&one, &one).is_empty());
    differs(
        Sketch { period: 5, ..one.clone() },
        "timer b.t is (0, 5 ns) at federate b and (0, 1 ms)",
    );
    differs(Sketch { more: true, ..one.clone() }, "reaction 1 of b is (t) at federate b");
    differs(Sketch { physical: true, ..one.clone() }, "action b.act is physical (0) at");
    differs(Sketch { transient: true, ..one.clone() }, "federate b is transient at");
    differs(Sketch { cycle: true, ..one.clone() }, "the connection b.out -> a.in is without delay");
    let serializer = Some("json".to_owned());
    differs(
        Sketch { serializer, ..one.clone() },
        "the connection a.out -> b.in is without delay, ser",
    );
}

#[test]
fn a_transient_federate_may_be_another_one_unless_levels_are_agreed_on() {
    let one = Sketch { transient: true, period: 1_000_000, ..Sketch::default() };
    let other = Sketch { period: 5, more: true, physical: true, ..one.clone() };
    assert!(told_of(&one, &other).is_empty());
    assert_eq!(sketched(&one).fingerprint(), sketched(&other).fingerprint());
    let cycle = Sketch { cycle: true, ..one };
    let told = told_of(&cycle, &Sketch { more: true, ..cycle.clone() });
    let words = "the connection b.out -> a.in is without delay, from level 1 to 2 at federate b";
    assert!(told.iter().any(|told| told.starts_with(words)), "{told:?}");
    assert!(told_of(&cycle, &Sketch { period: 5, ..cycle.clone() }).is_empty());
}

#[test]
fn a_time_has_the_largest_unit() {
    let times = [0, 1, 1_500, 20_000_000, 3_000_000_000, Nanos::MAX, Nanos::MIN, -5_000_000];
    let shown = ["0", "1 ns", "1500 ns", "20 ms", "3 s", "forever", "never", "-5 ms"];
    assert_eq!(times.map(show_time), shown);
}
