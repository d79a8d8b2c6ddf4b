//! What a scheduler needs to know of the graph to move values: computed once, then only indexed.
//!
//! A value is kept where it is written. A port that a plain connection feeds is an alias of the
//! port at the other end, its root; so a fan-out to a thousand inputs costs nothing until a
//! reaction reads. Network inputs and the ends of delayed connections are roots of their own, and so is the
//! end of a connection that carries something in one mode only: a relay.

use alloc::vec::Vec;

mod modal;

pub(crate) use modal::ModeWiring;

use alloc::collections::BTreeSet;
use core::hash::{Hash, Hasher};

use crate::lists::Lists;
use crate::order::{Batch, Order, Position};
use crate::reach;
use crate::{
    ActionId, ChannelId, ConnectionId, FederateId, Port, PortId, Program, ReactionId, ReactorId,
    Scope, Table, TimerId, Trigger,
};

/// Tables derived from a program for one scope.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Wiring {
    /// Where a value that is set at each port goes.
    pub(crate) routes: Table<PortId, PortRoute>,
    /// Reactions that a value at a root triggers.
    pub(crate) triggered_by_port: Lists<PortId, Batch>,
    /// Reactions that an action's event triggers.
    pub(crate) triggered_by_action: Lists<ActionId, Batch>,
    /// Reactions that a timer's event triggers.
    pub(crate) triggered_by_timer: Lists<TimerId, Batch>,
    /// Reactions to the start.
    pub(crate) startup: Vec<ReactionId>,
    /// Reactions to the end.
    pub(crate) shutdown: Vec<ReactionId>,
    /// Reactions to the reset of their mode.
    pub(crate) resets: Vec<ReactionId>,
    /// Plain connections that carry a value on if their mode is active, by root.
    pub(crate) relays: Lists<PortId, ConnectionId>,
    /// Delayed and physical connections, by root, that stay within the scope.
    pub(crate) delayed: Lists<PortId, ConnectionId>,
    /// Delayed and physical connections, by root, that no reaction reads. They carry no values, but the
    /// program goes on until their messages would have arrived.
    pub(crate) unread: Lists<PortId, ConnectionId>,
    /// Channels to other federates, by root.
    pub(crate) outgoing: Lists<PortId, ChannelId>,
    /// Timers in the scope.
    pub(crate) timers: Vec<TimerId>,
    /// When each reaction takes its turn.
    pub(crate) order: Order,
    /// What modes enclose.
    pub(crate) modes: ModeWiring,
}

/// Where a value that is set at a port is kept, and what it triggers. For nearly all ports this is all
/// that has to be looked up.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub(crate) struct PortRoute {
    /// The port that holds the value.
    pub(crate) root: PortId,
    /// All reactions that it triggers, if they fit in one batch and there are no modes.
    pub(crate) triggers: Option<Batch>,
    /// Whether the value may appear at other roots at the same tag.
    pub(crate) has_relays: bool,
    /// Whether the value is sent when the tag is complete: there are delayed connections or channels.
    pub(crate) is_sent: bool,
}

/// It follows from a program, which never changes, and from the federates that have left, which a scheduler has in
/// `Departures`: states are told apart without it.
impl Hash for Wiring {
    fn hash<H: Hasher>(&self, _: &mut H) {}
}

impl Wiring {
    pub(crate) fn new(program: &Program, scope: Scope) -> Self {
        Self::without(program, scope, &[])
    }

    /// The same without what triggers reactions of federates that have left.
    pub(crate) fn without(program: &Program, scope: Scope, gone: &[FederateId]) -> Self {
        let read = reach::read(program);
        let root = roots(program, scope, &read);
        let order = Order::new(program, scope);
        let triggers = Triggers::new(program, scope, gone, (&root, &order));
        let outbound = OutboundConnections::new(program, scope, gone, (&root, &read));
        let ports = program.ports.len();
        let timers = program.timers.iter();
        let local = timers.filter(|(_, timer)| scope.contains(program, timer.reactor));
        let triggered_by_port = Lists::new(ports, Batch::all(triggers.by_port));
        Self {
            routes: outbound.routes(&root, |root| match triggered_by_port[root] {
                [] => Some(Batch::default()),
                [batch] if program.modes.is_empty() => Some(batch),
                _ => None,
            }),
            triggered_by_port,
            triggered_by_action: Lists::new(program.actions.len(), Batch::all(triggers.by_action)),
            triggered_by_timer: Lists::new(program.timers.len(), Batch::all(triggers.by_timer)),
            startup: triggers.startup,
            shutdown: triggers.shutdown,
            resets: triggers.resets,
            relays: Lists::new(ports, outbound.relays),
            delayed: Lists::new(ports, outbound.delayed),
            unread: Lists::new(ports, outbound.unread),
            outgoing: Lists::new(ports, outbound.outgoing),
            timers: local.map(|(id, _)| id).collect(),
            modes: ModeWiring::new(program, scope),
            order,
        }
    }

    /// The port that holds a port's value.
    #[inline]
    pub(crate) fn root(&self, port: PortId) -> PortId {
        self.routes[port].root
    }
}

/// Whether the federate of a reactor has left.
fn has_left(program: &Program, gone: &[FederateId], reactor: ReactorId) -> bool {
    program.reactors[reactor].federate.is_some_and(|federate| gone.contains(&federate))
}

/// What triggers what.
#[derive(Default)]
struct Triggers {
    by_port: Vec<(PortId, Position)>,
    by_action: Vec<(ActionId, Position)>,
    by_timer: Vec<(TimerId, Position)>,
    startup: Vec<ReactionId>,
    shutdown: Vec<ReactionId>,
    resets: Vec<ReactionId>,
}

