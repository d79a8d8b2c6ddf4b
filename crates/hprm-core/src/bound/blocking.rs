//! Where a physical connection may make its sender wait.
//!
//! A federate whose message finds no room begins no tag until its receiver has processed one. That must not
//! keep the receiver from processing it, so the receiver must not wait for the sender, whatever is between
//! them. Federates between which a logical connection leads may wait for each other: the receiver for
//! messages, and the sender, by flow control, for its receiver. So this is about cycles in a graph with an edge
//! both ways for each logical connection, and one from sender to receiver for each that blocks. The RTI
//! waits for no federate, so it is in no cycle.

use alloc::collections::BTreeMap;
use alloc::vec;
use alloc::vec::Vec;

use super::Overflow;
use crate::{Channel, Connection, ConnectionId, FederateId, Program};

/// A connection whose sender must not wait for its receiver.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Unsafe {
    /// The connection.
    pub connection: ConnectionId,
    /// The federates through which its receiver waits for its sender, from the receiver to the sender; none, if
    /// both are in one process.
    pub way: Vec<FederateId>,
}

/// The first connection that blocks its sender and must not.
#[must_use]
pub fn unsafe_blocking(program: &Program) -> Option<Unsafe> {
    let blocks = |connection: ConnectionId| {
        let bound = program.connections[connection].bound;
        bound.is_some_and(|bound| bound.overflow == Overflow::Block)
    };
    let mut blocking = program.connections.ids().filter(|connection| blocks(*connection));
    let mut waits: BTreeMap<FederateId, Vec<FederateId>> = BTreeMap::new();
    for Channel { connection, from, to, physical, .. } in program.channels.values() {
        if !physical {
            waits.entry(*from).or_default().push(*to);
            waits.entry(*to).or_default().push(*from);
        } else if blocks(*connection) {
            waits.entry(*from).or_default().push(*to);
        }
    }
    blocking.find_map(|connection| {
        let Connection { from, to, .. } = program.connections[connection];
        let federate = |port| program.reactors[program.ports[port].reactor].federate;
        if federate(from) == federate(to) {
            return Some(Unsafe { connection, way: Vec::new() });
        }
        // There is none if nothing is sent on it.
        let mut channels = program.channels.values();
        let channel = channels.find(|channel| channel.connection == connection)?;
        way(&waits, channel.to, channel.from).map(|way| Unsafe { connection, way })
    })
}

/// A way along the edges, one of the shortest.
fn way(
    waits: &BTreeMap<FederateId, Vec<FederateId>>,
    from: FederateId,
    to: FederateId,
) -> Option<Vec<FederateId>> {
    let mut before = BTreeMap::from([(from, from)]);
    let mut front = vec![from];
    while !front.is_empty() && !before.contains_key(&to) {
        let mut next = Vec::new();
        for here in front {
            for there in waits.get(&here).into_iter().flatten() {
                before.entry(*there).or_insert_with(|| {
                    next.push(*there);
                    here
                });
            }
        }
        front = next;
    }
    let mut way = vec![*before.contains_key(&to).then_some(&to)?];
    while let Some(here) = way.last().filter(|here| **here != from) {
        way.push(before[here]);
    }
    way.reverse();
    Some(way)
}
