//! Free space: which bytes of the segments are in no block.
//!
//! Plain data. It knows lengths and offsets, not memory, owners or readers; a segment is a number and
//! a length. The ledger decides how long a [`Block`] stays taken.

#![forbid(unsafe_code)]

use std::collections::{BTreeMap, BTreeSet};

/// Alignment of every block, in bytes: a cache line, and enough for vector instructions.
const LINE: u64 = 64;
/// Alignment of a large block, in bytes, so that it starts where its pages start.
pub(crate) const PAGE: u64 = 4096;
/// Length from which a block is large, in bytes.
const LARGE: u64 = 1 << 20;
/// How many freed blocks the arena remembers by their exact place.
const RECENT: usize = 16;

/// A run of bytes in one segment.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub struct Block {
    /// The segment.
    pub segment: u32,
    /// First byte in the segment.
    pub offset: u64,
    /// Length in bytes, rounded up to the alignment.
    pub len: u64,
}

impl Block {
    fn end(&self) -> u64 {
        self.offset + self.len
    }

    fn overlaps(&self, other: &Self) -> bool {
        self.segment == other.segment && self.offset < other.end() && other.offset < self.end()
    }
}

/// The free bytes of several segments.
///
/// A block is chosen among the recently freed ones of the same length first, the newest before the
/// others: its pages are present and its lines may still be in the cache. Otherwise the smallest free
/// range that fits is cut. So a program that sends arrays of one shape writes the same one or two
/// blocks for ever, whatever the size of the arena.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Default)]
pub struct Arena {
    segments: BTreeMap<u32, u64>,
    next_segment: u32,
    /// Maximal free ranges: no two of them touch.
    free: BTreeMap<(u32, u64), u64>,
    /// The same ranges as (length, segment, offset), to find the smallest that fits.
    by_len: BTreeSet<(u64, u32, u64)>,
    /// Freed blocks that are still free, the newest last.
    recent: Vec<Block>,
}

/// The alignment of a block of `len` bytes, and `len` rounded up to it; `None` on overflow.
fn rounded(len: u64) -> Option<(u64, u64)> {
    let align = if len >= LARGE { PAGE } else { LINE };
    Some((align, len.max(1).checked_next_multiple_of(align)?))
}

impl Arena {
    /// An arena without segments.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a segment of `len` bytes, all free. Its number is new.
    ///
    /// # Panics
    ///
    /// If `len` is not a whole number of pages.
    pub fn add_segment(&mut self, len: u64) -> u32 {
        assert!(len > 0 && len.is_multiple_of(PAGE), "a segment is a whole number of pages");
        let segment = self.next_segment;
        self.next_segment += 1;
        self.segments.insert(segment, len);
        self.insert(Block { segment, offset: 0, len });
        segment
    }

    /// Removes a segment and returns its length, unless some of it is taken or it does not exist.
    pub fn remove_segment(&mut self, segment: u32) -> Option<u64> {
        let len = *self.segments.get(&segment)?;
        if !self.is_free(segment, len) {
            return None;
        }
        self.segments.remove(&segment);
        self.remove(Block { segment, offset: 0, len });
        self.recent.retain(|block| block.segment != segment);
        Some(len)
    }

    /// The segments of which no byte is taken, with their lengths, the oldest first.
    pub fn free_segments(&self) -> impl Iterator<Item = (u32, u64)> {
        let lens = self.segments.iter().map(|(segment, len)| (*segment, *len));
        lens.filter(|(segment, len)| self.is_free(*segment, *len))
    }

    /// Takes `len` bytes, rounded up; `None` if no free range is long enough.
    pub fn alloc(&mut self, len: u64) -> Option<Block> {
        let (align, len) = rounded(len)?;
        let block = self.recent_fit(len).or_else(|| self.best_fit(align, len))?;
        let around = self.range_around(&block).expect("a fit lies in a free range");
        self.remove(around);
        for (offset, end) in [(around.offset, block.offset), (block.end(), around.end())] {
            if offset < end {
                self.insert(Block { offset, len: end - offset, ..block });
            }
        }
        self.recent.retain(|other| !other.overlaps(&block));
        Some(block)
    }

    /// Frees a block.
    ///
    /// # Panics
    ///
    /// If some of it is free already, or lies in no segment.
    pub fn free(&mut self, block: Block) {
        let segment_len = self.segments.get(&block.segment).copied().unwrap_or(0);
        assert!(block.end() <= segment_len, "{block:?} lies in no segment");
        let before = self.last_range_before(block.segment, block.end());
        assert!(
            before.is_none_or(|range| range.end() <= block.offset),
            "{block:?} is free already"
        );
        let after = self.free.get(&(block.segment, block.end())).copied();

        let mut merged = block;
        if let Some(before) = before.filter(|range| range.end() == block.offset) {
            self.remove(before);
            merged = Block { offset: before.offset, len: before.len + merged.len, ..merged };
        }
        if let Some(len) = after {
            self.remove(Block { offset: block.end(), len, ..block });
            merged.len += len;
        }
        self.insert(merged);
        if self.recent.len() == RECENT {
            self.recent.remove(0);
        }
        self.recent.push(block);
    }

    fn recent_fit(&self, len: u64) -> Option<Block> {
        self.recent.iter().rev().find(|block| block.len == len).copied()
    }

    fn best_fit(&self, align: u64, len: u64) -> Option<Block> {
        self.by_len.range((len, 0, 0)..).find_map(|&(range_len, segment, start)| {
            let offset = start.next_multiple_of(align);
            (offset + len <= start + range_len).then_some(Block { segment, offset, len })
        })
    }

