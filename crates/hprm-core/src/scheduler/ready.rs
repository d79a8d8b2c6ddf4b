//! Reactions that are ready to run at the current tag: a bit set of positions, from which the first is
//! taken again and again. This file knows their order, not what triggered them.

use alloc::vec;
use alloc::vec::Vec;
use core::hash::{Hash, Hasher};

use crate::order::{Batch, Position};

const BITS: u32 = u64::BITS;

/// Reactions that are ready to run.
///
/// What one reaction sets decides which one is next, and so on, so the time from [`Self::add`] to the
/// result of [`Self::pop`] counts: a word is written and read, and nothing else is computed.
#[derive(Clone, Debug)]
pub(super) struct Ready {
    /// A bit for every position.
    words: Vec<u64>,
    /// A bit for every word that is not zero, so that the first one is found quickly.
    summary: Vec<u64>,
    /// No word before this one has a bit. Most programs have only one word.
    first: u32,
}

// Where the search begins is not part of the state.
impl PartialEq for Ready {
    fn eq(&self, other: &Self) -> bool {
        self.words == other.words
    }
}

impl Eq for Ready {}

impl Hash for Ready {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.words.hash(state);
    }
}

impl Ready {
    /// An empty set, for so many reactions.
    pub(super) fn new(reactions: usize) -> Self {
        let words = reactions.div_ceil(BITS as usize);
        let summary = words.div_ceil(BITS as usize);
        Self { words: vec![0; words], summary: vec![0; summary], first: 0 }
    }

    #[inline]
    pub(super) fn is_empty(&self) -> bool {
        self.first_word().is_none()
    }

    /// Adds a reaction, unless it is in the set already.
    #[inline]
    pub(super) fn push(&mut self, position: Position) {
        self.add(Batch { word: position.word(), bits: position.bit() });
    }

    /// Adds the reactions of a batch that are not in the set already.
    #[inline]
    pub(super) fn add(&mut self, Batch { word, bits }: Batch) {
        if bits == 0 {
            return;
        }
        self.words[word as usize] |= bits;
        self.summary[(word / BITS) as usize] |= 1 << (word % BITS);
        if word < self.first {
            self.first = word;
        }
    }

    /// The reaction that comes first.
    #[inline]
    pub(super) fn first(&self) -> Option<Position> {
        let word = self.first_word()?;
        Some(Position(word * BITS + self.words[word as usize].trailing_zeros()))
    }

    /// Takes the reaction that comes first, if it comes before `end`.
    #[inline]
    pub(super) fn pop_before(&mut self, end: Position) -> Option<Position> {
        self.first().filter(|first| *first < end)?;
        self.pop()
    }

    /// Takes the reaction that comes first.
    #[inline]
    pub(super) fn pop(&mut self) -> Option<Position> {
        if matches!(self.words.get(self.first as usize), None | Some(0)) {
            self.first = self.first_word()?;
        }
        let bits = &mut self.words[self.first as usize];
        let position = Position(self.first * BITS + bits.trailing_zeros());
        *bits &= *bits - 1;
        if *bits == 0 {
            self.summary[(self.first / BITS) as usize] &= !(1 << (self.first % BITS));
        }
        Some(position)
    }

    /// The first word that is not zero.
    #[inline]
    fn first_word(&self) -> Option<u32> {
        let (index, summary) = (0..).zip(&self.summary).find(|(_, summary)| **summary != 0)?;
        Some(index * BITS + summary.trailing_zeros())
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
    fn a_reaction_that_is_added_later_comes_out_in_its_order() {
        let mut ready = Ready::new(300);
        ready.push(Position(7));
        ready.push(Position(299));
        assert_eq!(ready.pop(), Some(Position(7)));
        ready.push(Position(128));
        assert_eq!(ready.pop(), Some(Position(128)));
        assert_eq!(ready.pop(), Some(Position(299)));
        assert_eq!(ready.pop(), None);
        // The next tag begins before the word that was looked at last.
        ready.push(Position(200));
        ready.push(Position(3));
        assert_eq!(ready.pop(), Some(Position(3)));
        assert_eq!(ready.pop(), Some(Position(200)));
        assert!(ready.is_empty());
        assert_eq!(Ready::new(0).pop(), None);
    }
}
