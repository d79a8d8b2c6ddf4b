//! Building a [`Program`]: the one place that validates the instance graph.
//!
//! The builder checks what the runtime relies on: one source per port, no causality loop, federates
//! at the top level. What a source language forbids beyond that is for its front end to say.

use crate::level::{self, Loop, Precedence};
use crate::{
    Action, ActionId, Channel, Connection, ConnectionId, Delay, Direction, Effect, Federate,
    FederateId, Nanos, Origin, Port, PortId, Program, Properties, Reaction, ReactionId, Reactor,
    ReactorId, Spacing, Table, Timer, TimerId, Trigger,
};

/// Why a graph is not a program.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ProgramError {
    /// Reactions that each must run before the next at the same tag, in a circle.
    #[error("reactions depend on one another in a circle, without a delay: {names}")]
    CausalityLoop {
        /// The circle; the last precedes the first.
        reactions: Vec<ReactionId>,
        /// Their names, with arrows.
        names: String,
    },
    /// A port that two connections set, or a connection and a reaction.
    #[error("port {name} has two sources")]
    TwoSources {
        /// The port.
        port: PortId,
        /// Its full name.
        name: String,
        /// The connections that set it; one, if the other source is a reaction.
        connections: Vec<ConnectionId>,
    },
    /// Connections that lead in a circle, with no reaction among them.
    #[error("port {name} is connected to itself, through other ports")]
    ConnectionLoop {
        /// A port of the circle.
        port: PortId,
        /// Its full name.
        name: String,
    },
    /// A federated program with reactions, timers or actions outside its federates.
    #[error("{name} belongs to no federate")]
    OutsideFederates {
        /// The reactor that holds it.
        reactor: ReactorId,
        /// What it is.
        name: String,
    },
}

/// The parts of a [`Reaction`] that are chosen, not computed.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct ReactionSpec {
    /// What makes it run.
    pub triggers: Vec<Trigger>,
    /// Ports that it reads without being triggered by them.
    pub sources: Vec<PortId>,
    /// What it may do.
    pub effects: Vec<Effect>,
    /// Lag beyond which its deadline handler runs instead.
    pub deadline: Option<Nanos>,
    /// Whether it declares what to do when an input is tardy.
    pub handles_tardy: bool,
}

/// Collects the parts of a program.
///
/// ```
/// use hprm_core::{Delay, Direction, Effect, ProgramBuilder, Properties, ReactionSpec, Trigger};
///
/// let mut b = ProgramBuilder::new("Main", Properties::default());
/// let [a, c] = ["a", "c"].map(|name| b.reactor(b.main(), name));
/// let out = b.port(a, "out", Direction::Output);
/// let inp = b.port(c, "inp", Direction::Input);
/// b.connect(out, inp, Delay::None);
/// let first = b.reaction(a, ReactionSpec {
///     triggers: vec![Trigger::Startup],
///     effects: vec![Effect::Port(out)],
///     ..ReactionSpec::default()
/// });
/// let second = b.reaction(c, ReactionSpec {
///     triggers: vec![Trigger::Port(inp)],
///     ..ReactionSpec::default()
/// });
/// let program = b.build().unwrap();
/// assert!(program.reactions[first].level < program.reactions[second].level);
/// ```
#[derive(Clone, Debug)]
pub struct ProgramBuilder {
    program: Program,
    /// How many reactions each reactor has so far.
    reactions: Table<ReactorId, u32>,
}

impl ProgramBuilder {
    /// A program whose main reactor has that name.
    #[must_use]
    pub fn new(name: &str, properties: Properties) -> Self {
        let mut reactors = Table::new();
        reactors.push(Reactor { name: name.to_owned(), parent: None, federate: None });
        Self {
            reactions: Table::filled(1, 0),
            program: Program {
                name: name.to_owned(),
                properties,
                reactors,
                ports: Table::new(),
                actions: Table::new(),
                timers: Table::new(),
                reactions: Table::new(),
                connections: Table::new(),
                federates: Table::new(),
                channels: Table::new(),
            },
        }
    }

