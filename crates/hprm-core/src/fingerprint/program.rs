//! The facts of a program: everything in the instance graph that decides its behaviour.
//!
//! Properties that may differ between machines are left out: the number of workers, processors,
//! priorities, the time of busy-polling, hosts. So is the inside of a transient federate: another version
//! of it may take over while the program runs. Its ports are included.

use alloc::borrow::ToOwned;
use alloc::format;
use alloc::string::String;
use alloc::string::ToString;
use alloc::vec;
use alloc::vec::Vec;
use core::fmt::Write as _;

use super::{Fact, Fingerprint};
use crate::spacing::Policy;
use crate::{
    Action, Bound, ClockSyncMode, Connection, Coordination, Delay, Direction, Effect, FederateId,
    ModeId, Nanos, Origin, Overflow, PortId, Program, Reaction, ReactionId, ReactorId, Table,
    Timer, Transition, Trigger,
};

impl Program {
    /// What must be equal in all processes that run this program. A front end that knows more, such as
    /// bodies, adds to [`Self::facts`].
    #[must_use]
    pub fn fingerprint(&self) -> Fingerprint {
        Fingerprint::new(self.facts())
    }

    /// All facts of the program.
    #[must_use]
    pub fn facts(&self) -> Vec<Fact> {
        let mut facts = self.general_facts();
        facts.extend(self.graph_facts());
        facts
    }

    /// The facts about properties and federates.
    #[must_use]
    pub fn general_facts(&self) -> Vec<Fact> {
        let mut facts = self.property_facts();
        facts.extend(self.federate_facts());
        facts
    }

    /// The facts about the instance graph.
    #[must_use]
    pub fn graph_facts(&self) -> Vec<Fact> {
        let mut facts = self.connection_facts();
        facts.extend(self.reactor_facts());
        facts.extend(self.member_facts());
        facts.extend(self.reaction_facts());
        facts
    }

    /// Whether a reactor is, or is in, a transient federate.
    #[must_use]
    pub fn is_transient(&self, reactor: ReactorId) -> bool {
        self.reactors[reactor].federate.is_some_and(|federate| self.federates[federate].transient)
    }

    /// The name of a reactor within the main reactor: the main reactor may have the name of its file, and
    /// that may differ on another machine.
    #[must_use]
    pub fn name_within(&self, reactor: ReactorId) -> &str {
        let name = self.reactors[reactor].name.as_str();
        name.strip_prefix(&self.name).map_or(name, |rest| match rest.strip_prefix('.') {
            Some(rest) => rest,
            None => "the main reactor",
        })
    }

    fn property_facts(&self) -> Vec<Fact> {
        let properties = &self.properties;
        let has_transients = self.federates.values().any(|federate| federate.transient);
        let mut stated = vec![
            ("coordination", coordination(properties.coordination).to_owned()),
            ("timeout", properties.timeout.map_or_else(|| "not set".to_owned(), show_time)),
            ("fast", properties.fast.to_string()),
            ("start-time-multiple", show_time(properties.start_time_multiple)),
            ("scheduler", if properties.deadlines_first { "GEDF_NP" } else { "NP" }.to_owned()),
        ];
        // A program with transient federates goes on in any case.
        if !has_transients {
            stated.push(("keepalive", properties.keepalive.to_string()));
        }
        if self.is_federated() {
            stated.push(("DNET", (!properties.reports_all).to_string()));
        }
        // How long a federate waits by its own clock decides there what is tardy.
        if properties.coordination == Coordination::Decentralized {
            let mode = match properties.clock_sync.mode {
                ClockSyncMode::Off => "off",
                ClockSyncMode::Init => "init",
                ClockSyncMode::On => "on",
            };
            stated.push(("clock-sync", mode.to_owned()));
        }
        let fact = |(name, text)| {
            let fact = Fact::text(format!("property {name}"), text);
            // If the coordination differs, there is a fact for that.
            if name == "clock-sync" { fact.if_present() } else { fact }
        };
        stated.into_iter().map(fact).collect()
    }

