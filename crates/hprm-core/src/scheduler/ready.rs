//! Reactions that wait for their turn at the current tag: a set of positions, of which the first is
//! taken again and again. This file knows their order, not what queued them.

use crate::order::Position;

const BITS: u32 = u64::BITS;

/// Reactions that wait for their turn.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(super) struct Ready {
    /// A bit for every position.
    words: Vec<u64>,
    /// A bit for every word that is not zero, so that the first one is found at a glance.
    summary: Vec<u64>,
    /// No word of the summary before this one has a bit.
    first: usize,
}

impl Ready {
    /// Nothing waits, of so many reactions.
    pub(super) fn new(reactions: usize) -> Self {
        let words = reactions.div_ceil(BITS as usize);
        let summary = words.div_ceil(BITS as usize);
        Self { words: vec![0; words], summary: vec![0; summary], first: summary }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.first == self.summary.len()
    }

    /// Adds a reaction, unless it waits already.
    pub(super) fn push(&mut self, position: Position) {
        let word = position.0 / BITS;
        let summary = (word / BITS) as usize;
        self.words[word as usize] |= 1 << (position.0 % BITS);
        self.summary[summary] |= 1 << (word % BITS);
        self.first = self.first.min(summary);
    }

    /// The reaction that comes first.
    pub(super) fn first(&self) -> Option<Position> {
        let summary = self.summary.get(self.first)?;
        let word = self.first * BITS as usize + summary.trailing_zeros() as usize;
        let position = word * BITS as usize + self.words[word].trailing_zeros() as usize;
        u32::try_from(position).ok().map(Position)
    }

    /// Takes the reaction that comes first, if it comes before `end`.
    pub(super) fn pop_before(&mut self, end: Position) -> Option<Position> {
        self.first().filter(|first| *first < end)?;
        self.pop()
    }

    /// Takes the reaction that comes first.
    pub(super) fn pop(&mut self) -> Option<Position> {
        let summary = self.summary.get_mut(self.first)?;
        let word = self.first * BITS as usize + summary.trailing_zeros() as usize;
        let bits = &mut self.words[word];
        let position = word * BITS as usize + bits.trailing_zeros() as usize;
        *bits &= *bits - 1;
        if *bits == 0 {
            *summary &= *summary - 1;
            while self.summary.get(self.first) == Some(&0) {
                self.first += 1;
            }
        }
        u32::try_from(position).ok().map(Position)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_come_out_in_their_order_and_once() {
        let mut ready = Ready::new(10_000);
        assert!(ready.is_empty());
        let mut positions = [9_999, 64, 63, 0, 4_096, 4_095, 64, 8_000, 1];
        for position in positions {
            ready.push(Position(position));
        }
        positions.sort_unstable();
        let mut expected = positions.to_vec();
        expected.dedup();
        let taken: Vec<_> = std::iter::from_fn(|| ready.pop()).map(|p| p.0).collect();
        assert_eq!(taken, expected);
        assert!(ready.is_empty());
        assert_eq!(ready, Ready::new(10_000));
    }

    #[test]
    fn what_is_added_meanwhile_takes_its_place() {
        let mut ready = Ready::new(300);
        ready.push(Position(7));
        ready.push(Position(299));
        assert_eq!(ready.pop(), Some(Position(7)));
        ready.push(Position(128));
        assert_eq!(ready.pop(), Some(Position(128)));
        assert_eq!(ready.pop(), Some(Position(299)));
        assert_eq!(ready.pop(), None);
        assert_eq!(Ready::new(0).pop(), None);
    }
}
