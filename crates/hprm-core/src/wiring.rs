//! What a scheduler needs to know of the graph to move values: computed once, then only indexed.
//!
//! A value is kept where it is written. A port that a plain connection feeds is an alias of the
//! port at the other end, its root; so a fan-out to a thousand inputs costs nothing until somebody
//! reads. Network inputs and the ends of delayed connections are roots of their own, and so is the
//! end of a connection that carries something in one mode only: a relay.

use crate::{
    ActionId, ChannelId, ConnectionId, FederateId, ModeId, PortId, Program, Reaction, ReactionId,
    ReactorId, Table, TimerId, Trigger,
};

/// Which share of a program a scheduler runs.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Scope {
    /// All of it, in one process, with no network.
    Whole,
    /// The reactors of one federate.
    Federate(FederateId),
}

/// Tables derived from a program for one scope.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(crate) struct Wiring {
    /// The port that holds each port's value.
    pub(crate) root: Table<PortId, PortId>,
    /// Reactions that a value at a root triggers.
    pub(crate) triggered_by_port: Table<PortId, Vec<ReactionId>>,
    /// Reactions that an action's event triggers.
    pub(crate) triggered_by_action: Table<ActionId, Vec<ReactionId>>,
    /// Reactions that a timer's event triggers.
    pub(crate) triggered_by_timer: Table<TimerId, Vec<ReactionId>>,
    /// Reactions to the start.
    pub(crate) startup: Vec<ReactionId>,
    /// Reactions to the end.
    pub(crate) shutdown: Vec<ReactionId>,
    /// Plain connections that carry a value on if their mode is active, by root.
    pub(crate) relays: Table<PortId, Vec<ConnectionId>>,
    /// What modes enclose.
    pub(crate) modes: ModeWiring,
    /// Delayed and physical connections, by root, that stay within the scope.
    pub(crate) delayed: Table<PortId, Vec<ConnectionId>>,
    /// Channels to other federates, by root.
    pub(crate) outgoing: Table<PortId, Vec<ChannelId>>,
    /// Timers in the scope.
    pub(crate) timers: Vec<TimerId>,
    /// When each reaction takes its turn at a tag; those of one rank go in the order of the program.
    /// Whatever precedes a reaction has a lower rank.
    pub(crate) rank: Table<ReactionId, usize>,
    /// How many ranks there are.
    pub(crate) ranks: usize,
}

/// What modes enclose, innermost first; all tables are full even where there are no modes.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(crate) struct ModeWiring {
    /// Reactors with modes in the scope, containers before their contents, and their modes.
    pub(crate) reactors: Vec<Modal>,
    /// Reactions to the reset of their mode.
    pub(crate) resets: Vec<ReactionId>,
    pub(crate) outer: Table<ModeId, Option<ModeId>>,
    pub(crate) of_reaction: Table<ReactionId, Option<ModeId>>,
    pub(crate) of_action: Table<ActionId, Option<ModeId>>,
    pub(crate) of_timer: Table<TimerId, Option<ModeId>>,
    pub(crate) of_connection: Table<ConnectionId, Option<ModeId>>,
}

/// A reactor with modes.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(crate) struct Modal {
    pub(crate) reactor: ReactorId,
    pub(crate) modes: Vec<ModeId>,
    pub(crate) initial: ModeId,
    /// The mode of another reactor that encloses it.
    pub(crate) outer: Option<ModeId>,
}

impl Scope {
    /// Whether `reactor` runs in this scope.
    pub(crate) fn contains(self, program: &Program, reactor: ReactorId) -> bool {
        match self {
            Self::Whole => true,
            Self::Federate(federate) => program.reactors[reactor].federate == Some(federate),
        }
    }
}

impl Wiring {
    pub(crate) fn new(program: &Program, scope: Scope) -> Self {
        let root = roots(program, scope);
        let mut wiring = Self {
            triggered_by_port: Table::filled(program.ports.len(), Vec::new()),
            triggered_by_action: Table::filled(program.actions.len(), Vec::new()),
            triggered_by_timer: Table::filled(program.timers.len(), Vec::new()),
            startup: Vec::new(),
            shutdown: Vec::new(),
            relays: Table::filled(program.ports.len(), Vec::new()),
            modes: ModeWiring::new(program, scope),
            delayed: Table::filled(program.ports.len(), Vec::new()),
            outgoing: Table::filled(program.ports.len(), Vec::new()),
            timers: Vec::new(),
            rank: Table::filled(program.reactions.len(), 0),
            ranks: 0,
            root,
        };
        wiring.find_triggers(program, scope);
        wiring.find_ranks(program, scope);
        wiring.find_connections(program, scope);
        wiring.timers = program
            .timers
            .iter()
            .filter(|(_, timer)| scope.contains(program, timer.reactor))
            .map(|(id, _)| id)
            .collect();
        wiring
    }