    fn federate_facts(&self) -> Vec<Fact> {
        let names: Vec<_> = self.federates.values().map(|f| f.name.as_str()).collect();
        let mut facts = vec![Fact::text("the list of federates".to_owned(), names.join(", "))];
        for federate in self.federates.values() {
            let name = &federate.name;
            let join = if federate.transient { "transient" } else { "not transient" };
            facts.push(Fact::text(format!("federate {name}"), join.to_owned()));
            if self.properties.coordination == Coordination::Decentralized {
                let subject = format!("maxwait of federate {name}");
                facts.push(Fact::text(subject, show_time(federate.maxwait)).if_present());
            }
        }
        facts
    }

    fn connection_facts(&self) -> Vec<Fact> {
        let mut channels: Table<_, _> = Table::filled(self.connections.len(), None);
        for channel in self.channels.values() {
            channels[channel.connection] = Some(channel);
        }
        let with_levels = self.has_zero_delay_cycle();
        let (mut facts, mut across) = (Vec::new(), Vec::new());
        for (id, connection) in self.connections.iter() {
            let crosses = self.crosses_federates(connection);
            if !crosses && self.is_transient(self.ports[connection.from].reactor) {
                continue;
            }
            let subject = self.connection_name(connection);
            let mut text = self.connection_text(connection);
            if crosses {
                match channels[id] {
                    None => text.push_str(", not in use"),
                    Some(channel) if with_levels => {
                        let (writer, reader) = (channel.last_writer, channel.first_reader);
                        let _ = write!(text, ", from level {writer} to {reader}");
                    }
                    Some(_) => {}
                }
                across.push(subject.clone());
            }
            facts.push(Fact::text(subject, text));
        }
        let order = "the order of the connections between federates".to_owned();
        facts.push(Fact::order(order, across.iter().map(String::as_str)));
        facts
    }

    fn connection_name(&self, connection: &Connection) -> String {
        let [from, to] = [connection.from, connection.to].map(|port| self.port_within(port));
        format!("the connection {from} -> {to}")
    }

    fn connection_text(&self, connection: &Connection) -> String {
        let mut text = match (connection.physical, connection.delay) {
            (false, Delay::None) => "without delay".to_owned(),
            (true, Delay::None) => "physical".to_owned(),
            (false, Delay::Microstep) => "after 0".to_owned(),
            (true, Delay::Microstep) => "physical after 0".to_owned(),
            (false, Delay::Time(time)) => format!("after {}", show_time(time)),
            (true, Delay::Time(time)) => format!("physical after {}", show_time(time)),
        };
        if let Some(serializer) = &connection.serializer {
            let _ = write!(text, ", serializer {serializer}");
        }
        if connection.absent_after != 0 {
            let _ = write!(text, ", absent after {}", show_time(connection.absent_after));
        }
        if connection.compress {
            text.push_str(", compressed");
        }
        if let Some(Bound { messages, overflow }) = connection.bound {
            let policy = match overflow {
                Overflow::Drop => "drop",
                Overflow::Replace => "replace",
                Overflow::Block => "block",
            };
            let _ = write!(text, ", bound {messages}, {policy}");
        }
        text + &self.in_mode(connection.mode)
    }

    /// Whether federates send to one another in a cycle without delay. They process a tag level by level,
    /// so they must agree on levels, too.
    fn has_zero_delay_cycle(&self) -> bool {
        let direct = || self.channels.values().filter(|channel| channel.is_direct());
        let mut open: Table<FederateId, usize> = Table::filled(self.federates.len(), 0);
        let mut after: Table<FederateId, Vec<FederateId>> =
            Table::filled(self.federates.len(), Vec::new());
        for channel in direct() {
            open[channel.to] += 1;
            after[channel.from].push(channel.to);
        }
        let mut first: Vec<_> = self.federates.ids().filter(|id| open[*id] == 0).collect();
        let mut outside = 0;
        while let Some(federate) = first.pop() {
            outside += 1;
            for next in &after[federate] {
                open[*next] -= 1;
                if open[*next] == 0 {
                    first.push(*next);
                }
            }
        }
        outside < self.federates.len()
    }

