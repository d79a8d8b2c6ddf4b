//! What modes enclose, looked up once: the mode of every reaction, action, timer and connection.

use crate::{
    ActionId, ConnectionId, ModeId, Program, ReactionId, ReactorId, Scope, Table, TimerId,
};
use alloc::vec;
use alloc::vec::Vec;

/// What modes enclose, innermost first; all tables are full even where there are no modes.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(crate) struct ModeWiring {
    /// Reactors with modes in the scope, containers before their contents, and their modes.
    pub(crate) reactors: Vec<Modal>,
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

impl ModeWiring {
    pub(super) fn new(program: &Program, scope: Scope) -> Self {
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