impl Triggers {
    fn new(
        program: &Program,
        scope: Scope,
        gone: &[FederateId],
        (root, order): (&Table<PortId, PortId>, &Order),
    ) -> Self {
        let mut triggers = Self::default();
        let local = program.reactions.iter().filter(|(_, r)| scope.contains(program, r.reactor));
        for (id, reaction) in local.filter(|(_, r)| !has_left(program, gone, r.reactor)) {
            let position = order.position(id);
            for trigger in &reaction.triggers {
                match *trigger {
                    Trigger::Startup => triggers.startup.push(id),
                    Trigger::Shutdown => triggers.shutdown.push(id),
                    Trigger::Reset => triggers.resets.push(id),
                    Trigger::Timer(timer) => triggers.by_timer.push((timer, position)),
                    Trigger::Action(action) => triggers.by_action.push((action, position)),
                    Trigger::Port(port) => triggers.by_port.push((root[port], position)),
                }
            }
        }
        triggers
    }
}

/// The connections and channels that start at each root.
#[derive(Default)]
struct OutboundConnections {
    relays: Vec<(PortId, ConnectionId)>,
    delayed: Vec<(PortId, ConnectionId)>,
    unread: Vec<(PortId, ConnectionId)>,
    outgoing: Vec<(PortId, ChannelId)>,
}

impl OutboundConnections {
    fn new(
        program: &Program,
        scope: Scope,
        gone: &[FederateId],
        (root, read): (&Table<PortId, PortId>, &Table<PortId, bool>),
    ) -> Self {
        let mut outbound = Self::default();
        let conditional = program.conditional_connections();
        let ours = unread_from(program, scope, read);
        for (id, connection) in program.connections.iter() {
            if !read[connection.to] {
                // One in a mode is ignored: its sender may be another federate, which does not know
                // the mode.
                let counts = !connection.is_direct() && program.mode_of_connection(id).is_none();
                if counts && ours[connection.from] {
                    outbound.unread.push((root[connection.from], id));
                }
                continue;
            }
            let to = program.ports[connection.to].reactor;
            let local = [connection.from, connection.to]
                .iter()
                .all(|port| scope.contains(program, program.ports[*port].reactor));
            // A connection at the top of a federated program has both ends in federates, so one
            // that is not local either is a channel or concerns other federates.
            if local && conditional[id] {
                outbound.relays.push((root[connection.from], id));
            } else if local && !connection.is_direct() && !has_left(program, gone, to) {
                outbound.delayed.push((root[connection.from], id));
            }
        }
        if let Scope::Federate(federate) = scope {
            for (id, channel) in program.channels.iter().filter(|(_, c)| c.from == federate) {
                let from = program.connections[channel.connection].from;
                outbound.outgoing.push((root[from], id));
            }
        }
        outbound
    }

    fn routes(
        &self,
        roots: &Table<PortId, PortId>,
        triggers: impl Fn(PortId) -> Option<Batch>,
    ) -> Table<PortId, PortRoute> {
        let relays: BTreeSet<_> = self.relays.iter().map(|(root, _)| *root).collect();
        let delayed = self.delayed.iter().map(|(root, _)| *root);
        let outgoing = self.outgoing.iter().map(|(root, _)| *root);
        let unread = self.unread.iter().map(|(root, _)| *root);
        let sent: BTreeSet<_> = delayed.chain(outgoing).chain(unread).collect();
        let route = |root: &PortId| PortRoute {
            root: *root,
            triggers: triggers(*root),
            has_relays: relays.contains(root),
            is_sent: sent.contains(root),
        };
        roots.values().map(route).collect()
    }
}

/// The ports of the scope, and those in other federates that are connected to them and that no reaction
/// reads. No channel leads there, so the sender keeps track of their messages.
fn unread_from(program: &Program, scope: Scope, read: &Table<PortId, bool>) -> Table<PortId, bool> {
    let is_local = |port: &Port| scope.contains(program, port.reactor);
    let mut ours: Table<PortId, bool> = program.ports.values().map(is_local).collect();
    let mut followers: Table<PortId, Vec<PortId>> = Table::filled(program.ports.len(), Vec::new());
    for connection in program.connections.values().filter(|c| !read[c.to]) {
        followers[connection.from].push(connection.to);
    }
    let mut pending: Vec<PortId> = ours.ids().filter(|port| ours[*port]).collect();
    while let Some(port) = pending.pop() {
        for follower in &followers[port] {
            if !core::mem::replace(&mut ours[*follower], true) {
                pending.push(*follower);
            }
        }
    }
    ours
}

/// Follows plain connections upstream, as far as the scope reaches; and where no reaction reads,
/// beyond.
fn roots(program: &Program, scope: Scope, read: &Table<PortId, bool>) -> Table<PortId, PortId> {
    let mut upstream: Table<PortId, Option<PortId>> = Table::filled(program.ports.len(), None);
    let conditional = program.conditional_connections();
    let direct = program.connections.iter().filter(|(id, c)| c.is_direct() && !conditional[*id]);
    for (_, connection) in direct {
        let crosses =
            scope != Scope::Whole && read[connection.to] && program.crosses_federates(connection);
        if !crosses {
            upstream[connection.to] = Some(connection.from);
        }
    }
    upstream
        .ids()
        .map(|port| {
            let mut root = port;
            // Terminates: a cycle of plain connections has no source, and the builder refuses it.
            let mut hops = 0;
            while let Some(next) = upstream[root] {
                root = next;
                hops += 1;
                assert!(hops <= program.ports.len(), "a cycle of connections without a reaction");
            }
            root
        })
        .collect()
}