    /// The main reactor.
    #[must_use]
    pub fn main(&self) -> ReactorId {
        ReactorId(0)
    }

    /// A reactor inside `parent`; `name` has its index if it is in a bank: `gain[2]`.
    pub fn reactor(&mut self, parent: ReactorId, name: &str) -> ReactorId {
        let name = format!("{}.{name}", self.program.reactors[parent].name);
        let federate = self.program.reactors[parent].federate;
        self.reactions.push(0);
        self.program.reactors.push(Reactor { name, parent: Some(parent), federate })
    }

    /// Makes a top-level reactor a federate. Call it before the reactor gets contents.
    ///
    /// # Panics
    ///
    /// If the reactor is not directly inside the main reactor.
    pub fn federate(
        &mut self,
        reactor: ReactorId,
        name: &str,
        maxwait: Nanos,
        host: Option<String>,
    ) -> FederateId {
        assert_eq!(self.program.reactors[reactor].parent, Some(self.main()));
        let id =
            self.program.federates.push(Federate { name: name.to_owned(), reactor, maxwait, host });
        self.program.reactors[reactor].federate = Some(id);
        id
    }

    /// A channel of a port; `name` has its index if it is of a multiport: `out[2]`.
    pub fn port(&mut self, reactor: ReactorId, name: &str, direction: Direction) -> PortId {
        self.program.ports.push(Port { name: name.to_owned(), reactor, direction })
    }

    /// An action.
    pub fn action(
        &mut self,
        reactor: ReactorId,
        name: &str,
        origin: Origin,
        min_delay: Nanos,
    ) -> ActionId {
        self.program.actions.push(Action {
            name: name.to_owned(),
            reactor,
            origin,
            min_delay,
            spacing: None,
        })
    }

    /// Gives an action a minimum spacing.
    pub fn space(&mut self, action: ActionId, spacing: Spacing) {
        self.program.actions[action].spacing = Some(spacing);
    }

    /// A timer.
    pub fn timer(
        &mut self,
        reactor: ReactorId,
        name: &str,
        offset: Nanos,
        period: Nanos,
    ) -> TimerId {
        self.program.timers.push(Timer { name: name.to_owned(), reactor, offset, period })
    }

    /// The next reaction of `reactor`.
    pub fn reaction(&mut self, reactor: ReactorId, spec: ReactionSpec) -> ReactionId {
        self.reactions[reactor] += 1;
        self.program.reactions.push(Reaction {
            reactor,
            number: self.reactions[reactor],
            triggers: spec.triggers,
            sources: spec.sources,
            effects: spec.effects,
            deadline: spec.deadline,
            handles_tardy: spec.handles_tardy,
            level: 0,
            inferred_deadline: Nanos::MAX,
        })
    }

    /// A plain connection; see [`Self::connection`] for the rest.
    pub fn connect(&mut self, from: PortId, to: PortId, delay: Delay) -> ConnectionId {
        let (physical, serializer, absent_after) = (false, None, 0);
        self.connection(Connection { from, to, delay, physical, serializer, absent_after })
    }

    /// A connection.
    pub fn connection(&mut self, connection: Connection) -> ConnectionId {
        self.program.connections.push(connection)
    }

    /// Checks the graph, finds levels and channels.
    ///
    /// # Errors
    ///
    /// The first rule that the graph breaks.
    pub fn build(mut self) -> Result<Program, ProgramError> {
        self.check_sources()?;
        self.check_federates()?;
        self.find_channels();
        match level::precedence(&self.program) {
            Ok(Precedence { levels, inferred_deadlines }) => {
                for id in levels.ids() {
                    let reaction = &mut self.program.reactions[id];
                    reaction.level = levels[id];
                    reaction.inferred_deadline = inferred_deadlines[id];
                }
                Ok(self.program)
            }
            Err(Loop(reactions)) => {
                let names: Vec<_> =
                    reactions.iter().map(|r| self.program.reaction_name(*r)).collect();
                Err(ProgramError::CausalityLoop { reactions, names: names.join(" -> ") })
            }
        }
    }

