//! Boards: what a process shows of itself to its watchers.
//!
//! A board is a sealed memfd that its owner alone writes, and that other processes of the same user find among the
//! owner's descriptors and map for reading. It has three kinds of contents: *notes*, a few words that change often;
//! *lanes*, a word for each thread; and *cells*, which hold texts of bytes. What they mean is up to the caller.
//!
//! **No reader waits for the owner, and the owner never waits.** Notes and cells have two buffers each and a count of
//! publications; the owner writes the buffer that is not current, and then counts. So there is a whole text at
//! any moment, even if the owner is stopped or killed in the middle of writing. A reader looks at the count before and
//! after, and reads again if it has changed ([`sequence`]).

pub(crate) mod sequence;

use std::os::fd::OwnedFd;
use std::sync::atomic::{AtomicU64, Ordering, fence};

use self::sequence::{before_look, current, publish};
use crate::SegmentError;
use crate::shm::{PublishedWords, WordsView};

/// The name of the memfd of every board, as `/proc/PID/fd` shows it after `/memfd:`.
pub const BOARD_NAME: &str = "hprm-board";

/// How many words a note has.
pub const NOTE: usize = 4;

/// The first word of a board, once it may be read.
const MAGIC: u64 = u64::from_le_bytes(*b"hprmBRD1");

/// How many words two cache lines have: what changes often is not in the lines of the rest.
const LINE: usize = 16;

const LANES: usize = 1;
const CELLS: usize = 2;
/// Where the lengths of cells are.
const CAPACITIES: usize = 3;
const NOTES: usize = LINE;
const FIRST_LANE: usize = 2 * LINE;

/// More of either is no board.
const MOST_LANES: usize = 1 << 12;
const MOST_CELLS: usize = LINE - CAPACITIES;
const LARGEST_CELL: usize = 1 << 28;

const WORD: usize = size_of::<u64>();

/// How much a board has of what.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct BoardLayout {
    /// How many lanes.
    pub lanes: usize,
    /// The most bytes of each cell.
    pub cells: Vec<usize>,
}

impl BoardLayout {
    /// Where a cell begins, and how many words each of its buffers has.
    fn cell(&self, cell: usize) -> Option<(usize, usize)> {
        let capacity = *self.cells.get(cell)?;
        let before = &self.cells[..cell];
        let start = FIRST_LANE + self.lanes.next_multiple_of(LINE);
        Some((start + before.iter().map(|it| Self::words_of(*it)).sum::<usize>(), words(capacity)))
    }

    /// How many words a cell has: its count, and two buffers with the length of what is in them.
    fn words_of(capacity: usize) -> usize {
        1 + 2 * (1 + words(capacity))
    }

    fn count(&self) -> usize {
        let cells: usize = self.cells.iter().map(|it| Self::words_of(*it)).sum();
        FIRST_LANE + self.lanes.next_multiple_of(LINE) + cells
    }

    fn is_possible(&self) -> bool {
        self.lanes <= MOST_LANES
            && self.cells.len() <= MOST_CELLS
            && self.cells.iter().all(|capacity| *capacity <= LARGEST_CELL)
    }
}

/// How many words it takes to hold that many bytes.
fn words(bytes: usize) -> usize {
    bytes.div_ceil(WORD)
}

/// The owner's side of a board. One thread publishes; lanes are the business of others.
#[derive(Debug)]
pub struct Board {
    memory: PublishedWords,
    layout: BoardLayout,
}

impl Board {
    /// A board on which nothing has been published. Nothing reads it before [`Self::open`].
    ///
    /// # Errors
    ///
    /// If the system does not give the memory.
    ///
    /// # Panics
    ///
    /// If the layout has more of something than any board.
    pub fn create(layout: BoardLayout) -> Result<Self, SegmentError> {
        Self::named(BOARD_NAME, layout)
    }

    /// The same in memory of another name: watchers do not find it. Others map it by its descriptor.
    ///
    /// # Errors
    ///
    /// As [`Self::create`].
    ///
    /// # Panics
    ///
    /// As [`Self::create`].
    pub fn named(name: &str, layout: BoardLayout) -> Result<Self, SegmentError> {
        assert!(layout.is_possible(), "the caller has bounded what it shows");
        let memory = PublishedWords::create(name, layout.count())?;
        let words = memory.words();
        words[LANES].store(layout.lanes as u64, Ordering::Relaxed);
        words[CELLS].store(layout.cells.len() as u64, Ordering::Relaxed);
        for (at, capacity) in layout.cells.iter().enumerate() {
            words[CAPACITIES + at].store(*capacity as u64, Ordering::Relaxed);
        }
        Ok(Self { memory, layout })
    }

    /// A descriptor by which another process maps it.
    ///
    /// # Errors
    ///
    /// If this process may open no more.
    pub fn descriptor(&self) -> std::io::Result<OwnedFd> {
        self.memory.descriptor()
    }

