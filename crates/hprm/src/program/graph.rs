//! The parts of a program while reactors are added, and the rules that they must obey.
//!
//! `hprm-core` checks what makes a graph of reactors a program. What is checked here is what the Rust API lets one write
//! beyond that: handles travel freely, so a reaction can name what is not within its reach.

use std::sync::Arc;

use hprm_core::{
    Connection, Delay, Direction, Effect, ModeId, Port, PortId, Program, ProgramBuilder,
    Properties, ReactionId, ReactorId, Trigger,
};

use super::bodies::Bodies;
use super::connection::Connections;
use super::handle::Slot;
use super::parts::{Parts, Unbuilt};
use super::sender::Entrances;
use crate::{Failure, Kind, Report};

/// The parts of a program, while reactors are added.
pub(super) struct Graph {
    pub(super) parts: Parts,
    pub(super) bodies: Bodies,
    pub(super) entrances: Entrances,
    /// Not among the parts yet, because more may be said about them.
    connections: Vec<Connection>,
    pub(super) mistakes: Vec<Report>,
}

impl Graph {
    /// The graph of a new program.
    pub(super) fn new(name: &str) -> Self {
        Self::of(Parts::New(ProgramBuilder::new(name, Properties::default())))
    }

    pub(super) fn of(parts: Parts) -> Self {
        Self {
            parts,
            bodies: Bodies::new(),
            entrances: Entrances::default(),
            connections: Vec::new(),
            mistakes: Vec::new(),
        }
    }

    pub(super) fn full_name(&self, reactor: ReactorId, name: &str) -> String {
        format!("{}.{name}", self.parts.reactor_name(reactor))
    }

    pub(super) fn connect(
        &mut self,
        from: Vec<PortId>,
        to: Vec<PortId>,
        mode: Option<ModeId>,
    ) -> Connections<'_> {
        if from.len() != to.len() {
            let named = |ports: &[PortId]| match ports {
                [] => "no port".to_owned(),
                [port] => format!("one port ({})", self.parts.port_name(*port)),
                [port, ..] => {
                    format!("{} ports ({}, …)", ports.len(), self.parts.port_name(*port))
                }
            };
            let message = format!("cannot connect {} to {}", named(&from), named(&to));
            let hint = "`connect_each` needs as many on both sides; connect one port to several with `connect`";
            self.mistakes.push(Report::new(Kind::Program, message).hint(hint));
        }
        let new = self.connections.len();
        self.connections.extend(from.into_iter().zip(to).map(|(from, to)| Connection {
            from,
            to,
            delay: Delay::None,
            physical: false,
            serializer: None,
            absent_after: 0,
            bound: None,
            mode,
        }));
        Connections(&mut self.connections[new..])
    }

    /// Checks the program.
    ///
    /// # Errors
    ///
    /// All mistakes of the kinds that are found here, or else the first of another kind.
    pub(super) fn build(
        self,
        properties: Properties,
    ) -> Result<(Arc<Program>, Bodies, Entrances), Failure> {
        if !self.mistakes.is_empty() {
            return Err(Failure::Mistakes(self.mistakes));
        }
        let program = match self.parts.build(self.connections, properties) {
            Ok(program) => program,
            Err(Unbuilt::Wrong(mistake)) => return Err(mistake.into()),
            Err(Unbuilt::Differs(report)) => return Err(Failure::Mistakes(vec![*report])),
        };
        let mistakes = mistakes(&program);
        if !mistakes.is_empty() {
            return Err(Failure::Mistakes(mistakes));
        }
        let bodies = self.bodies.of(&program);
        Ok((program, bodies, self.entrances))
    }
}

/// What is out of reach where it is named.
fn mistakes(program: &Program) -> Vec<Report> {
    let connections = program.connections.values().filter_map(|c| stray_connection(program, c));
    let reactions = program.reactions.ids().flat_map(|id| stray_effects(program, id));
    connections.chain(reactions).collect()
}

