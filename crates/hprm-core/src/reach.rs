//! Which ports reactions can write and read, through any number of connections.

use crate::{Connection, PortId, Program, ReactionId, Table};
use alloc::vec::Vec;

/// The ports at which a value may appear that some reaction has set.
pub(crate) fn written(program: &Program) -> Table<PortId, bool> {
    reachable(program, |c| (c.from, c.to), |id, mark| program.written_ports(id).for_each(mark))
}

/// The ports whose values some reaction may read, there or where connections carry them.
pub(crate) fn read(program: &Program) -> Table<PortId, bool> {
    reachable(program, |c| (c.to, c.from), |id, mark| program.read_ports(id).for_each(mark))
}

/// The ports that reactions mark, and those that connections lead to from there.
fn reachable(
    program: &Program,
    ends: impl Fn(&Connection) -> (PortId, PortId),
    marks: impl Fn(ReactionId, &mut dyn FnMut(PortId)),
) -> Table<PortId, bool> {
    let mut reached = Table::filled(program.ports.len(), false);
    let mut next: Table<PortId, Vec<PortId>> = Table::filled(program.ports.len(), Vec::new());
    for connection in program.connections.values() {
        let (here, there) = ends(connection);
        next[here].push(there);
    }
    let mut pending = Vec::new();
    for reaction in program.reactions.ids() {
        marks(reaction, &mut |port| pending.push(port));
    }
    while let Some(port) = pending.pop() {
        if !core::mem::replace(&mut reached[port], true) {
            pending.extend(&next[port]);
        }
    }
    reached
}