    /// The instances with their ports; of a transient federate nothing but its own ports.
    fn reactor_facts(&self) -> Vec<Fact> {
        let mut facts = Vec::new();
        let mut inside: Table<FederateId, Vec<&str>> =
            Table::filled(self.federates.len(), Vec::new());
        for (id, reactor) in self.reactors.iter() {
            let is_seen = reactor.parent.is_none_or(|parent| parent == ReactorId(0));
            if self.is_transient(id) && !is_seen {
                continue;
            }
            let name = self.name_within(id);
            facts.push(Fact::text(format!("reactor {name}"), self.instance_text(reactor.mode)));
            if let Some(federate) = reactor.federate {
                inside[federate].push(name);
            }
        }
        for (id, port) in self.ports.iter() {
            let is_seen = self.reactors[port.reactor].parent == Some(ReactorId(0));
            if self.is_transient(port.reactor) && !is_seen {
                continue;
            }
            let direction = match port.direction {
                Direction::Input => "an input",
                Direction::Output => "an output",
            };
            let subject = format!("port {}", self.port_within(id));
            facts.push(Fact::text(subject, direction.to_owned()));
        }
        for (id, names) in inside.iter().filter(|(_, names)| names.len() > 1) {
            let subject =
                format!("the order of the reactors of federate {}", self.federates[id].name);
            facts.push(Fact::order(subject, names.iter().copied()));
        }
        facts
    }

    fn instance_text(&self, mode: Option<ModeId>) -> String {
        format!("there{}", self.in_mode(mode))
    }

    /// Timers, actions and modes.
    fn member_facts(&self) -> Vec<Fact> {
        let mut facts = Vec::new();
        let mut add = |kind: &str, reactor: ReactorId, name: &str, text: String| {
            if !self.is_transient(reactor) {
                let within = self.name_within(reactor);
                facts.push(Fact::text(format!("{kind} {within}.{name}"), text));
            }
        };
        for timer in self.timers.values() {
            add("timer", timer.reactor, &timer.name, self.timer_text(timer));
        }
        for action in self.actions.values() {
            add("action", action.reactor, &action.name, self.action_text(action));
        }
        for mode in self.modes.values() {
            let text = if mode.initial { "initial" } else { "not initial" };
            add("mode", mode.reactor, &mode.name, text.to_owned());
        }
        facts
    }

    fn timer_text(&self, timer: &Timer) -> String {
        let (offset, period) = (show_time(timer.offset), show_time(timer.period));
        format!("({offset}, {period}){}", self.in_mode(timer.mode))
    }

    fn action_text(&self, action: &Action) -> String {
        let origin = match action.origin {
            Origin::Logical => "logical",
            Origin::Physical => "physical",
        };
        let mut text = format!("{origin} ({}", show_time(action.min_delay));
        if let Some(spacing) = action.spacing {
            let policy = match spacing.policy {
                Policy::Defer => "defer",
                Policy::Drop => "drop",
                Policy::Replace => "replace",
                Policy::Update => "update",
            };
            let _ = write!(text, ", {}, {policy}", show_time(spacing.min));
        }
        text + ")" + &self.in_mode(action.mode)
    }

    fn reaction_facts(&self) -> Vec<Fact> {
        let reactions = self.reactions.iter();
        let lasting = reactions.filter(|(_, reaction)| !self.is_transient(reaction.reactor));
        let facts = lasting.map(|(id, reaction)| {
            Fact::text(self.reaction_within(id), self.reaction_text(reaction))
        });
        facts.collect()
    }

