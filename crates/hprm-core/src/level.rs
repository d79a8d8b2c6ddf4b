//! Levels: which reactions must run before which at one tag.
//!
//! A reaction precedes the next one of its reactor, and every reaction that can read, at the same
//! tag, what it writes (handbook, "causality"). Delayed and physical connections do not order. A
//! reaction that precedes one with a deadline inherits it. Reactions that are never active at one tag,
//! because they are in different modes of a reactor, are not ordered either; but the reactions of one
//! reactor are, whatever their modes.

use alloc::collections::{BTreeMap, VecDeque};
use alloc::vec::Vec;

use crate::{ModeId, Nanos, PortId, Program, ReactionId, Table, Trigger};

/// A cycle of reactions.
pub(crate) struct CausalityLoop(pub(crate) Vec<ReactionId>);

/// The levels and deadlines that follow from the order of the reactions.
pub(crate) struct Precedence {
    /// The length of the longest chain of reactions before each one.
    pub(crate) levels: Table<ReactionId, u32>,
    /// The tightest deadline of each one and all that must run after it.
    pub(crate) inferred_deadlines: Table<ReactionId, Nanos>,
}

/// Orders the reactions.
pub(crate) fn precedence(program: &Program) -> Result<Precedence, CausalityLoop> {
    let successors = successors(program);
    let mut waiting_for: Table<ReactionId, usize> = Table::filled(program.reactions.len(), 0);
    for follower in successors.values().flatten() {
        waiting_for[*follower] += 1;
    }
    let mut level: Table<ReactionId, u32> = Table::filled(program.reactions.len(), 0);
    let mut ready: VecDeque<_> = waiting_for.ids().filter(|id| waiting_for[*id] == 0).collect();
    let mut sorted = Vec::with_capacity(program.reactions.len());
    while let Some(reaction) = ready.pop_front() {
        sorted.push(reaction);
        for follower in &successors[reaction] {
            level[*follower] = level[*follower].max(level[reaction] + 1);
            waiting_for[*follower] -= 1;
            if waiting_for[*follower] == 0 {
                ready.push_back(*follower);
            }
        }
    }
    if sorted.len() < program.reactions.len() {
        return Err(CausalityLoop(find_cycle(&successors, &waiting_for)));
    }
    let declared = program.reactions.values().map(|reaction| reaction.deadline);
    let mut inferred: Table<ReactionId, Nanos> =
        declared.map(|deadline| deadline.unwrap_or(Nanos::MAX)).collect();
    for reaction in sorted.into_iter().rev() {
        let followers = successors[reaction].iter().map(|follower| inferred[*follower]);
        inferred[reaction] = followers.fold(inferred[reaction], Nanos::min);
    }
    Ok(Precedence { levels: level, inferred_deadlines: inferred })
}

fn successors(program: &Program) -> Table<ReactionId, Vec<ReactionId>> {
    let readers = readers(program);
    let followers = direct_followers(program);
    let mut successors: Table<ReactionId, Vec<ReactionId>> =
        Table::filled(program.reactions.len(), Vec::new());
    let modes: Table<ReactionId, _> =
        program.reactions.ids().map(|id| program.mode_of_reaction(id)).collect();
    let mut reached: Table<PortId, Option<ReactionId>> = Table::filled(program.ports.len(), None);
    let mut previous: Table<crate::ReactorId, Option<ReactionId>> =
        Table::filled(program.reactors.len(), None);
    let last = last_writers(program, &modes);
    for (id, reaction) in program.reactions.iter() {
        if let Some(earlier) = previous[reaction.reactor].replace(id) {
            successors[earlier].push(id);
        }
        let follows = |reader: &&ReactionId| !program.are_exclusive(modes[id], modes[**reader]);
        // If a later reaction of this reactor writes the port too, its readers follow that reaction, and
        // so this one.
        let is_last = |port: &PortId| last.get(&(*port, modes[id])) == Some(&id);
        let mut pending: Vec<PortId> = program.written_ports(id).filter(is_last).collect();
        while let Some(port) = pending.pop() {
            // Connections in several modes can make several paths to one port.
            if reached[port].replace(id) == Some(id) {
                continue;
            }
            successors[id].extend(readers[port].iter().filter(follows));
            pending.extend(&followers[port]);
        }
        successors[id].sort_unstable();
        successors[id].dedup();
    }
    successors
}

/// The last reaction, in each mode, that writes a port; all reactions that write it are in one reactor.
fn last_writers(
    program: &Program,
    modes: &Table<ReactionId, Option<ModeId>>,
) -> BTreeMap<(PortId, Option<ModeId>), ReactionId> {
    let ids = program.reactions.ids();
    let writes = ids.flat_map(|id| program.written_ports(id).map(move |port| (port, id)));
    writes.map(|(port, id)| ((port, modes[id]), id)).collect()
}

fn readers(program: &Program) -> Table<PortId, Vec<ReactionId>> {
    let mut readers: Table<PortId, Vec<ReactionId>> =
        Table::filled(program.ports.len(), Vec::new());
    for (id, reaction) in program.reactions.iter() {
        for trigger in &reaction.triggers {
            if let Trigger::Port(port) = trigger {
                readers[*port].push(id);
            }
        }
        for port in &reaction.sources {
            readers[*port].push(id);
        }
    }
    readers
}

/// The ports at which each port's value appears at the same tag, one connection further.
fn direct_followers(program: &Program) -> Table<PortId, Vec<PortId>> {
    let mut followers: Table<PortId, Vec<PortId>> = Table::filled(program.ports.len(), Vec::new());
    for connection in program.connections.values().filter(|c| c.is_direct()) {
        followers[connection.from].push(connection.to);
    }
    followers
}

/// One cycle among the reactions that still wait for another.
fn find_cycle(
    successors: &Table<ReactionId, Vec<ReactionId>>,
    waiting_for: &Table<ReactionId, usize>,
) -> Vec<ReactionId> {
    // Each reaction that is left waits for another one that is left, so a walk back along predecessors
    // must reach a reaction for the second time.
    let mut predecessor: Table<ReactionId, Option<ReactionId>> =
        Table::filled(waiting_for.len(), None);
    for (id, next) in successors.iter().filter(|(id, _)| waiting_for[*id] > 0) {
        for follower in next {
            predecessor[*follower].get_or_insert(id);
        }
    }
    let mut place: Table<ReactionId, Option<usize>> = Table::filled(waiting_for.len(), None);
    let mut walk: Vec<ReactionId> = Vec::new();
    let mut here = waiting_for.ids().find(|id| waiting_for[*id] > 0);
    while let Some(reaction) = here {
        if let Some(at) = place[reaction].replace(walk.len()) {
            walk.drain(..at);
            break;
        }
        walk.push(reaction);
        here = predecessor[reaction];
    }
    walk.reverse();
    let first = walk.iter().enumerate().min_by_key(|(_, id)| **id).map_or(0, |(i, _)| i);
    walk.rotate_left(first);
    walk
}
