//! The order in which reactions take their turns at a tag: a total one, known before the run.
//!
//! Reactions of one rank do not depend on one another; whatever precedes a reaction has a lower
//! rank. Within a rank the order is that of the program.

use std::ops::Range;

use crate::wiring::Scope;
use crate::{Program, Reaction, ReactionId, Table};

/// A place in the order.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub(crate) struct Position(pub(crate) u32);

/// The order of the reactions of one scope.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(crate) struct Order {
    /// By position.
    reactions: Vec<ReactionId>,
    /// Of a reaction from elsewhere, it means nothing.
    positions: Table<ReactionId, Position>,
    /// By position, where its rank begins and ends.
    ranks: Vec<Range<u32>>,
}

impl Order {
    /// By level, and if deadlines go first, by inferred deadline before that, as in Lingua Franca.
    /// A reaction's inferred deadline is no later than those of the reactions after it, so either
    /// way it comes before them.
    pub(crate) fn new(program: &Program, scope: Scope) -> Self {
        let by_deadline = program.properties.deadlines_first;
        let rank = |reaction: &Reaction| {
            (if by_deadline { reaction.inferred_deadline } else { 0 }, reaction.level)
        };
        let local = program.reactions.iter().filter(|(_, r)| scope.contains(program, r.reactor));
        let mut sorted: Vec<_> = local.map(|(id, reaction)| (rank(reaction), id)).collect();
        sorted.sort_unstable();
        let mut order = Self {
            reactions: sorted.iter().map(|(_, id)| *id).collect(),
            positions: Table::filled(program.reactions.len(), Position(0)),
            ranks: Vec::with_capacity(sorted.len()),
        };
        for rank in sorted.chunk_by(|(a, _), (b, _)| a == b) {
            let start = order.ranks.len();
            let range = as_u32(start)..as_u32(start + rank.len());
            for (offset, (_, id)) in rank.iter().enumerate() {
                order.positions[*id] = Position(as_u32(start + offset));
                order.ranks.push(range.clone());
            }
        }
        order
    }

    /// How many reactions there are.
    pub(crate) fn len(&self) -> usize {
        self.reactions.len()
    }

    /// The reaction at a position.
    pub(crate) fn reaction(&self, position: Position) -> ReactionId {
        self.reactions[position.0 as usize]
    }

    /// The position after the last one of the same rank.
    pub(crate) fn end_of_rank(&self, position: Position) -> Position {
        Position(self.ranks[position.0 as usize].end)
    }

    /// The position of a reaction of this scope.
    pub(crate) fn position(&self, reaction: ReactionId) -> Position {
        self.positions[reaction]
    }
}

fn as_u32(index: usize) -> u32 {
    u32::try_from(index).expect("reactions are counted in u32")
}