    fn find_triggers(&mut self, program: &Program, scope: Scope) {
        let local = program.reactions.iter().filter(|(_, r)| scope.contains(program, r.reactor));
        for (id, reaction) in local {
            for trigger in &reaction.triggers {
                let reactions = match *trigger {
                    Trigger::Startup => &mut self.startup,
                    Trigger::Shutdown => &mut self.shutdown,
                    Trigger::Reset => &mut self.modes.resets,
                    Trigger::Timer(timer) => &mut self.triggered_by_timer[timer],
                    Trigger::Action(action) => &mut self.triggered_by_action[action],
                    Trigger::Port(port) => &mut self.triggered_by_port[self.root[port]],
                };
                if reactions.last() != Some(&id) {
                    reactions.push(id);
                }
            }
        }
    }

    /// By level, and if deadlines go first, by inferred deadline before that, as in Lingua Franca. A reaction's inferred deadline is no later than those of the reactions after it, so
    /// either way it comes before them.
    fn find_ranks(&mut self, program: &Program, scope: Scope) {
        let key = |reaction: &Reaction| {
            let by_deadline = program.properties.deadlines_first;
            (if by_deadline { reaction.inferred_deadline } else { 0 }, reaction.level)
        };
        let local = |reaction: &&Reaction| scope.contains(program, reaction.reactor);
        let mut keys: Vec<_> = program.reactions.values().filter(local).map(key).collect();
        keys.sort_unstable();
        keys.dedup();
        self.ranks = keys.len();
        for (id, reaction) in program.reactions.iter() {
            // One from elsewhere never runs here, and its rank says nothing.
            self.rank[id] = keys.binary_search(&key(reaction)).unwrap_or_default();
        }
    }

    fn find_connections(&mut self, program: &Program, scope: Scope) {
        let conditional = program.conditional_connections();
        for (id, connection) in program.connections.iter() {
            let local = [connection.from, connection.to]
                .iter()
                .all(|port| scope.contains(program, program.ports[*port].reactor));
            // A connection at the top of a federated program has both ends in federates, so one
            // that is not local either is a channel or belongs to others.
            if local && conditional[id] {
                self.relays[self.root[connection.from]].push(id);
            } else if local && !connection.is_direct() {
                self.delayed[self.root[connection.from]].push(id);
            }
        }
        if let Scope::Federate(federate) = scope {
            for (id, channel) in program.channels.iter().filter(|(_, c)| c.from == federate) {
                let from = program.connections[channel.connection].from;
                self.outgoing[self.root[from]].push(id);
            }
        }
    }
}

impl ModeWiring {
    fn new(program: &Program, scope: Scope) -> Self {
        let enclosing = |reactor, own| program.enclosing_mode(reactor, own);
        let mut reactors: Vec<Modal> = Vec::new();
        for (id, mode) in program.modes.iter() {
            if !scope.contains(program, mode.reactor) {
                continue;
            }
            match reactors.iter_mut().find(|modal| modal.reactor == mode.reactor) {
                Some(modal) => {
                    modal.modes.push(id);
                    if mode.initial {
                        modal.initial = id;
                    }
                }
                None => reactors.push(Modal {
                    reactor: mode.reactor,
                    modes: vec![id],
                    initial: id,
                    outer: program.outer_mode(id),
                }),
            }
        }
        let depth = |modal: &Modal| program.modes_around(modal.outer).count();
        reactors.sort_by_key(depth);
        Self {
            reactors,
            resets: Vec::new(),
            outer: program.modes.ids().map(|mode| program.outer_mode(mode)).collect(),
            of_reaction: program.reactions.ids().map(|id| program.mode_of_reaction(id)).collect(),
            of_action: program.actions.values().map(|a| enclosing(a.reactor, a.mode)).collect(),
            of_timer: program.timers.values().map(|t| enclosing(t.reactor, t.mode)).collect(),
            of_connection: program
                .connections
                .ids()
                .map(|id| program.mode_of_connection(id))
                .collect(),
        }
    }
}

/// Follows plain connections upstream, as far as the scope reaches.
fn roots(program: &Program, scope: Scope) -> Table<PortId, PortId> {
    let mut upstream: Table<PortId, Option<PortId>> = Table::filled(program.ports.len(), None);
    let conditional = program.conditional_connections();
    let direct = program.connections.iter().filter(|(id, c)| c.is_direct() && !conditional[*id]);
    for (_, connection) in direct {
        let crosses = scope != Scope::Whole && program.crosses_federates(connection);
        if !crosses {
            upstream[connection.to] = Some(connection.from);
        }
    }
    upstream
        .ids()
        .map(|port| {
            let mut root = port;
            // Terminates: a circle of plain connections has no source and was never built.
            let mut hops = 0;
            while let Some(next) = upstream[root] {
                root = next;
                hops += 1;
                assert!(hops <= program.ports.len(), "a circle of connections without a reaction");
            }
            root
        })
        .collect()
}