    fn check_sources(&self) -> Result<(), ProgramError> {
        let program = &self.program;
        let mut source: Table<PortId, Option<ConnectionId>> =
            Table::filled(program.ports.len(), None);
        for (id, connection) in program.connections.iter() {
            if let Some(earlier) = source[connection.to].replace(id) {
                return Err(self.two_sources(connection.to, vec![earlier, id]));
            }
        }
        self.check_circles(&source)?;
        let effects = program.reactions.values().flat_map(|reaction| &reaction.effects);
        for effect in effects {
            if let Effect::Port(port) = *effect
                && let Some(connection) = source[port]
            {
                return Err(self.two_sources(port, vec![connection]));
            }
        }
        Ok(())
    }

    /// A circle of plain connections holds no value that anything could have set.
    fn check_circles(
        &self,
        source: &Table<PortId, Option<ConnectionId>>,
    ) -> Result<(), ProgramError> {
        let connections = &self.program.connections;
        for port in source.ids() {
            let mut here = port;
            for _ in 0..=source.len() {
                match source[here].map(|id| &connections[id]).filter(|c| c.is_direct()) {
                    Some(connection) => here = connection.from,
                    None => break,
                }
                if here == port {
                    let name = self.program.port_name(port);
                    return Err(ProgramError::ConnectionLoop { port, name });
                }
            }
        }
        Ok(())
    }

    fn two_sources(&self, port: PortId, connections: Vec<ConnectionId>) -> ProgramError {
        ProgramError::TwoSources { port, name: self.program.port_name(port), connections }
    }

    fn check_federates(&self) -> Result<(), ProgramError> {
        let program = &self.program;
        if !program.is_federated() {
            return Ok(());
        }
        let reactions =
            program.reactions.iter().map(|(id, r)| (r.reactor, program.reaction_name(id)));
        let actions = program.actions.values().map(|a| (a.reactor, a.name.clone()));
        let timers = program.timers.values().map(|t| (t.reactor, t.name.clone()));
        reactions
            .chain(actions)
            .chain(timers)
            .find(|(reactor, _)| program.reactors[*reactor].federate.is_none())
            .map_or(Ok(()), |(reactor, name)| Err(ProgramError::OutsideFederates { reactor, name }))
    }

    /// A connection between two federates becomes a channel if a reaction writes into it at one end
    /// and one reads from it at the other.
    fn find_channels(&mut self) {
        let program = &self.program;
        let written = reachable(
            program,
            |c| (c.from, c.to),
            |reaction, mark| {
                reaction.effects.iter().for_each(|effect| {
                    if let Effect::Port(port) = effect {
                        mark(*port);
                    }
                });
            },
        );
        let read = reachable(
            program,
            |c| (c.to, c.from),
            |reaction, mark| {
                reaction.sources.iter().for_each(|port| mark(*port));
                reaction.triggers.iter().for_each(|trigger| {
                    if let Trigger::Port(port) = trigger {
                        mark(*port);
                    }
                });
            },
        );
        let federate = |port: PortId| program.reactors[program.ports[port].reactor].federate;
        self.program.channels = program
            .connections
            .iter()
            .filter(|(_, c)| written[c.from] && read[c.to])
            .filter_map(|(connection, c)| {
                let (from, to) = (federate(c.from)?, federate(c.to)?);
                let Connection { delay, physical, .. } = *c;
                (from != to).then_some(Channel { connection, from, to, delay, physical })
            })
            .collect();
    }
}

