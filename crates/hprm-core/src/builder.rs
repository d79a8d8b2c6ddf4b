//! Building a [`Program`]: the one place that validates the instance graph.
//!
//! The builder checks what the runtime relies on: one source per port, no causality loop, federates
//! at the top level. A front end reports what its source language forbids beyond that.

use alloc::borrow::ToOwned;
use alloc::boxed::Box;
use alloc::collections::BTreeSet;
use alloc::format;
use alloc::string::String;
use alloc::vec;
use alloc::vec::Vec;

use crate::bound::blocking::{Unsafe, unsafe_blocking};
use crate::level::{self, CausalityLoop, Precedence};
use crate::reach;
use crate::{
    Action, ActionId, Channel, Connection, ConnectionId, Delay, Direction, Effect, Federate,
    FederateId, ModalElement, Mode, ModeId, Nanos, Origin, Port, PortId, Program, Properties,
    Reaction, ReactionId, Reactor, ReactorId, Restart, Spacing, Table, Timer, TimerId, Trigger,
};

/// Why a graph is not a program.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ProgramError {
    /// Reactions that each must run before the next at the same tag, in a cycle.
    #[error("reactions depend on one another in a cycle without a delay: {names}")]
    CausalityLoop {
        /// The cycle; the last precedes the first.
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
    /// A connection that blocks its sender, and whose receiver may wait for the sender.
    #[error("connection {name} must not block its sender: {why}")]
    Blocking {
        /// The connection.
        connection: ConnectionId,
        /// Its ends.
        name: String,
        /// Why not.
        why: String,
    },
    /// Connections that form a cycle, with no reaction among them.
    #[error("port {name} is connected to itself, through other ports")]
    ConnectionLoop {
        /// A port of the cycle.
        port: PortId,
        /// Its full name.
        name: String,
    },
    /// A reactor with modes of which not exactly one is initial.
    #[error("reactor {name} has modes, but not exactly one of them is initial")]
    InitialMode {
        /// The reactor.
        reactor: ReactorId,
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
    /// What users call it, if the program names it.
    pub label: Option<Box<str>>,
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
        reactors.push(Reactor { name: name.to_owned(), parent: None, mode: None, federate: None });
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
                modes: Table::new(),
                connections: Table::new(),
                federates: Table::new(),
                channels: Table::new(),
            },
        }
    }

    /// Replaces the target properties.
    pub fn set_properties(&mut self, properties: Properties) {
        self.program.properties = properties;
    }

    /// The full name of a reactor.
    #[must_use]
    pub fn reactor_name(&self, reactor: ReactorId) -> &str {
        &self.program.reactors[reactor].name
    }

    /// The full name of a port.
    #[must_use]
    pub fn port_name(&self, port: PortId) -> String {
        self.program.port_name(port)
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
        self.program.reactors.push(Reactor { name, parent: Some(parent), mode: None, federate })
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
        let name = name.to_owned();
        let federate = Federate { name, reactor, maxwait, host, transient: false, restart: None };
        let id = self.program.federates.push(federate);
        self.program.reactors[reactor].federate = Some(id);
        id
    }

    /// Lets a federate join late, leave, and come back.
    pub fn make_transient(&mut self, federate: FederateId) {
        self.program.federates[federate].transient = true;
    }

    /// Has a federate started again when it has ended. It is transient then.
    pub fn restart(&mut self, federate: FederateId, restart: Restart) {
        self.make_transient(federate);
        self.program.federates[federate].restart = Some(restart);
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
            mode: None,
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
        self.program.timers.push(Timer {
            name: name.to_owned(),
            reactor,
            offset,
            period,
            mode: None,
        })
    }

    /// The next reaction of `reactor`.
    pub fn reaction(&mut self, reactor: ReactorId, spec: ReactionSpec) -> ReactionId {
        self.reactions[reactor] += 1;
        self.program.reactions.push(Reaction {
            reactor,
            number: self.reactions[reactor],
            label: spec.label,
            triggers: spec.triggers,
            sources: spec.sources,
            effects: spec.effects,
            deadline: spec.deadline,
            handles_tardy: spec.handles_tardy,
            mode: None,
            level: 0,
            inferred_deadline: Nanos::MAX,
        })
    }

    /// A reaction of `reactor` that the program does not write: it has no number. It runs before
    /// those that are added after it.
    pub fn added_reaction(&mut self, reactor: ReactorId, trigger: Trigger) -> ReactionId {
        let spec = ReactionSpec { triggers: vec![trigger], ..ReactionSpec::default() };
        let id = self.reaction(reactor, spec);
        self.program.reactions[id].number = 0;
        self.reactions[reactor] -= 1;
        id
    }

    /// A mode of `reactor`. Exactly one of a reactor's modes is initial.
    pub fn mode(&mut self, reactor: ReactorId, name: &str, initial: bool) -> ModeId {
        self.program.modes.push(Mode { name: name.to_owned(), reactor, initial })
    }

    /// Puts an element into a mode of the reactor that declares it.
    pub fn put_in_mode(&mut self, element: ModalElement, mode: ModeId) {
        let program = &mut self.program;
        let place = match element {
            ModalElement::Reactor(id) => &mut program.reactors[id].mode,
            ModalElement::Action(id) => &mut program.actions[id].mode,
            ModalElement::Timer(id) => &mut program.timers[id].mode,
            ModalElement::Reaction(id) => &mut program.reactions[id].mode,
            ModalElement::Connection(id) => &mut program.connections[id].mode,
        };
        *place = Some(mode);
    }

    /// A plain connection; see [`Self::connection`] for the rest.
    pub fn connect(&mut self, from: PortId, to: PortId, delay: Delay) -> ConnectionId {
        self.connection(Connection {
            from,
            to,
            delay,
            physical: false,
            serializer: None,
            absent_after: 0,
            compress: false,
            bound: None,
            mode: None,
        })
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
        self.check_modes()?;
        self.check_sources()?;
        self.check_cycles()?;
        self.check_federates()?;
        self.find_channels();
        match level::precedence(&self.program) {
            Ok(Precedence { levels, inferred_deadlines }) => {
                for id in levels.ids() {
                    let reaction = &mut self.program.reactions[id];
                    reaction.level = levels[id];
                    reaction.inferred_deadline = inferred_deadlines[id];
                }
                self.find_ends();
                self.check_blocking()?;
                Ok(self.program)
            }
            Err(CausalityLoop(reactions)) => {
                const SHOWN: usize = 20;
                let shown = reactions.iter().take(SHOWN).map(|r| self.program.reaction_label(*r));
                let mut names = shown.collect::<Vec<_>>().join(" -> ");
                if reactions.len() > SHOWN {
                    names.push_str(&format!(" -> {} more", reactions.len() - SHOWN));
                }
                Err(ProgramError::CausalityLoop { reactions, names })
            }
        }
    }

    fn check_modes(&self) -> Result<(), ProgramError> {
        let program = &self.program;
        let mut initial: Table<ReactorId, Option<bool>> =
            Table::filled(program.reactors.len(), None);
        for mode in program.modes.values() {
            let seen = initial[mode.reactor].get_or_insert(false);
            if *seen && mode.initial {
                return Err(self.not_one_initial(mode.reactor));
            }
            *seen |= mode.initial;
        }
        match initial.iter().find(|(_, seen)| **seen == Some(false)) {
            Some((reactor, _)) => Err(self.not_one_initial(reactor)),
            None => Ok(()),
        }
    }

    fn not_one_initial(&self, reactor: ReactorId) -> ProgramError {
        let name = self.program.reactors[reactor].name.clone();
        ProgramError::InitialMode { reactor, name }
    }

    /// A port has one source, or several of which no two are ever active together.
    fn check_sources(&self) -> Result<(), ProgramError> {
        let program = &self.program;
        let mut sources: Table<PortId, Vec<ConnectionId>> =
            Table::filled(program.ports.len(), Vec::new());
        let mode = |id: ConnectionId| program.connections[id].mode;
        for (id, connection) in program.connections.iter() {
            let others = &mut sources[connection.to];
            if let Some(other) = others.iter().find(|o| !program.are_exclusive(mode(**o), mode(id)))
            {
                return Err(self.two_sources(connection.to, vec![*other, id]));
            }
            others.push(id);
        }
        for (id, reaction) in program.reactions.iter() {
            for port in program.written_ports(id) {
                let shared = |c: &&ConnectionId| !program.are_exclusive(mode(**c), reaction.mode);
                if let Some(connection) = sources[port].iter().find(shared) {
                    return Err(self.two_sources(port, vec![*connection]));
                }
            }
        }
        Ok(())
    }

    /// A cycle of plain connections has no value, because no reaction could set one.
    fn check_cycles(&self) -> Result<(), ProgramError> {
        let program = &self.program;
        let mut followers: Table<PortId, Vec<PortId>> =
            Table::filled(program.ports.len(), Vec::new());
        let mut sources: Table<PortId, usize> = Table::filled(program.ports.len(), 0);
        for connection in program.connections.values().filter(|c| c.is_direct()) {
            followers[connection.from].push(connection.to);
            sources[connection.to] += 1;
        }
        // Remove, again and again, the connections that have no source left.
        let mut free: Vec<PortId> = sources.ids().filter(|port| sources[*port] == 0).collect();
        while let Some(port) = free.pop() {
            for follower in &followers[port] {
                sources[*follower] -= 1;
                if sources[*follower] == 0 {
                    free.push(*follower);
                }
            }
        }
        match sources.iter().find(|(_, left)| **left > 0) {
            Some((port, _)) => {
                let name = program.port_name(port);
                Err(ProgramError::ConnectionLoop { port, name })
            }
            None => Ok(()),
        }
    }

    fn two_sources(&self, port: PortId, connections: Vec<ConnectionId>) -> ProgramError {
        ProgramError::TwoSources { port, name: self.program.port_name(port), connections }
    }

    fn check_blocking(&self) -> Result<(), ProgramError> {
        let program = &self.program;
        let Some(Unsafe { connection, way }) = unsafe_blocking(program) else { return Ok(()) };
        let names: Vec<_> = way.iter().map(|me| program.federates[*me].name.as_str()).collect();
        let why = match (names.first(), names.last()) {
            (Some(receiver), Some(sender)) => format!(
                "its receiver {receiver} may wait for its sender {sender}, by the connections between \
                 {}, and then both would wait for ever",
                names.join(", ")
            ),
            _ => "its ends are not in different federates, and one process cannot wait for itself"
                .to_owned(),
        };
        let Connection { from, to, .. } = program.connections[connection];
        let name = format!("{} ~> {}", program.port_name(from), program.port_name(to));
        Err(ProgramError::Blocking { connection, name, why })
    }

    fn check_federates(&self) -> Result<(), ProgramError> {
        let program = &self.program;
        if !program.is_federated() {
            return Ok(());
        }
        let reactions =
            program.reactions.iter().map(|(id, r)| (r.reactor, program.reaction_label(id)));
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
        let (written, read) = (reach::written(program), reach::read(program));
        let federate = |port: PortId| program.reactors[program.ports[port].reactor].federate;
        self.program.channels = program
            .connections
            .iter()
            .filter(|(_, c)| written[c.from] && read[c.to])
            .filter_map(|(connection, c)| {
                let (from, to) = (federate(c.from)?, federate(c.to)?);
                let Connection { delay, physical, .. } = *c;
                let (last_writer, first_reader) = (0, u32::MAX);
                let channel =
                    Channel { connection, from, to, delay, physical, last_writer, first_reader };
                (from != to).then_some(channel)
            })
            .collect();
    }

    /// Finds the levels at which the two ends of each channel are written and read.
    fn find_ends(&mut self) {
        let program = &self.program;
        let none = || Table::filled(program.ports.len(), Vec::new());
        let (mut upstream, mut downstream) = (none(), none());
        let direct = program.connections.values().filter(|c| c.is_direct());
        for connection in direct.filter(|c| !program.crosses_federates(c)) {
            upstream[connection.to].push(connection.from);
            downstream[connection.from].push(connection.to);
        }
        let mut last_writer: Table<PortId, u32> = Table::filled(program.ports.len(), 0);
        let mut first_reader: Table<PortId, u32> = Table::filled(program.ports.len(), u32::MAX);
        for (id, reaction) in program.reactions.iter() {
            for port in program.written_ports(id) {
                last_writer[port] = last_writer[port].max(reaction.level);
            }
            for port in program.read_ports(id) {
                first_reader[port] = first_reader[port].min(reaction.level);
            }
        }
        let mut ends = Vec::with_capacity(program.channels.len());
        for channel in program.channels.values() {
            let connection = &program.connections[channel.connection];
            let (mut last, mut first) = (0, u32::MAX);
            follow(&upstream, connection.from, |port| last = last.max(last_writer[port]));
            follow(&downstream, connection.to, |port| first = first.min(first_reader[port]));
            ends.push((last, first));
        }
        for (id, (last, first)) in self.program.channels.ids().zip(ends) {
            let channel = &mut self.program.channels[id];
            (channel.last_writer, channel.first_reader) = (last, first);
        }
    }
}

/// Calls `found` for every port that direct connections within one federate lead to from `start`,
/// and for `start` itself. `next` lists, by port, where they lead.
fn follow(next: &Table<PortId, Vec<PortId>>, start: PortId, mut found: impl FnMut(PortId)) {
    let mut pending = vec![start];
    let mut seen = BTreeSet::from([start]);
    while let Some(port) = pending.pop() {
        found(port);
        pending.extend(next[port].iter().copied().filter(|port| seen.insert(*port)));
    }
}

#[cfg(test)]
mod tests {
    use alloc::string::ToString;

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
    fn a_reaction_that_reads_what_it_writes_is_a_loop() {
        let (mut b, [a_out, a_in, ..]) = two_reactors();
        b.connect(a_out, a_in, Delay::None);
        let error = b.build().unwrap_err();
        assert!(
            matches!(&error, ProgramError::CausalityLoop { reactions, .. } if reactions.len() == 1)
        );
        let (mut b, [a_out, a_in, ..]) = two_reactors();
        b.connect(a_out, a_in, Delay::Microstep);
        assert!(b.build().is_ok());
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
