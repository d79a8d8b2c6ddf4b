//! Which parts of an outline are in a causality loop.

use std::collections::BTreeSet;

use hprm_model::outline::{Connection, Effect, End, Outline, Reaction, Trigger};

/// The ports and reactions of causality loops.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub(crate) struct Cycle {
    ports: BTreeSet<End>,
    reactions: BTreeSet<(usize, usize)>,
}

impl Cycle {
    /// The loop of a program that was refused because of one; nothing of other programs.
    pub(crate) fn of(outline: &Outline) -> Self {
        let reactions: BTreeSet<_> = outline.cycle.iter().copied().collect();
        if reactions.is_empty() {
            return Self::default();
        }
        let direct: Vec<(End, End)> = outline
            .reactors
            .iter()
            .flat_map(|reactor| &reactor.connections)
            .filter(|connection| is_direct(connection))
            .map(|connection| (connection.from, connection.to))
            .collect();
        let of =
            |&(reactor, reaction): &(usize, usize)| &outline.reactors[reactor].reactions[reaction];
        let written = reactions.iter().flat_map(|it| written(of(it)));
        let read = reactions.iter().flat_map(|it| read(of(it)));
        let after = reached(written.collect(), &direct, |(from, to)| (*from, *to));
        let before = reached(read.collect(), &direct, |(from, to)| (*to, *from));
        Self { ports: after.intersection(&before).copied().collect(), reactions }
    }

    pub(crate) fn has_port(&self, port: End) -> bool {
        self.ports.contains(&port)
    }

    pub(crate) fn has_reaction(&self, reactor: usize, reaction: usize) -> bool {
        self.reactions.contains(&(reactor, reaction))
    }

    pub(crate) fn has_connection(&self, connection: &Connection) -> bool {
        is_direct(connection) && self.has_port(connection.from) && self.has_port(connection.to)
    }

    /// The reactions of a reactor that are in the loop, in their order.
    pub(crate) fn reactions_of(&self, reactor: usize) -> Vec<usize> {
        let of = self.reactions.iter().filter(|(it, _)| *it == reactor);
        of.map(|(_, reaction)| *reaction).collect()
    }
}

fn is_direct(connection: &Connection) -> bool {
    !connection.physical && connection.delay.is_none()
}

fn written(reaction: &Reaction) -> impl Iterator<Item = End> {
    reaction.effects.iter().filter_map(|effect| match effect {
        Effect::Port(port) => Some(*port),
        Effect::Action(_) | Effect::Mode(..) => None,
    })
}

fn read(reaction: &Reaction) -> impl Iterator<Item = End> {
    let triggers = reaction.triggers.iter().filter_map(|trigger| match trigger {
        Trigger::Port(port) => Some(*port),
        _ => None,
    });
    triggers.chain(reaction.sources.iter().copied())
}

/// The ports that can be reached from `ports`, with these.
fn reached(
    ports: BTreeSet<End>,
    connections: &[(End, End)],
    ends: impl Fn(&(End, End)) -> (End, End),
) -> BTreeSet<End> {
    let mut pending: Vec<End> = ports.iter().copied().collect();
    let mut reached = ports;
    while let Some(port) = pending.pop() {
        for (from, to) in connections.iter().map(&ends) {
            if from == port && reached.insert(to) {
                pending.push(to);
            }
        }
    }
    reached
}
