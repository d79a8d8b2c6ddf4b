//! Whether federates of different machines wait for one another long enough for their clocks.
//!
//! Under decentralized coordination a federate waits for the inputs of a tag until its own clock shows the tag's time and
//! `maxwait` more. If the clock of a sender is behind by more than that, a message that is sent at once comes late, however
//! quick the network is. By how much clocks may differ, agents have found from round trips (`hprm machines`).

use std::collections::BTreeMap;

use hprm::agent::{ClockReading, Machine};
use hprm_core::{
    Channel, ClockSyncMode, Coordination, Delay, FederateId, Nanos, Program, show_time,
};

use crate::columns;
use crate::message::Error;

/// The warnings: one for each federate that waits too shortly for inputs from another machine. `machine_of` says where a
/// federate runs that does not run `here`.
pub(super) fn warnings<'a>(
    program: &Program,
    here: &'a str,
    machine_of: impl Fn(FederateId) -> Option<&'a str>,
    known: &[Machine],
) -> Vec<Error> {
    if program.properties.coordination != Coordination::Decentralized {
        return Vec::new();
    }
    let machine_of = |federate| machine_of(federate).unwrap_or(here);
    let clocks = Clocks::new(program, known);
    let mut short: BTreeMap<FederateId, (Nanos, Channel)> = BTreeMap::new();
    for channel in program.channels.values().filter(|it| !it.physical) {
        let (from, to) = (machine_of(channel.from), machine_of(channel.to));
        let Some(bound) = clocks.bound(from, to).filter(|_| from != to) else { continue };
        let lacking = bound.saturating_sub(wait(program, channel));
        if lacking > 0 && short.get(&channel.to).is_none_or(|(most, _)| lacking > *most) {
            short.insert(channel.to, (lacking, *channel));
        }
    }
    let warning = |(lacking, channel): (Nanos, Channel)| {
        let (from, to) = (machine_of(channel.from), machine_of(channel.to));
        let maxwait = program.federates[channel.to].maxwait;
        let bound = clocks.bound(from, to).unwrap_or_default();
        let (sender, federate) =
            (&program.federates[channel.from].name, &program.federates[channel.to].name);
        let enough = columns::time(Some(maxwait.saturating_add(lacking)));
        Error::new(format!(
            "the maxwait of federate {federate} on {to} is {}, but the clocks of {to} and {from} may differ by {}: what federate \
             {sender} sends from {from} may be tardy",
            show_time(maxwait),
            columns::time(Some(bound)),
        ))
        .hint(format!(
            "let it wait for more than {enough}, and for what the network takes: @maxwait of {federate}, or @absent_after of the \
             connection{}",
            clocks.advice()
        ))
    };
    short.into_values().map(warning).collect()
}

/// How long after the sender's clock has shown the time at which a message is sent its receiver's may show more.
fn wait(program: &Program, channel: &Channel) -> Nanos {
    let ahead = match channel.delay {
        Delay::Time(delay) => delay,
        Delay::None | Delay::Microstep => 0,
    };
    let absent_after = program.connections[channel.connection].absent_after;
    program.federates[channel.to].maxwait.saturating_add(absent_after).saturating_add(ahead)
}

/// What is known of the clocks of machines, beside that of this one.
struct Clocks {
    readings: BTreeMap<String, ClockReading>,
    /// Whether federates correct their clocks, so that only what is not known of the offset counts.
    are_corrected: bool,
}

impl Clocks {
    fn new(program: &Program, known: &[Machine]) -> Self {
        let reading = |it: &Machine| match it.is_here {
            true => Some(ClockReading { offset: 0, bound: 0 }),
            false => it.clock,
        };
        let readings = known.iter().filter_map(|it| Some((it.name.clone(), reading(it)?)));
        let are_corrected = program.properties.clock_sync.mode != ClockSyncMode::Off;
        Self { readings: readings.collect(), are_corrected }
    }

    /// By how much the clocks of federates on two machines may differ.
    fn bound(&self, one: &str, other: &str) -> Option<Nanos> {
        let (one, other) = (self.readings.get(one)?, self.readings.get(other)?);
        let offset = match self.are_corrected {
            true => 0,
            false => one.offset.saturating_sub(other.offset).saturating_abs(),
        };
        Some(offset.saturating_add(one.bound).saturating_add(other.bound))
    }

