//! Programs for tests, from a line per connection.
//!
//! ```text
//! decentralized            the coordination, if not centralized
//! maxwait 500              of every federate; for ever, if not given
//! transient b              b may join late, leave, and come back
//! a -> b                   a connection; federates are numbered as they are mentioned
//! b -> a after 100         with a delay
//! b -> a absent_after 20   waited for that much longer
//! a ~> c                   a physical one
//! a ~> c bound 2           that blocks its sender
//! ```

use std::collections::BTreeMap;

use hprm_core::{
    Bound, Connection, Coordination, Delay, Direction, Effect, FederateId, Nanos, Overflow,
    Program, ProgramBuilder, Properties, ReactionSpec, ReactorId, Trigger,
};

/// The program of that text.
pub(crate) fn program(text: &str) -> Program {
    let line_of = |key| text.lines().find_map(|line| line.trim().strip_prefix(key));
    let coordination = match line_of("decentralized") {
        Some(_) => Coordination::Decentralized,
        None => Coordination::Centralized,
    };
    let maxwait = line_of("maxwait").map_or(Nanos::MAX, |text| text.trim().parse().unwrap());
    let properties = Properties { coordination, keepalive: true, ..Properties::default() };
    let mut b = ProgramBuilder::new("Main", properties);
    let mut reactors = BTreeMap::new();
    let mut federates = BTreeMap::new();
    for line in text.lines() {
        let words: Vec<_> = line.split_whitespace().collect();
        let [from, arrow @ ("->" | "~>"), to, rest @ ..] = words.as_slice() else {
            continue;
        };
        let mut reactor = |name: &str| -> ReactorId {
            *reactors.entry(name.to_owned()).or_insert_with(|| {
                let reactor = b.reactor(b.main(), name);
                federates.insert(name.to_owned(), b.federate(reactor, name, maxwait, None));
                reactor
            })
        };
        let (from, to) = (reactor(from), reactor(to));
        let (mut delay, mut absent_after, mut bound) = (Delay::None, 0, None);
        for words in rest.chunks(2) {
            match words {
                ["after", nanos] => delay = Delay::after(nanos.parse().unwrap()),
                ["absent_after", nanos] => absent_after = nanos.parse().unwrap(),
                ["bound", count] => {
                    let (messages, overflow) = (count.parse().unwrap(), Overflow::Block);
                    bound = Some(Bound { messages, overflow });
                }
                _ => panic!("what does {line} mean?"),
            }
        }
        connect(&mut b, (from, to), (delay, *arrow == "~>"), (absent_after, bound));
    }
    for name in text.lines().filter_map(|line| line.trim().strip_prefix("transient ")) {
        b.make_transient(federates[name.trim()]);
    }
    b.build().unwrap()
}

fn connect(
    b: &mut ProgramBuilder,
    (from, to): (ReactorId, ReactorId),
    (delay, physical): (Delay, bool),
    (absent_after, bound): (Nanos, Option<Bound>),
) {
    let output = b.port(from, "out", Direction::Output);
    let input = b.port(to, "in", Direction::Input);
    let serializer = None;
    b.connection(Connection {
        from: output,
        to: input,
        delay,
        physical,
        serializer,
        absent_after,
        compress: false,
        bound,
        mode: None,
    });
    let effects = vec![Effect::Port(output)];
    let triggers = vec![Trigger::Startup];
    b.reaction(from, ReactionSpec { triggers, effects, ..ReactionSpec::default() });
    let triggers = vec![Trigger::Port(input)];
    b.reaction(to, ReactionSpec { triggers, ..ReactionSpec::default() });
}

/// The federate of that name.
pub(crate) fn federate(program: &Program, name: &str) -> FederateId {
    program.federate_named(name).unwrap()
}
