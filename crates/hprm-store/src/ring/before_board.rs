//! What a board counts is in the ring when the board can be read, in a memory as weak as the language permits.

use std::sync::atomic::Ordering;

use super::sleeping::RingMemory;
use super::*;
use crate::board::sequence::{current, publish};
use crate::weak_memory::{Sides, WeakMemory, WeakWord, explore};

/// Where the board is: behind the ring.
const BOARD: usize = DATA + 2;

/// How many messages of one byte are sent.
const MESSAGES: u64 = 4;

/// A sender that counts its messages on its board, and their receiver.
#[derive(Clone)]
struct Counted {
    writer: Writer<RingMemory>,
    reader: Reader<RingMemory>,
    /// The board: a count, and two buffers of one word.
    board: Vec<WeakWord>,
    posted: u64,
    received: u64,
}

impl Counted {
    fn new() -> Self {
        let (ring, _) = ends(RingMemory::new());
        let board = (BOARD..BOARD + 3).map(WeakWord).collect();
        let (writer, reader) = (Writer::new(ring.clone()), Reader::new(ring));
        Self { writer, reader, board, posted: 0, received: 0 }
    }
}

impl Sides for Counted {
    type Key = [u64; 9];

    fn key(&self) -> Self::Key {
        let Self { writer, reader, posted, received, .. } = self;
        let Writer { written, read, origin, looks_at, .. } = *writer;
        let Reader { read: taken, origin: adopted, written: seen, .. } = *reader;
        [written, read, origin, looks_at, taken, adopted, seen, *posted, *received]
    }

    fn able(&self) -> Vec<usize> {
        let able = [self.posted < MESSAGES, self.received < MESSAGES];
        (0..2).filter(|side| able[*side]).collect()
    }

    fn step(&mut self, side: usize) {
        if side == 0 {
            if self.writer.written == self.posted {
                assert_eq!(self.writer.write(&[1]), Ok(1));
            } else {
                self.posted += 1;
                publish(&self.board, 1, [self.posted]);
            }
            return;
        }
        let read = |at: usize| self.board[at].load(Ordering::Relaxed);
        let counted = current(&self.board, 0, 1, read).map_or(0, |(_, counted)| counted);
        let mut bytes = [0; MESSAGES as usize];
        self.received += self.reader.read(&mut bytes).unwrap() as u64;
        assert!(self.received >= counted, "a message was counted before it was in the ring");
    }
}

#[test]
fn no_message_is_counted_before_it_is_in_the_ring() {
    let states = explore(WeakMemory::new(2).prepared(Counted::new));
    assert!(states > 50, "only {states} states were found");
}

#[test]
#[should_panic(expected = "a message was counted before it was in the ring")]
fn without_fences_it_would_be() {
    explore(WeakMemory::without_fences(2).prepared(Counted::new));
}