    /// `reaction 2 of camera`.
    fn reaction_within(&self, reaction: ReactionId) -> String {
        let Reaction { reactor, number, .. } = &self.reactions[reaction];
        match number {
            0 => format!("the reset of state of {}", self.name_within(*reactor)),
            number => format!("reaction {number} of {}", self.name_within(*reactor)),
        }
    }

    /// As it is declared: `reaction(t) image -> out`.
    fn reaction_text(&self, reaction: &Reaction) -> String {
        let trigger = |trigger: &Trigger| match trigger {
            Trigger::Startup => "startup".to_owned(),
            Trigger::Shutdown => "shutdown".to_owned(),
            Trigger::Reset => "reset".to_owned(),
            Trigger::Timer(timer) => self.timers[*timer].name.clone(),
            Trigger::Action(action) => self.actions[*action].name.clone(),
            Trigger::Port(port) => self.port_from(reaction.reactor, *port),
        };
        let effect = |effect: &Effect| match effect {
            Effect::Port(port) => self.port_from(reaction.reactor, *port),
            Effect::Action(action) => self.actions[*action].name.clone(),
            Effect::Mode(mode, transition) => {
                let how = match transition {
                    Transition::Reset => "reset",
                    Transition::History => "history",
                };
                format!("{how}({})", self.modes[*mode].name)
            }
        };
        let triggers: Vec<_> = reaction.triggers.iter().map(trigger).collect();
        let sources = reaction.sources.iter().map(|port| self.port_from(reaction.reactor, *port));
        let sources: Vec<_> = sources.collect();
        let effects: Vec<_> = reaction.effects.iter().map(effect).collect();
        let mut text = format!("({})", triggers.join(", "));
        if !sources.is_empty() {
            let _ = write!(text, " {}", sources.join(", "));
        }
        if !effects.is_empty() {
            let _ = write!(text, " -> {}", effects.join(", "));
        }
        if let Some(deadline) = reaction.deadline {
            let _ = write!(text, " deadline({})", show_time(deadline));
        }
        if reaction.handles_tardy {
            text.push_str(" tardy");
        }
        text + &self.in_mode(reaction.mode)
    }

    fn port_within(&self, port: PortId) -> String {
        let spec = &self.ports[port];
        format!("{}.{}", self.name_within(spec.reactor), spec.name)
    }

    /// The name of a port as a reactor has it: its own, or that of a contained reactor.
    fn port_from(&self, reactor: ReactorId, port: PortId) -> String {
        let spec = &self.ports[port];
        match spec.reactor == reactor {
            true => spec.name.clone(),
            false => {
                let full = &self.reactors[spec.reactor].name;
                let start = self.reactors[reactor].name.len() + 1;
                format!("{}.{}", full.get(start..).unwrap_or(full), spec.name)
            }
        }
    }

    fn in_mode(&self, mode: Option<ModeId>) -> String {
        mode.map_or_else(String::new, |mode| format!(" in mode {}", self.modes[mode].name))
    }
}

fn coordination(coordination: Coordination) -> &'static str {
    match coordination {
        Coordination::Centralized => "centralized",
        Coordination::Decentralized => "decentralized",
    }
}

/// A time as a program states it, in the largest unit of which it is a whole number: `20 ms`.
#[must_use]
pub fn show_time(nanos: Nanos) -> String {
    const UNITS: [(Nanos, &str); 4] =
        [(1_000_000_000, "s"), (1_000_000, "ms"), (1_000, "us"), (1, "ns")];
    match nanos {
        Nanos::MAX => "forever".to_owned(),
        Nanos::MIN => "never".to_owned(),
        0 => "0".to_owned(),
        _ => {
            let fits = UNITS.iter().find(|(unit, _)| nanos % unit == 0);
            let (unit, name) = fits.expect("a nanosecond fits");
            format!("{} {name}", nanos / unit)
        }
    }
}