    fn is_free(&self, segment: u32, len: u64) -> bool {
        self.free.get(&(segment, 0)) == Some(&len)
    }

    /// The last free range that starts before `end`.
    fn last_range_before(&self, segment: u32, end: u64) -> Option<Block> {
        let (&(_, offset), &len) = self.free.range((segment, 0)..(segment, end)).next_back()?;
        Some(Block { segment, offset, len })
    }

    fn range_around(&self, block: &Block) -> Option<Block> {
        let range = self.last_range_before(block.segment, block.end())?;
        (range.offset <= block.offset && block.end() <= range.end()).then_some(range)
    }

    fn insert(&mut self, range: Block) {
        self.free.insert((range.segment, range.offset), range.len);
        self.by_len.insert((range.len, range.segment, range.offset));
    }

    fn remove(&mut self, range: Block) {
        self.free.remove(&(range.segment, range.offset));
        self.by_len.remove(&(range.len, range.segment, range.offset));
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const SEGMENTS: [u64; 2] = [4 << 20, 3 << 20];

    fn arena() -> Arena {
        let mut arena = Arena::new();
        for len in SEGMENTS {
            arena.add_segment(len);
        }
        arena
    }

    fn free_bytes(arena: &Arena) -> u64 {
        arena.free.values().sum()
    }

    #[test]
    fn one_size_returns_to_one_block() {
        let mut arena = arena();
        let first = arena.alloc(100_000).unwrap();
        let _neighbour = arena.alloc(64).unwrap();
        for _ in 0..100 {
            arena.free(first);
            assert_eq!(arena.alloc(100_000), Some(first));
        }
    }

    #[test]
    fn two_in_flight_use_two_blocks() {
        let mut arena = arena();
        let [mut older, mut newer] = [(); 2].map(|()| arena.alloc(1 << 20).unwrap());
        let blocks = [older, newer];
        for _ in 0..100 {
            arena.free(older);
            older = std::mem::replace(&mut newer, arena.alloc(1 << 20).unwrap());
            assert!(blocks.contains(&newer));
        }
    }

    #[test]
    fn a_range_that_fits_exactly_is_cut_before_a_larger_one() {
        let mut arena = arena();
        let blocks = [4096, 64, 128, 64].map(|len| arena.alloc(len).unwrap());
        let hole = blocks[2];
        arena.free(hole);
        arena.recent.clear();
        assert_eq!(arena.alloc(100), Some(hole));
    }

    #[test]
    fn large_blocks_start_on_a_page() {
        let mut arena = arena();
        arena.alloc(64).unwrap();
        let large = arena.alloc((1 << 20) + 1).unwrap();
        assert_eq!((large.offset % PAGE, large.len), (0, (1 << 20) + PAGE));
        assert_eq!(arena.alloc(1).unwrap().len, LINE);
    }

    #[test]
    fn what_does_not_fit_is_refused_and_changes_nothing() {
        let mut arena = arena();
        let before = arena.clone();
        assert_eq!(arena.alloc(SEGMENTS[0] + 1), None);
        assert_eq!(arena.alloc(u64::MAX), None);
        assert_eq!(arena, before);
    }

    #[test]
    fn only_a_free_segment_can_be_removed_and_its_number_stays_used() {
        let mut arena = arena();
        let block = arena.alloc(SEGMENTS[1]).unwrap();
        assert_eq!(block.segment, 1);
        assert_eq!(arena.remove_segment(1), None);
        assert_eq!(arena.free_segments().collect::<Vec<_>>(), [(0, SEGMENTS[0])]);
        arena.free(block);
        assert_eq!(arena.remove_segment(1), Some(SEGMENTS[1]));
        assert_eq!(arena.remove_segment(1), None);
        assert_eq!(arena.add_segment(PAGE), 2);
    }

    #[test]
    #[should_panic(expected = "free already")]
    fn freeing_twice_is_a_bug() {
        let mut arena = arena();
        let block = arena.alloc(64).unwrap();
        arena.free(block);
        arena.free(block);
    }

    proptest! {
        /// Any series of `alloc` and `free`: nothing overlaps, nothing is lost, and free ranges that
        /// touch are one.
        #[test]
        fn blocks_never_overlap_and_bytes_are_conserved(
            steps in prop::collection::vec((any::<bool>(), 1_u64..2_000_000, any::<prop::sample::Index>()), 1..120),
        ) {
            let mut arena = arena();
            let total: u64 = SEGMENTS.iter().sum();
            let mut taken: Vec<Block> = Vec::new();
            for (take, len, which) in steps {
                if take {
                    if let Some(block) = arena.alloc(len) {
                        prop_assert!(block.len >= len);
                        prop_assert!(block.end() <= SEGMENTS[block.segment as usize]);
                        let align = if len >= LARGE { PAGE } else { LINE };
                        prop_assert!(block.offset.is_multiple_of(align));
                        prop_assert!(taken.iter().all(|other| !other.overlaps(&block)));
                        taken.push(block);
                    }
                } else if !taken.is_empty() {
                    let block = taken.swap_remove(which.index(taken.len()));
                    arena.free(block);
                }
                let in_use: u64 = taken.iter().map(|block| block.len).sum();
                prop_assert_eq!(free_bytes(&arena) + in_use, total);
                prop_assert_eq!(arena.free.len(), arena.by_len.len());
            }
            for block in taken {
                arena.free(block);
            }
            let whole: BTreeMap<_, _> = [((0, 0), SEGMENTS[0]), ((1, 0), SEGMENTS[1])].into();
            prop_assert_eq!(&arena.free, &whole);
        }
    }
}
