//! Small federations from a few lines of text, to explore all their states.
//!
//! ```text
//! decentralized           the coordination, if not centralized
//! maxwait 500             of every federate; for ever, if not given
//! timeout 2               the last tag
//! a: every 1 > b c        a reaction of `a` to a timer, and the federates that it sends to
//! b: on a > c             a reaction of `b` to what comes from `a`
//! c: event                a reaction of `c` to a physical action
//! c: shutdown             a reaction of `c` to the end
//! b > c after 1           a connection has a delay
//! b ~> c                  a connection is physical
//! transient b             `b` may join late, leave and come back
//! ```
//!
//! Federates have numbers in the order in which they are mentioned.

use std::collections::BTreeMap;
use std::sync::Arc;

use hprm_core::{
    Connection, Coordination, Delay, Direction, Effect, FederateId, Nanos, Origin, PortId, Program,
    ProgramBuilder, Properties, ReactionSpec, ReactorId, Trigger,
};

/// The program of that text.
///
/// # Panics
///
/// If the text is not of that form.
#[must_use]
pub fn scenario(text: &str) -> Arc<Program> {
    let value_of = |key: &str| -> Option<Nanos> {
        let value = text.lines().find_map(|line| line.trim().strip_prefix(key))?;
        Some(value.trim().parse().expect("a time is a number"))
    };
    let decentralized = text.lines().any(|line| line.trim() == "decentralized");
    let properties = Properties {
        coordination: match decentralized {
            true => Coordination::Decentralized,
            false => Coordination::Centralized,
        },
        timeout: value_of("timeout"),
        keepalive: value_of("timeout").is_some(),
        ..Properties::default()
    };
    let mut maker = Maker {
        b: ProgramBuilder::new("Main", properties),
        maxwait: value_of("maxwait").unwrap_or(Nanos::MAX),
        reactors: BTreeMap::new(),
        federates: BTreeMap::new(),
        links: BTreeMap::new(),
        timers: 0,
    };
    let lines = || text.lines().map(|line| line.split_whitespace().collect::<Vec<_>>());
    for words in lines() {
        maker.delay(&words);
    }
    for words in lines() {
        maker.reaction(&words);
    }
    for name in text.lines().filter_map(|line| line.trim().strip_prefix("transient ")) {
        let reactor = maker.reactors[name];
        let federate = maker.federates[&reactor];
        maker.b.make_transient(federate);
    }
    Arc::new(maker.finish())
}

struct Maker {
    b: ProgramBuilder,
    maxwait: Nanos,
    reactors: BTreeMap<String, ReactorId>,
    federates: BTreeMap<ReactorId, FederateId>,
    /// By sender and receiver.
    links: BTreeMap<(String, String), Link>,
    timers: usize,
}

#[derive(Clone, Copy, Default)]
struct Link {
    output: Option<PortId>,
    input: Option<PortId>,
    delay: Option<Delay>,
    physical: bool,
}

impl Maker {
    fn delay(&mut self, words: &[&str]) {
        let (from, to, delay, physical) = match *words {
            [from, arrow @ (">" | "~>"), to] => (from, to, None, arrow == "~>"),
            [from, ">", to, "after", nanos] => {
                let nanos = nanos.parse().expect("a delay is a number");
                (from, to, Some(Delay::after(nanos)), false)
            }
            _ => return,
        };
        let link = Link { delay, physical, ..Link::default() };
        self.links.insert((from.to_owned(), to.to_owned()), link);
    }

    fn reaction(&mut self, words: &[&str]) {
        let Some((me, words)) = words.split_first() else { return };
        let Some(me) = me.strip_suffix(':') else { return };
        let (trigger, targets) = match words.iter().position(|word| *word == ">") {
            Some(at) => (&words[..at], &words[at + 1..]),
            None => (words, &[][..]),
        };
        let reactor = self.reactor(me);
        let trigger = match *trigger {
            ["every", period] => {
                let period = period.parse().expect("a period is a number");
                self.timers += 1;
                let name = format!("t{}", self.timers);
                Trigger::Timer(self.b.timer(reactor, &name, 0, period))
            }
            ["shutdown"] => Trigger::Shutdown,
            ["on", from] => Trigger::Port(self.input(from, me)),
            ["event"] => Trigger::Action(self.b.action(reactor, "event", Origin::Physical, 0)),
            _ => panic!("what does {words:?} mean?"),
        };
        let effects = targets.iter().map(|to| Effect::Port(self.output(me, to))).collect();
        let triggers = vec![trigger];
        self.b.reaction(reactor, ReactionSpec { triggers, effects, ..ReactionSpec::default() });
    }

    fn reactor(&mut self, name: &str) -> ReactorId {
        if let Some(known) = self.reactors.get(name) {
            return *known;
        }
        let reactor = self.b.reactor(self.b.main(), name);
        let federate = self.b.federate(reactor, name, self.maxwait, None);
        self.federates.insert(reactor, federate);
        self.reactors.insert(name.to_owned(), reactor);
        reactor
    }

    fn output(&mut self, from: &str, to: &str) -> PortId {
        let reactor = self.reactor(from);
        let link = self.links.entry((from.to_owned(), to.to_owned())).or_default();
        *link
            .output
            .get_or_insert_with(|| self.b.port(reactor, &format!("to_{to}"), Direction::Output))
    }

    fn input(&mut self, from: &str, to: &str) -> PortId {
        let reactor = self.reactor(to);
        let link = self.links.entry((from.to_owned(), to.to_owned())).or_default();
        *link
            .input
            .get_or_insert_with(|| self.b.port(reactor, &format!("from_{from}"), Direction::Input))
    }

    fn finish(mut self) -> Program {
        for ((from, to), link) in &self.links {
            let (Some(output), Some(input)) = (link.output, link.input) else {
                panic!("no reaction sends from {from} to {to}, or none reads it");
            };
            self.b.connection(Connection {
                from: output,
                to: input,
                delay: link.delay.unwrap_or(Delay::None),
                physical: link.physical,
                serializer: None,
                absent_after: 0,
                compress: false,
                bound: None,
                mode: None,
            });
        }
        self.b.build().expect("the federation is sound")
    }
}
