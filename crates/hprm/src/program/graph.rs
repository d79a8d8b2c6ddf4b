//! The parts of a program while reactors are added, and the rules that they must obey.
//!
//! `hprm-core` checks what makes a graph of reactors a program. What is checked here is what the Rust API lets one write
//! beyond that: handles travel freely, so a reaction can name what is not within its reach.

use std::collections::BTreeMap;
use std::panic::Location;
use std::sync::Arc;

use hprm_core::{
    ActionId, Connection, Delay, Direction, Effect, ModeId, Port, PortId, Program, ProgramBuilder,
    ProgramError, Properties, ReactionId, ReactionSpec, ReactorId, Trigger,
};

use super::bodies::Bodies;
use super::connection::Connections;
use super::handle::PhysicalAction;
use super::identity::{Identity, Of, Part, located};
use super::parts::{Parts, Unbuilt};
use super::sender::{Entrances, Sender};
use super::transport::Codec;
use crate::{Failure, Kind, Report};

/// A place in the source of a program.
type At = &'static Location<'static>;

/// What shares its names within a reactor, as in `.lf` files.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Namespace {
    /// Ports, actions, timers and modes.
    Parts,
    /// Reactors inside.
    Reactors,
}

/// The parts of a program, while reactors are added.
pub(super) struct Graph {
    pub(super) parts: Parts,
    pub(super) bodies: Bodies,
    pub(super) entrances: Entrances,
    /// Not among the parts yet, because more may be said about them.
    connections: Vec<Connection>,
    pub(super) mistakes: Vec<Report>,
    identity: Identity,
    /// Where each name was taken.
    taken: BTreeMap<(ReactorId, Namespace, String), At>,
    sites: Sites,
}

/// Where in the source connections and reactions are.
#[derive(Default)]
struct Sites {
    connections: BTreeMap<(PortId, PortId), At>,
    reactions: BTreeMap<ReactionId, At>,
}

impl Sites {
    /// What is wrong with the graph, and a place in the source that makes it so, if it is known.
    fn placed(&self, mistake: ProgramError) -> Failure {
        let at = match &mistake {
            ProgramError::CausalityLoop { reactions, .. } => {
                reactions.iter().find_map(|reaction| self.reactions.get(reaction))
            }
            ProgramError::TwoSources { port, .. } | ProgramError::ConnectionLoop { port, .. } => {
                let leading = self.connections.iter().filter(|((_, to), _)| to == port);
                // The one that was added to the others.
                leading.map(|(_, at)| at).max()
            }
            _ => None,
        };
        match at {
            Some(at) => Failure::Mistakes(vec![located(Failure::from(mistake).report(), at)]),
            None => mistake.into(),
        }
    }
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
            identity: Identity::new(),
            taken: BTreeMap::new(),
            sites: Sites::default(),
        }
    }

    pub(super) fn full_name(&self, reactor: ReactorId, name: &str) -> String {
        format!("{}.{name}", self.parts.reactor_name(reactor))
    }

    // Names and handles.

    /// Notes that a port, an action, a timer or a mode of a reactor has that name.
    pub(super) fn declare_part(&mut self, reactor: ReactorId, name: &str, at: At) {
        self.declare((reactor, Namespace::Parts, name.to_owned()), at);
    }

    /// Notes that a reactor inside another one has that name.
    pub(super) fn declare_reactor(&mut self, parent: ReactorId, name: &str, at: At) {
        self.declare((parent, Namespace::Reactors, name.to_owned()), at);
    }

    fn declare(&mut self, name: (ReactorId, Namespace, String), at: At) {
        let Some(first) = self.taken.get(&name) else {
            self.taken.insert(name, at);
            return;
        };
        let (reactor, _, text) = &name;
        let reactor = self.parts.reactor_name(*reactor);
        let message = format!("the name `{text}` is already taken in {reactor}, at {first}");
        let report = Report { diagnostic: Some("LF0201".to_owned()), ..report(message) };
        let hint =
            "give each one a name of its own; of several equal ones, make a bank or a multiport";
        self.mistakes.push(located(report.hint(hint), at));
    }

    /// A handle for a part that a reactor has.
    pub(super) fn handle<I: Copy + Into<Part>>(
        &self,
        id: I,
        reactor: ReactorId,
        name: &str,
    ) -> Of<I> {
        self.identity.of(id, reactor, self.full_name(reactor, name))
    }

    /// States how the values of a port travel, if it is one of this program.
    pub(super) fn carry(&mut self, port: Of<PortId>, codec: Codec) {
        if self.has(port) {
            self.bodies.carry(port.id, codec);
        }
    }

    fn has<I>(&self, part: Of<I>) -> bool {
        part.graph == self.identity.number()
    }

    /// A part of this program; one of another program is a mistake of what `subject` names.
    pub(super) fn own<I: Copy + Into<Part>>(
        &mut self,
        part: Of<I>,
        at: &Location<'_>,
        subject: impl Fn(&Self) -> String,
    ) -> Option<I> {
        if self.has(part) {
            return Some(part.id);
        }
        let message = format!("{} {}", subject(self), part.told_elsewhere());
        let hint = "what one program has declared cannot be used in another one: use what this program's own reactors \
                    return";
        self.mistake(at, message, hint);
        None
    }

    /// Notes a mistake at that place.
    pub(super) fn mistake(&mut self, at: &Location<'_>, message: String, hint: &str) {
        self.mistakes.push(located(report(message).hint(hint), at));
    }

    // What is made of handles.

    /// Reaches a physical action from other threads.
    pub(super) fn sender<T>(&mut self, action: PhysicalAction<T>, at: At) -> Sender<T> {
        let subject =
            |graph: &Self| format!("program {} has no sender for", graph.parts.program_name());
        match self.own::<ActionId>(action.0, at, subject) {
            Some(action) => self.entrances.sender(action),
            None => Sender::to_nothing(action.0.id),
        }
    }

    /// The next reaction of a reactor.
    pub(super) fn reaction(
        &mut self,
        reactor: ReactorId,
        spec: ReactionSpec,
        at: At,
    ) -> ReactionId {
        let reaction = self.parts.reaction(reactor, spec);
        self.sites.reactions.insert(reaction, at);
        reaction
    }

    /// Connects ports, one by one. Those of another program are left out, and are mistakes.
    pub(super) fn connect(
        &mut self,
        from: Vec<Of<PortId>>,
        to: Vec<Of<PortId>>,
        mode: Option<ModeId>,
        at: At,
    ) -> Connections<'_> {
        let mistakes = self.mistakes.len();
        let [from, to] = [from, to].map(|ports| self.own_ports(ports, at));
        if from.len() != to.len() && mistakes == self.mistakes.len() {
            let named = |ports: &[PortId]| match ports {
                [] => "no port".to_owned(),
                [port] => format!("one port ({})", self.parts.port_name(*port)),
                [port, ..] => {
                    format!("{} ports ({}, …)", ports.len(), self.parts.port_name(*port))
                }
            };
            let message = format!("cannot connect {} to {}", named(&from), named(&to));
            let hint = "`connect_each` needs as many on both sides; connect one port to several with `connect`";
            self.mistake(at, message, hint);
        }
        let new = self.connections.len();
        for (from, to) in from.into_iter().zip(to) {
            self.sites.connections.insert((from, to), at);
            self.connections.push(Connection {
                from,
                to,
                delay: Delay::None,
                physical: false,
                serializer: None,
                absent_after: 0,
                compress: false,
                bound: None,
                mode,
            });
        }
        Connections(&mut self.connections[new..])
    }

    fn own_ports(&mut self, ports: Vec<Of<PortId>>, at: At) -> Vec<PortId> {
        let subject =
            |graph: &Self| format!("program {} cannot connect", graph.parts.program_name());
        ports.into_iter().filter_map(|port| self.own(port, at, subject)).collect()
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
            Err(Unbuilt::Wrong(mistake)) => return Err(self.sites.placed(mistake)),
            Err(Unbuilt::Differs(report)) => return Err(Failure::Mistakes(vec![*report])),
        };
        let mistakes = mistakes(&program, &self.sites);
        if !mistakes.is_empty() {
            return Err(Failure::Mistakes(mistakes));
        }
        let bodies = self.bodies.of(&program, self.identity);
        Ok((program, bodies, self.entrances))
    }
}