/// The ports that reactions mark, and those that connections lead to from there.
fn reachable(
    program: &Program,
    ends: impl Fn(&Connection) -> (PortId, PortId),
    marks: impl Fn(&Reaction, &mut dyn FnMut(PortId)),
) -> Table<PortId, bool> {
    let mut reached = Table::filled(program.ports.len(), false);
    let mut next: Table<PortId, Vec<PortId>> = Table::filled(program.ports.len(), Vec::new());
    for connection in program.connections.values() {
        let (here, there) = ends(connection);
        next[here].push(there);
    }
    let mut pending = Vec::new();
    for reaction in program.reactions.values() {
        marks(reaction, &mut |port| pending.push(port));
    }
    while let Some(port) = pending.pop() {
        if !std::mem::replace(&mut reached[port], true) {
            pending.extend(&next[port]);
        }
    }
    reached
}

#[cfg(test)]
mod tests {
    use super::*;

    fn two_reactors() -> (ProgramBuilder, [PortId; 4]) {
        let mut b = ProgramBuilder::new("Main", Properties::default());
        let [a, c] = ["a", "c"].map(|name| b.reactor(b.main(), name));
        let a_out = b.port(a, "out", Direction::Output);
        let a_in = b.port(a, "inp", Direction::Input);
        let c_out = b.port(c, "out", Direction::Output);
        let c_in = b.port(c, "inp", Direction::Input);
        for (reactor, from, to) in [(a, a_in, a_out), (c, c_in, c_out)] {
            b.reaction(
                reactor,
                ReactionSpec {
                    triggers: vec![Trigger::Port(from)],
                    effects: vec![Effect::Port(to)],
                    ..ReactionSpec::default()
                },
            );
        }
        (b, [a_out, a_in, c_out, c_in])
    }

    #[test]
    fn a_loop_without_delay_is_named() {
        let (mut b, [a_out, a_in, c_out, c_in]) = two_reactors();
        b.connect(a_out, c_in, Delay::None);
        b.connect(c_out, a_in, Delay::None);
        let error = b.build().unwrap_err();
        assert!(
            matches!(&error, ProgramError::CausalityLoop { reactions, .. } if reactions.len() == 2)
        );
        assert!(error.to_string().contains("Main.a.1 -> Main.c.1"), "{error}");
    }

    #[test]
    fn a_microstep_breaks_a_loop() {
        let (mut b, [a_out, a_in, c_out, c_in]) = two_reactors();
        b.connect(a_out, c_in, Delay::None);
        b.connect(c_out, a_in, Delay::Microstep);
        assert!(b.build().is_ok());
    }

    #[test]
    fn a_port_has_one_source() {
        let (mut b, [a_out, _, c_out, c_in]) = two_reactors();
        b.connect(a_out, c_in, Delay::None);
        b.connect(c_out, c_in, Delay::Microstep);
        let error = b.build().unwrap_err();
        assert_eq!(error.to_string(), "port Main.c.inp has two sources");
    }

    #[test]
    fn only_what_is_written_and_read_crosses_the_network() {
        let mut b = ProgramBuilder::new("Main", Properties::default());
        let [a, c] = ["a", "c"].map(|name| b.reactor(b.main(), name));
        for (reactor, name) in [(a, "a"), (c, "c")] {
            b.federate(reactor, name, Nanos::MAX, None);
        }
        let out = b.port(a, "out", Direction::Output);
        let inp = b.port(c, "inp", Direction::Input);
        b.connect(out, inp, Delay::None);
        b.reaction(
            a,
            ReactionSpec {
                triggers: vec![Trigger::Startup],
                effects: vec![Effect::Port(out)],
                ..ReactionSpec::default()
            },
        );
        let unread = b.clone().build().unwrap();
        assert!(unread.channels.is_empty());
        b.reaction(
            c,
            ReactionSpec { triggers: vec![Trigger::Port(inp)], ..ReactionSpec::default() },
        );
        let read = b.build().unwrap();
        assert_eq!(read.channels.len(), 1);
        assert_ne!(read.fingerprint(), unread.fingerprint());
    }
}