/// A connection lies in one reactor: it leads from an input of that one, or an output of one inside it, to an output of
/// that one, or an input of one inside it.
fn stray_connection(program: &Program, connection: &Connection) -> Option<Report> {
    let place = |port: PortId, own: Direction| {
        let Port { reactor, direction, .. } = &program.ports[port];
        if *direction == own { Some(*reactor) } else { program.reactors[*reactor].parent }
    };
    let Connection { from, to, .. } = connection;
    let places = [place(*from, Direction::Input), place(*to, Direction::Output)];
    if places[0].is_some() && places[0] == places[1] {
        return None;
    }
    let [from, to] = [from, to].map(|port| program.port_name(*port));
    let message = format!("the connection {from} -> {to} does not lie in one reactor");
    let hint = "a reactor connects its own ports and those of the reactors directly inside it: lead the value through \
                ports of the reactors in between";
    Some(Report::new(Kind::Program, message).hint(hint))
}

/// A reaction touches what its own reactor has, inputs of reactors directly inside it, which it may set, and outputs of
/// those, which it may read.
fn stray_effects(program: &Program, id: ReactionId) -> Vec<Report> {
    let reaction = &program.reactions[id];
    let here = reaction.reactor;
    let has = |port: PortId, own: Direction| {
        let Port { reactor, direction, .. } = &program.ports[port];
        let inside = program.reactors[*reactor].parent == Some(here);
        if *direction == own { *reactor == here } else { inside }
    };
    let stray = |verb: &str, name: String, hint: &str| {
        let message = format!("reaction {} cannot {verb} {name}", program.reaction_name(id));
        Report::new(Kind::Program, message).hint(hint)
    };
    let reads = |port: PortId| {
        let hint = "a reaction reads inputs of its reactor, and outputs of reactors directly inside it: connect the port \
                    to one of those";
        (!has(port, Direction::Input)).then(|| stray("read", program.port_name(port), hint))
    };
    let triggers = reaction.triggers.iter().filter_map(|trigger| match *trigger {
        Trigger::Port(port) => reads(port),
        Trigger::Action(action) => foreign_action(program, here, Slot::Action(action))
            .map(|name| stray("be triggered by action", name, "it belongs to another reactor")),
        Trigger::Timer(timer) => {
            let timer = &program.timers[timer];
            let name = format!("{}.{}", program.reactors[timer.reactor].name, timer.name);
            (timer.reactor != here)
                .then(|| stray("be triggered by timer", name, "it belongs to another reactor"))
        }
        Trigger::Startup | Trigger::Shutdown | Trigger::Reset => None,
    });
    let sources = reaction.sources.iter().filter_map(|port| reads(*port));
    let effects = reaction.effects.iter().filter_map(|effect| match *effect {
        Effect::Port(port) => (!has(port, Direction::Output)).then(|| {
            let hint = "a reaction sets outputs of its reactor, and inputs of reactors directly inside it: connect one \
                        of those to the port";
            stray("set", program.port_name(port), hint)
        }),
        Effect::Action(action) => foreign_action(program, here, Slot::Action(action))
            .map(|name| stray("schedule", name, "the action belongs to another reactor: send it a value")),
        Effect::Mode(mode, _) => {
            let mode = &program.modes[mode];
            let name = format!("mode {}.{}", program.reactors[mode.reactor].name, mode.name);
            (mode.reactor != here)
                .then(|| stray("enter", name, "the mode belongs to another reactor: send it a value"))
        }
    });
    triggers.chain(sources).chain(effects).collect()
}

/// The full name of an action that belongs to another reactor.
fn foreign_action(program: &Program, here: ReactorId, slot: Slot) -> Option<String> {
    let Slot::Action(action) = slot else { return None };
    let action = &program.actions[action];
    (action.reactor != here)
        .then(|| format!("{}.{}", program.reactors[action.reactor].name, action.name))
}
