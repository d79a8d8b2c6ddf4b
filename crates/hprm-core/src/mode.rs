//! Modes: parts of a reactor of which one is active at a time.
//!
//! This file owns the static side: which mode encloses what, and what can never be active together.
//! The scheduler changes modes while a program runs.

use crate::{
    ActionId, Connection, ConnectionId, Direction, ModeId, PortId, Program, ReactionId, ReactorId,
    Table, TimerId,
};
use alloc::string::String;
use serde::{Deserialize, Serialize};

/// A mode of a reactor instance (handbook, "modal models").
#[derive(Clone, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub struct Mode {
    /// Name within its reactor.
    pub name: String,
    /// The reactor whose mode it is.
    pub reactor: ReactorId,
    /// Whether the reactor starts in it.
    pub initial: bool,
}

/// How a mode is entered.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug, Serialize, Deserialize)]
pub enum Transition {
    /// As if for the first time: timers start again, and suspended events are removed.
    Reset,
    /// As it was left: suspended events wait for the rest of their time.
    History,
}

/// What can be declared in a mode (handbook, "modal models").
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum ModalElement {
    /// A contained reactor.
    Reactor(ReactorId),
    /// An action.
    Action(ActionId),
    /// A timer.
    Timer(TimerId),
    /// A reaction.
    Reaction(ReactionId),
    /// A connection.
    Connection(ConnectionId),
}

impl Program {
    /// The innermost mode around something that `reactor` declares in its mode `own`, if any.
    #[must_use]
    pub fn enclosing_mode(&self, reactor: ReactorId, own: Option<ModeId>) -> Option<ModeId> {
        let mut here = Some(reactor);
        let mut mode = own;
        while let (None, Some(reactor)) = (mode, here) {
            mode = self.reactors[reactor].mode;
            here = self.reactors[reactor].parent;
        }
        mode
    }

    /// The mode around a mode.
    #[must_use]
    pub fn outer_mode(&self, mode: ModeId) -> Option<ModeId> {
        self.enclosing_mode(self.modes[mode].reactor, None)
    }

    /// A mode and the modes around it, from the inside out.
    pub(crate) fn modes_around(&self, mode: Option<ModeId>) -> impl Iterator<Item = ModeId> {
        core::iter::successors(mode, |mode| self.outer_mode(*mode))
    }

    /// Whether what is in mode `a` and what is in mode `b` are never active at the same tag: some
    /// reactor would have to be in two modes.
    pub(crate) fn are_exclusive(&self, a: Option<ModeId>, b: Option<ModeId>) -> bool {
        self.modes_around(a).any(|a| {
            self.modes_around(b).any(|b| a != b && self.modes[a].reactor == self.modes[b].reactor)
        })
    }

    /// The innermost mode around a connection.
    pub(crate) fn mode_of_connection(&self, connection: ConnectionId) -> Option<ModeId> {
        let connection = &self.connections[connection];
        let from = &self.ports[connection.from];
        // An input is read inside its reactor, an output around it.
        let declared_in = match from.direction {
            Direction::Input => Some(from.reactor),
            Direction::Output => self.reactors[from.reactor].parent,
        };
        declared_in.and_then(|reactor| self.enclosing_mode(reactor, connection.mode))
    }

    /// The innermost mode around a reaction.
    pub(crate) fn mode_of_reaction(&self, reaction: ReactionId) -> Option<ModeId> {
        let reaction = &self.reactions[reaction];
        self.enclosing_mode(reaction.reactor, reaction.mode)
    }

    /// By connection, whether it is a plain one of which the mode must be checked for each value. No
    /// check is needed if its source is in the same mode, because then there is a value only while the
    /// mode is active. If such a connection is the only one that feeds its destination, both ends can be
    /// one.
    pub(crate) fn conditional_connections(&self) -> Table<ConnectionId, bool> {
        let mut feeds: Table<PortId, usize> = Table::filled(self.ports.len(), 0);
        for connection in self.connections.values() {
            feeds[connection.to] += 1;
        }
        for reaction in self.reactions.ids() {
            self.written_ports(reaction).for_each(|port| feeds[port] += 1);
        }
        let is_conditional = |connection: &Connection| {
            connection.is_direct()
                && connection.mode.is_some_and(|mode| {
                    let source = self.ports[connection.from].reactor;
                    feeds[connection.to] > 1 || source == self.modes[mode].reactor
                })
        };
        self.connections.values().map(is_conditional).collect()
    }
}