    /// From now on, others may read it.
    pub fn open(&self) {
        self.memory.words()[0].store(MAGIC, Ordering::Release);
    }

    /// Publishes the contents of a cell. Returns false, and publishes nothing, if they are too long.
    pub fn publish(&self, cell: usize, bytes: &[u8]) -> bool {
        let Some((start, capacity)) = self.layout.cell(cell) else { return false };
        if words(bytes.len()) > capacity {
            return false;
        }
        let length = std::iter::once(bytes.len() as u64);
        let contents = bytes.chunks(WORD).map(|chunk| {
            let mut word = [0; WORD];
            word[..chunk.len()].copy_from_slice(chunk);
            u64::from_le_bytes(word)
        });
        publish(&self.memory.words()[start..], 1 + capacity, length.chain(contents));
        true
    }

    /// Publishes a note, in a few nanoseconds.
    #[inline]
    pub fn note(&self, note: [u64; NOTE]) {
        publish(&self.memory.words()[NOTES..], NOTE, note);
    }

    /// How many notes there have been.
    #[must_use]
    pub fn notes(&self) -> u64 {
        self.memory.words()[NOTES].load(Ordering::Relaxed)
    }

    /// The word of a lane; zero, if there is no such lane.
    #[inline]
    #[must_use]
    pub fn lane(&self, lane: usize) -> u64 {
        let word = (lane < self.layout.lanes).then(|| &self.memory.words()[FIRST_LANE + lane]);
        word.map_or(0, |word| word.load(Ordering::Relaxed))
    }

    /// Sets the word of a lane, if there is one.
    #[inline]
    pub fn set_lane(&self, lane: usize, value: u64) {
        if lane < self.layout.lanes {
            self.memory.words()[FIRST_LANE + lane].store(value, Ordering::Relaxed);
        }
    }

    /// Comes between what is shown on this board and a look at the boards of others. Of two processes that do both, at
    /// least one sees what the other one has shown, cells and lanes.
    pub fn before_look(&self) {
        before_look::<AtomicU64>();
    }
}

/// A board of another process, or of this one.
#[derive(Debug)]
pub struct BoardView {
    memory: WordsView,
    layout: BoardLayout,
}

impl BoardView {
    /// Maps a board; none, if its owner has not opened it yet, or it is something else.
    ///
    /// # Errors
    ///
    /// If the file is no sealed memfd, or the system does not map it.
    pub fn map(file: &OwnedFd) -> Result<Option<Self>, SegmentError> {
        let memory = WordsView::map(file)?;
        if memory.count() < FIRST_LANE || memory.load(0) != MAGIC {
            return Ok(None);
        }
        fence(Ordering::Acquire);
        let size = |at| usize::try_from(memory.load(at)).unwrap_or(usize::MAX);
        let (lanes, cells) = (size(LANES), size(CELLS));
        if lanes > MOST_LANES || cells > MOST_CELLS {
            return Ok(None);
        }
        let cells = (0..cells).map(|at| size(CAPACITIES + at)).collect();
        let layout = BoardLayout { lanes, cells };
        let is_whole = layout.is_possible() && layout.count() <= memory.count();
        Ok(is_whole.then_some(Self { memory, layout }))
    }

    /// What is in a cell; none if nothing was published there, or what is there is not to be had.
    #[must_use]
    pub fn read(&self, cell: usize) -> Option<Vec<u8>> {
        let mut bytes = Vec::new();
        self.read_into(cell, &mut bytes).then_some(bytes)
    }

    /// The same into a buffer, whose contents it replaces. Returns whether there was something.
    pub fn read_into(&self, cell: usize, bytes: &mut Vec<u8>) -> bool {
        let Some((start, capacity)) = self.layout.cell(cell) else { return false };
        let read = |buffer| {
            let length = usize::try_from(self.memory.load(buffer)).unwrap_or(usize::MAX);
            let length = length.min(capacity * WORD);
            bytes.clear();
            bytes.reserve(words(length) * WORD);
            for at in 0..words(length) {
                bytes.extend_from_slice(&self.memory.load(buffer + 1 + at).to_le_bytes());
            }
            bytes.truncate(length);
        };
        current(&self.memory, start, 1 + capacity, read).is_some()
    }

    /// How often something was published in a cell.
    #[must_use]
    pub fn publications(&self, cell: usize) -> u64 {
        self.layout.cell(cell).map_or(0, |(start, _)| self.memory.load(start))
    }

    /// The last note and how many there have been; none, if there was none.
    #[must_use]
    pub fn note(&self) -> Option<(u64, [u64; NOTE])> {
        let read = |buffer| std::array::from_fn(|at| self.memory.load(buffer + at));
        current(&self.memory, NOTES, NOTE, read)
    }

