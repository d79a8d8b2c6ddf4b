//! Reactions that wait for their turn at the current tag. This file knows their order, not what
//! queued them.

use crate::{ReactionId, Table};

/// Reactions that wait for their turn at the current tag.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(super) struct Ready {
    by_rank: Vec<Vec<ReactionId>>,
    queued: Table<ReactionId, bool>,
    /// How many wait.
    waiting: usize,
    /// The rank that is running. Nothing below it can be queued any more.
    rank: usize,
}

impl Ready {
    /// Nothing waits; `ranks` is how many there are.
    pub(super) fn new(reactions: usize, ranks: usize) -> Self {
        Self {
            by_rank: vec![Vec::new(); ranks],
            queued: Table::filled(reactions, false),
            waiting: 0,
            rank: 0,
        }
    }

    /// Starts over at the lowest rank, for the next tag.
    pub(super) fn rewind(&mut self) {
        self.rank = 0;
    }

    pub(super) fn is_empty(&self) -> bool {
        self.waiting == 0
    }

    pub(super) fn push(&mut self, reaction: ReactionId, rank: usize) {
        debug_assert!(rank >= self.rank, "a reaction precedes what triggers it");
        if !std::mem::replace(&mut self.queued[reaction], true) {
            self.by_rank[rank].push(reaction);
            self.waiting += 1;
        }
    }

    /// By rank, and within a rank in the order of the program.
    pub(super) fn pop(&mut self) -> Option<ReactionId> {
        if self.is_empty() {
            return None;
        }
        while self.by_rank[self.rank].is_empty() {
            self.rank += 1;
        }
        let reactions = &mut self.by_rank[self.rank];
        let first = reactions.iter().enumerate().min_by_key(|(_, reaction)| **reaction)?.0;
        let reaction = reactions.swap_remove(first);
        self.queued[reaction] = false;
        self.waiting -= 1;
        Some(reaction)
    }
}
