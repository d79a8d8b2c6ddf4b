//! Readers get whole texts, and no process sleeps on, in a memory as weak as the language permits.

use super::*;
use crate::weak_memory::{Sides, WeakMemory, WeakWord, explore};

impl Loads for Vec<WeakWord> {
    type Word = WeakWord;

    fn load(&self, at: usize) -> u64 {
        self[at].load(Ordering::Relaxed)
    }
}

/// The words of a memory.
fn words(count: usize) -> Vec<WeakWord> {
    (0..count).map(WeakWord).collect()
}

/// How many words a text has here.
const LEN: usize = 2;

/// How many texts the owner publishes: each buffer is used again and again.
const TEXTS: u64 = 4;

/// How often the reader reads.
const READS: usize = 3;

/// An owner and a reader.
#[derive(Clone)]
struct Text {
    words: Vec<WeakWord>,
    published: u64,
    reads: usize,
    /// The number of the last publication that the reader has seen.
    seen: u64,
}

impl Text {
    fn new() -> Self {
        Self { words: words(1 + 2 * LEN), published: 0, reads: 0, seen: 0 }
    }
}

impl Sides for Text {
    type Key = (u64, usize, u64);

    fn key(&self) -> Self::Key {
        (self.published, self.reads, self.seen)
    }

    fn able(&self) -> Vec<usize> {
        let able = [self.published < TEXTS, self.reads < READS];
        (0..2).filter(|side| able[*side]).collect()
    }

    fn step(&mut self, side: usize) {
        if side == 0 {
            self.published += 1;
            return publish(&self.words, LEN, [self.published; LEN]);
        }
        self.reads += 1;
        let read = |buffer| [0, 1].map(|at| self.words.load(buffer + at));
        match current(&self.words, 0, LEN, read) {
            Some((count, text)) => {
                assert_eq!(text, [count; LEN], "parts of several texts");
                assert!(count >= self.seen, "an older text than before");
                self.seen = count;
            }
            None => assert_eq!(self.seen, 0, "nothing, after there was something"),
        }
    }
}

#[test]
fn no_text_is_read_in_part_whatever_loads_get() {
    let states = explore(WeakMemory::new(2).prepared(Text::new));
    assert!(states > 50, "only {states} states were found");
}

#[test]
#[should_panic(expected = "parts of several texts")]
fn without_fences_it_would_be() {
    explore(WeakMemory::without_fences(2).prepared(Text::new));
}

/// How many words of memory each of the following boards has: a count, two buffers of one word, and a lane.
const BOARD: usize = 4;
const ASLEEP: usize = 3;

/// Up to where two processes count, each the number after that of the other one.
const GOAL: u64 = 5;

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
enum State {
    /// It has not yet shown its number.
    Counts,
    /// It has, and has to look whether the other one sleeps.
    Looks,
    /// It is awake, and its lane still says that it sleeps.
    Withdraws,
    Reads,
    /// There was nothing to read, so it is about to announce that it sleeps.
    Announces,
    /// It has announced that, and looks once more.
    LooksOnceMore,
    Asleep,
    Done,
}

/// One of two processes with a board each, as federates have them.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord)]
struct Process {
    state: State,
    number: u64,
    /// How many publications there were when it last read.
    read: u64,
    /// What it has read last.
    theirs: u64,
    notified: bool,
}

#[derive(Clone)]
struct Pair {
    words: Vec<WeakWord>,
    processes: [Process; 2],
}

impl Pair {
    fn new() -> Self {
        let process =
            |number| Process { state: State::Counts, number, read: 0, theirs: 0, notified: false };
        Self { words: words(2 * BOARD), processes: [1, 2].map(process) }
    }

    /// Whether a board shows something that its reader has not read.
    fn has_news(&self, side: usize) -> bool {
        self.words.load((1 - side) * BOARD) != self.processes[side].read
    }

    /// Reads as a federate does: the count, then what is current, which may be newer.
    fn reads(&mut self, side: usize) {
        let start = (1 - side) * BOARD;
        let count = self.words.load(start);
        if count == self.processes[side].read {
            return;
        }
        if let Some((_, number)) = current(&self.words, start, 1, |at| self.words.load(at)) {
            let process = &mut self.processes[side];
            (process.read, process.theirs) = (count, number);
        }
    }

    fn wake_up(&mut self, side: usize) {
        let process = &mut self.processes[side];
        if process.state == State::Asleep && std::mem::take(&mut process.notified) {
            process.state = State::Withdraws;
        }
    }
}

impl Sides for Pair {
    type Key = [Process; 2];

    fn key(&self) -> Self::Key {
        self.processes.clone()
    }

    fn able(&self) -> Vec<usize> {
        let states = self.processes.each_ref().map(|it| it.state);
        let is_able = |side: &usize| !matches!(states[*side], State::Asleep | State::Done);
        let able: Vec<_> = (0..2).filter(is_able).collect();
        assert!(!able.is_empty() || states == [State::Done; 2], "{states:?}: a process sleeps on");
        able
    }

    fn step(&mut self, side: usize) {
        let (own, other) = (side * BOARD, 1 - side);
        let Process { state, number, .. } = self.processes[side];
        self.processes[side].state = match state {
            State::Counts => {
                publish(&self.words[own..], 1, [number]);
                State::Looks
            }
            State::Looks => {
                before_look::<WeakWord>();
                self.processes[other].notified |= self.words.load(other * BOARD + ASLEEP) != 0;
                self.wake_up(other);
                if number < GOAL { State::Reads } else { State::Done }
            }
            State::Withdraws => {
                self.words[own + ASLEEP].store(0, Ordering::Relaxed);
                State::Reads
            }
            State::Reads => {
                self.reads(side);
                if self.processes[side].theirs > number {
                    self.processes[side].number += 2;
                    State::Counts
                } else {
                    State::Announces
                }
            }
            State::Announces => {
                self.words[own + ASLEEP].store(1, Ordering::Relaxed);
                before_look::<WeakWord>();
                State::LooksOnceMore
            }
            State::LooksOnceMore if self.has_news(side) => State::Withdraws,
            State::LooksOnceMore => State::Asleep,
            State::Asleep | State::Done => unreachable!("it is not able to"),
        };
        self.wake_up(side);
    }
}

#[test]
fn no_process_sleeps_on_whatever_order_steps_have_and_whatever_loads_get() {
    let states = explore(WeakMemory::new(2).prepared(Pair::new));
    assert!(states > 1_000, "only {states} states were found");
}

#[test]
#[should_panic(expected = "a process sleeps on")]
fn without_fences_one_would() {
    explore(WeakMemory::without_fences(2).prepared(Pair::new));
}