/// What is out of reach where it is named.
fn mistakes(program: &Program, sites: &Sites) -> Vec<Report> {
    fn at(report: Report, site: Option<&At>) -> Report {
        match site {
            Some(site) => located(report, site),
            None => report,
        }
    }
    let connections = program.connections.values().filter_map(|connection| {
        let site = sites.connections.get(&(connection.from, connection.to));
        stray_connection(program, connection).map(|report| at(report, site))
    });
    let reactions = program.reactions.ids().flat_map(|id| {
        let site = sites.reactions.get(&id);
        stray_effects(program, id).into_iter().map(move |report| at(report, site))
    });
    connections.chain(reactions).collect()
}

fn report(message: String) -> Report {
    Report::new(Kind::Program, message)
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
    let [from, to] = [from, to].map(|port| &program.ports[*port]);
    let are_beside = program.reactors[from.reactor].parent == program.reactors[to.reactor].parent;
    let [leads_from, leads_to] = [from, to].map(|port| match port.direction {
        Direction::Input => "an input",
        Direction::Output => "an output",
    });
    let [from, to] = [connection.from, connection.to].map(|port| program.port_name(port));
    if are_beside {
        let message =
            format!("the connection {from} -> {to} leads from {leads_from} to {leads_to}");
        let hint = "between two reactors that are beside one another, `connect(from, to)` leads from an output to an \
                    input";
        return Some(report(message).hint(hint));
    }
    let message = format!("the connection {from} -> {to} does not lie in one reactor");
    let hint = "a reactor connects its own ports and those of the reactors directly inside it: lead the value through \
                ports of the reactors in between";
    Some(report(message).hint(hint))
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
        report(message).hint(hint)
    };
    let reads = |port: PortId| {
        let hint = "a reaction reads inputs of its reactor, and outputs of reactors directly inside it: connect the port \
                    to one of those";
        (!has(port, Direction::Input)).then(|| stray("read", program.port_name(port), hint))
    };
    let triggers = reaction.triggers.iter().filter_map(|trigger| match *trigger {
        Trigger::Port(port) => reads(port),
        Trigger::Action(action) => foreign_action(program, here, action)
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
        Effect::Action(action) => foreign_action(program, here, action)
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
fn foreign_action(program: &Program, here: ReactorId, action: ActionId) -> Option<String> {
    let action = &program.actions[action];
    (action.reactor != here)
        .then(|| format!("{}.{}", program.reactors[action.reactor].name, action.name))
}