    /// The word of a lane; none, if there is no such lane.
    #[must_use]
    pub fn lane(&self, lane: usize) -> Option<u64> {
        (lane < self.layout.lanes).then(|| self.memory.load(FIRST_LANE + lane))
    }

    /// How many lanes there are.
    #[must_use]
    pub fn lanes(&self) -> usize {
        self.layout.lanes
    }
}

#[cfg(test)]
mod tests {
    use std::os::fd::AsRawFd;
    use std::sync::atomic::AtomicBool;

    use super::*;

    fn layout() -> BoardLayout {
        BoardLayout { lanes: 3, cells: vec![20, 1000] }
    }

    /// The memory of a board, by its entry among the descriptors of this process.
    fn view(board: &Board) -> Option<BoardView> {
        let path = format!("/proc/self/fd/{}", board.memory.as_raw_fd());
        let file = std::fs::OpenOptions::new().read(true).open(path);
        BoardView::map(&file.unwrap().into()).unwrap()
    }

    #[test]
    fn readers_see_what_was_published_last() {
        let board = Board::create(layout()).unwrap();
        assert!(view(&board).is_none());
        board.open();
        let view = view(&board).unwrap();
        assert_eq!(
            (view.read(0), view.note(), view.lane(2), view.lane(3)),
            (None, None, Some(0), None)
        );
        for text in ["one", "", "seventeen letters"] {
            assert!(board.publish(0, text.as_bytes()));
            assert_eq!(view.read(0).unwrap(), text.as_bytes());
        }
        assert!(!board.publish(0, &[1; 25]));
        assert_eq!(view.read(0).unwrap(), b"seventeen letters");
        assert!(board.publish(1, &[7; 1000]));
        assert_eq!(view.read(1).unwrap(), [7; 1000]);
        assert!(!board.publish(2, b""));
        board.note([1, 2, 3, 4]);
        board.note([5, 6, 7, 8]);
        board.set_lane(2, 9);
        board.set_lane(3, 9);
        assert_eq!((view.note(), board.notes()), (Some((2, [5, 6, 7, 8])), 2));
        assert_eq!((view.lane(1), view.lane(2), view.read(2)), (Some(0), Some(9), None));
    }

    #[test]
    fn what_an_owner_was_about_to_write_when_it_ended_is_not_read() {
        let board = Board::create(layout()).unwrap();
        board.open();
        board.publish(0, b"whole");
        // The other buffer, half written, and not counted.
        let (start, capacity) = board.layout.cell(0).unwrap();
        let half = start
            + 1
            + (1 + capacity) * (board.memory.words()[start].load(Ordering::Relaxed) + 1) as usize
                % 2;
        board.memory.words()[half].store(3, Ordering::Relaxed);
        assert_eq!(view(&board).unwrap().read(0).unwrap(), b"whole");
    }

    #[test]
    #[allow(clippy::disallowed_methods, reason = "a reader and a writer are threads")]
    fn no_text_is_read_in_part_while_the_owner_writes() {
        let board = Board::create(layout()).unwrap();
        board.open();
        let view = view(&board).unwrap();
        let done = AtomicBool::new(false);
        let seen = std::thread::scope(|scope| {
            let reader = scope.spawn(|| {
                let mut seen = 0_u32;
                while !done.load(Ordering::Relaxed) {
                    if let Some(bytes) = view.read(1) {
                        assert!(bytes.iter().all(|byte| usize::from(*byte) == bytes.len() % 251));
                        seen += 1;
                    }
                    if let Some((count, note)) = view.note() {
                        assert_eq!(note, [count; NOTE]);
                    }
                }
                seen
            });
            for round in 1..20_000_u64 {
                let len = (round % 997) as usize;
                assert!(board.publish(1, &vec![(len % 251) as u8; len]));
                board.note([round; NOTE]);
            }
            done.store(true, Ordering::Relaxed);
            reader.join().unwrap()
        });
        assert!(seen > 0);
    }

    #[test]
    fn numbers_that_no_board_has_are_none() {
        for (at, value) in
            [(LANES, u64::MAX), (CELLS, 99), (CAPACITIES, 1 << 40), (CAPACITIES, 100_000)]
        {
            let board = Board::create(layout()).unwrap();
            board.open();
            board.memory.words()[at].store(value, Ordering::Relaxed);
            assert!(view(&board).is_none(), "{at}");
        }
        let board = Board::create(layout()).unwrap();
        board.open();
        board.publish(0, b"text");
        let (start, capacity) = board.layout.cell(0).unwrap();
        for buffer in [start + 1, start + 2 + capacity] {
            board.memory.words()[buffer].store(u64::MAX, Ordering::Relaxed);
        }
        assert_eq!(view(&board).unwrap().read(0).unwrap().len(), 24);
    }
}