    fn advice(&self) -> &str {
        if self.are_corrected { "" } else { "; or leave out `clock-sync: off`" }
    }
}

#[cfg(test)]
mod tests {
    use hprm_core::{Direction, Effect, ProgramBuilder, Properties, ReactionSpec, Trigger};

    use super::*;

    /// `a` sends to `b`, both with this maxwait, `c` to nothing.
    fn program(maxwait: Nanos, delay: Delay, properties: Properties) -> Program {
        let mut b = ProgramBuilder::new("Main", properties);
        let (mut ports, mut reactors) = (Vec::new(), Vec::new());
        for name in ["a", "b", "c"] {
            let reactor = b.reactor(b.main(), name);
            b.federate(reactor, name, maxwait, None);
            reactors.push(reactor);
            ports.push((
                b.port(reactor, "out", Direction::Output),
                b.port(reactor, "inp", Direction::Input),
            ));
        }
        let effects = vec![Effect::Port(ports[0].0)];
        let sends =
            ReactionSpec { triggers: vec![Trigger::Startup], effects, ..Default::default() };
        b.reaction(reactors[0], sends);
        let triggers = vec![Trigger::Port(ports[1].1)];
        b.reaction(reactors[1], ReactionSpec { triggers, ..Default::default() });
        b.connect(ports[0].0, ports[1].1, delay);
        b.build().unwrap()
    }

    fn decentralized() -> Properties {
        Properties { coordination: Coordination::Decentralized, ..Properties::default() }
    }

    fn told(program: &Program, places: [&str; 3]) -> Vec<String> {
        let machine = |name: &str, clock| Machine {
            name: name.to_owned(),
            is_here: name == "base",
            about: None,
            clock,
            through: None,
        };
        let clock = |offset, bound| Some(ClockReading { offset, bound });
        let known = [
            machine("base", None),
            machine("robot1", clock(-5_000_000, 200_000)),
            machine("robot2", clock(7_000_000, 100_000)),
            machine("robot3", None),
        ];
        let places: BTreeMap<_, _> = program.federates.ids().zip(places).collect();
        let machine_of = |federate| places.get(&federate).copied().filter(|it| *it != "base");
        let warnings = warnings(program, "base", machine_of, &known);
        warnings.iter().map(|it| it.report().text(hprm::Label::Warning, false)).collect()
    }

    #[test]
    fn a_federate_that_waits_for_less_than_clocks_may_differ_is_told_once() {
        let short = program(50_000, Delay::None, decentralized());
        let one = told(&short, ["robot1", "base", "base"]);
        assert_eq!(one.len(), 1);
        assert!(one[0].starts_with("warning: the maxwait of federate b on base is 50 us"));
        assert!(one[0].contains("the clocks of base and robot1 may differ by 200 us"));
        let two = told(&short, ["robot1", "robot2", "base"]);
        assert!(two[0].contains("the clocks of robot2 and robot1 may differ by 300 us"), "{two:?}");
        assert!(two[0].contains("more than 300 us"));
    }

    #[test]
    fn a_federate_that_waits_long_enough_is_not_told() {
        let places = ["robot1", "base", "base"];
        for (maxwait, delay) in
            [(200_000, Delay::None), (Nanos::MAX, Delay::None), (50_000, Delay::Time(150_000))]
        {
            assert!(told(&program(maxwait, delay, decentralized()), places).is_empty());
        }
        let short = program(0, Delay::None, decentralized());
        // On one machine, or without inputs from another one, or where nothing is known.
        for places in [["robot1"; 3], ["base", "base", "robot1"], ["robot3", "base", "base"]] {
            assert!(told(&short, places).is_empty(), "{places:?}");
        }
        let centralized = program(0, Delay::None, Properties::default());
        assert!(told(&centralized, places).is_empty());
    }

    #[test]
    fn without_correction_the_offset_counts_too() {
        let mut properties = decentralized();
        properties.clock_sync.mode = ClockSyncMode::Off;
        let told = told(&program(200_000, Delay::None, properties), ["robot1", "robot2", "base"]);
        assert!(told[0].contains("may differ by 12.3 ms"), "{told:?}");
        assert!(told[0].contains("clock-sync: off"));
    }
}
