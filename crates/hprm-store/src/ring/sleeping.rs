//! No side sleeps on, and no byte is an old one, in a memory as weak as the language permits.
//!
//! Every order of steps is tried, with everything that each load may get. Both sides are those of the ring itself.

use super::*;
use crate::weak_memory::{Sides, WeakMemory, WeakWord, explore};

#[derive(Clone)]
pub(super) struct RingMemory(Vec<WeakWord>);

/// How many bytes a ring holds here.
const CAPACITY: u64 = 2 * WORD as u64;

impl Memory for RingMemory {
    type Word = WeakWord;

    const CAPACITY: usize = CAPACITY as usize;

    // It begins again whenever it can.
    const SPAN: u64 = 1;

    fn words(&self) -> &[WeakWord] {
        &self.0
    }
}

impl RingMemory {
    pub(super) fn new() -> Self {
        Self((0..DATA + 2).map(WeakWord).collect())
    }
}

/// The state of one side, which sleeps when it has nothing to do, between two of its steps.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
enum SideState {
    Busy,
    /// It has announced that it is about to sleep, and has not looked once more.
    Announced,
    Asleep,
    Done,
}

const WRITER: usize = 0;
const READER: usize = 1;

/// How many bytes the writer writes, one at a time. The reader reads all there are.
const GOAL: u64 = 2;

/// How many bytes the reader takes one at a time; then it takes all that it finds.
const SINGLE: u64 = 2;

/// Two sides, one step at a time.
#[derive(Clone)]
struct Ends {
    writer: Writer<RingMemory>,
    reader: Reader<RingMemory>,
    progress: Progress,
    /// How many bytes were in the ring at first.
    filled: u64,
}

#[derive(Clone, PartialEq, Eq, PartialOrd, Ord)]
struct Progress {
    states: [SideState; 2],
    /// How many bytes each side has moved.
    moved: [u64; 2],
    /// Whether a side has done something and not yet looked whether the other one sleeps.
    must_look: [bool; 2],
    /// Whether the reader is awake and has not yet withdrawn its announcement.
    must_withdraw: bool,
    /// Whether a side has been notified since it last woke up.
    notified: [bool; 2],
}

impl Ends {
    /// Two sides with `filled` bytes in the ring.
    fn new(filled: u64) -> Self {
        let (ring, _) = ends(RingMemory::new());
        let (mut writer, reader) = (Writer::new(ring.clone()), Reader::new(ring.clone()));
        writer.written = filled;
        ring.store(WRITTEN, filled);
        let progress = Progress {
            states: [SideState::Busy; 2],
            moved: [0; 2],
            must_look: [false; 2],
            must_withdraw: false,
            notified: [false; 2],
        };
        Self { writer, reader, progress, filled }
    }

    /// A side that sleeps wakes up, if it has been notified.
    fn wake_up(&mut self, side: usize) {
        if std::mem::take(&mut self.progress.notified[side]) {
            self.gets_busy(side);
        }
    }

    fn gets_busy(&mut self, side: usize) {
        let before = std::mem::replace(&mut self.progress.states[side], SideState::Busy);
        self.progress.must_withdraw |= side == READER && before != SideState::Busy;
    }

    /// Writes or reads. Returns whether any byte was moved.
    fn moves(&mut self, side: usize) -> bool {
        let (moved, filled) = (self.progress.moved[side], self.filled);
        let count = match side {
            WRITER => self.writer.write(&[moved as u8 + 1]).unwrap(),
            _ => {
                let mut bytes = vec![0; if moved < SINGLE { 1 } else { CAPACITY as usize }];
                let count = self.reader.read(&mut bytes).unwrap();
                for (byte, at) in bytes[..count].iter().zip(moved..) {
                    let right = if at < filled { 0 } else { at - filled + 1 };
                    assert_eq!(u64::from(*byte), right, "byte {at}");
                }
                count
            }
        };
        self.progress.moved[side] += count as u64;
        count > 0
    }
}

impl Sides for Ends {
    type Key = (Progress, [u64; 8]);

    fn key(&self) -> Self::Key {
        let Self { writer, reader, progress, .. } = self;
        let Writer { written, read, origin, looks_at, .. } = *writer;
        let Reader { read: taken, origin: adopted, written: seen, looked, .. } = *reader;
        (progress.clone(), [written, read, origin, looks_at, taken, adopted, seen, looked])
    }

    fn able(&self) -> Vec<usize> {
        let may_go_on = |side: &usize| {
            matches!(self.progress.states[*side], SideState::Busy | SideState::Announced)
        };
        let able: Vec<_> = [WRITER, READER].into_iter().filter(may_go_on).collect();
        let done = self.progress.states == [SideState::Done; 2];
        assert!(done || !able.is_empty(), "{:?}: a side sleeps on", self.progress.states);
        able
    }

    fn step(&mut self, side: usize) {
        let other = 1 - side;
        if std::mem::take(&mut self.progress.must_look[side]) {
            let sleeps = match side {
                WRITER => self.writer.ring.take_sleeping(READER_SLEEPS),
                _ => self.reader.take_waiting_writer(),
            };
            self.progress.notified[other] |= sleeps;
            if self.progress.states[other] == SideState::Asleep {
                self.wake_up(other);
            }
        } else if side == READER && std::mem::take(&mut self.progress.must_withdraw) {
            self.reader.ring.end_sleep(READER_SLEEPS);
        } else if self.progress.moved[side] == [GOAL, self.filled + GOAL][side] {
            self.progress.states[side] = SideState::Done;
        } else if self.moves(side) {
            self.progress.must_look[side] = true;
            self.gets_busy(side);
        } else if self.progress.states[side] == SideState::Announced {
            self.progress.states[side] = SideState::Asleep;
            self.wake_up(side);
        } else {
            self.writer.ring.announce_sleep([WRITER_WAITS, READER_SLEEPS][side]);
            self.progress.states[side] = SideState::Announced;
        }
    }
}

/// Goes from two sides with so many bytes in the ring to every state, and counts these.
fn explored(filled: u64) -> usize {
    explore(WeakMemory::new(2).prepared(|| Ends::new(filled)))
}

#[test]
fn no_reader_sleeps_on_whatever_order_steps_have_and_whatever_loads_get() {
    let states = explored(0);
    assert!(states > 300, "only {states} states were found");
}

#[test]
fn no_writer_sleeps_on_whatever_order_steps_have_and_whatever_loads_get() {
    let states = explored(CAPACITY);
    assert!(states > 5_000, "only {states} states were found");
}
