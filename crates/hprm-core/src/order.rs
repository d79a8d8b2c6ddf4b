//! The order in which reactions take their turns at a tag: a total one, known before the run.
//!
//! Reactions of one rank do not depend on one another; a reaction that precedes another one has a lower
//! rank. Within a rank the order is that of the program.
//!
//! A trigger triggers the same reactions each time, so they are kept as [`Batch`]es: a bit set of
//! positions can add all reactions of one of its words at once.

use alloc::vec::Vec;
use core::ops::Range;

use crate::id::Id;
use crate::{Program, Reaction, ReactionId, Scope, Table};

/// A position in the order.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub(crate) struct Position(pub(crate) u32);

/// Positions that share a word of a set of positions.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Default)]
pub(crate) struct Batch {
    /// The index of the word.
    pub(crate) word: u32,
    /// A bit for every position.
    pub(crate) bits: u64,
}

impl Position {
    /// The word of a set that has the bit of this position.
    #[inline]
    pub(crate) const fn word(self) -> u32 {
        self.0 / u64::BITS
    }

    /// Its bit in that word.
    #[inline]
    pub(crate) const fn bit(self) -> u64 {
        1 << (self.0 % u64::BITS)
    }
}

impl Batch {
    /// Groups the positions that are listed for each id into batches.
    pub(crate) fn all<I: Id>(mut listed: Vec<(I, Position)>) -> Vec<(I, Self)> {
        listed.sort_unstable_by_key(|(id, position)| (id.index(), *position));
        let mut batches: Vec<(I, Self)> = Vec::new();
        for (id, position) in listed {
            match batches.last_mut() {
                Some((last, batch))
                    if last.index() == id.index() && batch.word == position.word() =>
                {
                    batch.bits |= position.bit();
                }
                _ => batches.push((id, Self { word: position.word(), bits: position.bit() })),
            }
        }
        batches
    }

    /// Its positions, in order.
    pub(crate) fn positions(self) -> impl Iterator<Item = Position> {
        let offsets = (0..u64::BITS).filter(move |offset| self.bits >> offset & 1 != 0);
        offsets.map(move |offset| Position(self.word * u64::BITS + offset))
    }
}

/// The order of the reactions of one scope.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(crate) struct Order {
    /// By position.
    reactions: Vec<ReactionId>,
    /// Meaningless for reactions outside of the scope.
    positions: Table<ReactionId, Position>,
    /// By position, the range of its rank.
    ranks: Vec<Range<u32>>,
}

impl Order {
    /// By level, and if deadlines go first, by inferred deadline before that, as in Lingua Franca.
    /// A reaction's inferred deadline is no later than those of the reactions after it, so it comes
    /// before them in both cases.
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
    #[inline]
    pub(crate) fn reaction(&self, position: Position) -> ReactionId {
        self.reactions[position.0 as usize]
    }

    /// The position after the last one of the same rank.
    #[inline]
    pub(crate) fn end_of_rank(&self, position: Position) -> Position {
        Position(self.ranks[position.0 as usize].end)
    }

    /// The position of a reaction of this scope.
    #[inline]
    pub(crate) fn position(&self, reaction: ReactionId) -> Position {
        self.positions[reaction]
    }
}

fn as_u32(index: usize) -> u32 {
    u32::try_from(index).expect("reactions are counted in u32")
}

#[cfg(test)]
mod tests {
    use alloc::vec;

    use super::*;
    use crate::TimerId;

    #[test]
    fn a_batch_has_positions_of_one_word_and_one_id() {
        let listed = [(1, 3), (0, 70), (1, 64), (1, 0), (1, 65), (2, 65)];
        let listed = listed.map(|(id, position)| (TimerId(id), Position(position)));
        let batches = Batch::all(listed.to_vec());
        let held: Vec<_> = batches
            .iter()
            .map(|(id, batch)| (id.0, batch.positions().map(|position| position.0).collect()))
            .collect::<Vec<(u32, Vec<u32>)>>();
        assert_eq!(held, [(0, vec![70]), (1, vec![0, 3]), (1, vec![64, 65]), (2, vec![65])]);
    }
}
