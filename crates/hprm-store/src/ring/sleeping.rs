//! No side sleeps on, and no byte is an old one, in a memory as weak as the language permits.
//!
//! A word of this memory keeps all values that it has had. A side that loads it gets any of them that is not older than one
//! that it knows of, and by acquiring what was released it comes to know what the other side knew. Every order of steps is
//! tried, with everything that each load may get. Both sides are those of the ring itself.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};

use super::*;

/// For each word, the number of the newest of its values that one knows of.
type Known = BTreeMap<usize, usize>;

#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Default)]
struct Value {
    value: u64,
    /// What a side knows once it has acquired it.
    tells: Known,
}

/// All words and what each side knows of them, while one of the sides takes a step.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Default)]
struct Words {
    values: BTreeMap<usize, Vec<Value>>,
    known: [Known; 2],
    side: usize,
    /// Which values this step's loads get, by how many newer ones there are; the newest, after those.
    wanted: Vec<usize>,
    /// The same with how many each load has had to choose from.
    taken: Vec<(usize, usize)>,
}

thread_local! {
    static WORDS: RefCell<Words> = RefCell::default();
}

#[derive(Clone)]
struct WeakWord(usize);

#[derive(Clone)]
struct WeakMemory(Vec<WeakWord>);

/// How many bytes a ring holds here.
const CAPACITY: u64 = 2 * WORD as u64;

impl Memory for WeakMemory {
    type Word = WeakWord;

    const CAPACITY: usize = CAPACITY as usize;

    fn words(&self) -> &[WeakWord] {
        &self.0
    }
}

impl Word for WeakWord {
    fn load(&self, order: Ordering) -> u64 {
        WORDS.with_borrow_mut(|words| words.load(self.0, order))
    }

    fn store(&self, value: u64, order: Ordering) {
        WORDS.with_borrow_mut(|words| words.store(self.0, value, order));
    }

    fn swap(&self, value: u64, order: Ordering) -> u64 {
        WORDS.with_borrow_mut(|words| words.swap(self.0, value, order))
    }
}

fn learn(known: &mut Known, told: &Known) {
    for (at, number) in told {
        let mine = known.entry(*at).or_default();
        *mine = *number.max(mine);
    }
}

fn acquires(order: Ordering) -> bool {
    matches!(order, Ordering::Acquire | Ordering::AcqRel)
}

fn releases(order: Ordering) -> bool {
    matches!(order, Ordering::Release | Ordering::AcqRel)
}

impl Words {
    fn values(&mut self, at: usize) -> &mut Vec<Value> {
        self.values.entry(at).or_insert_with(|| vec![Value::default()])
    }

    fn load(&mut self, at: usize, order: Ordering) -> u64 {
        // What was never stored is zero, and tells nothing.
        let Some(values) = self.values.get(&at) else { return 0 };
        let newest = values.len() - 1;
        let oldest = self.known[self.side].get(&at).copied().unwrap_or_default();
        let newer = self.wanted.get(self.taken.len()).copied().unwrap_or_default();
        self.taken.push((newer, newest - oldest + 1));
        self.take(at, newest - newer, order)
    }

    fn take(&mut self, at: usize, number: usize, order: Ordering) -> u64 {
        let Value { value, tells } = self.values(at)[number].clone();
        let known = &mut self.known[self.side];
        known.insert(at, number);
        if acquires(order) {
            learn(known, &tells);
        }
        value
    }

    fn store(&mut self, at: usize, value: u64, order: Ordering) {
        self.put(at, value, order, Known::new());
    }

    /// Nothing comes between what a swap gets and what it puts there, so a side that acquires the latter knows also what
    /// the former tells.
    fn swap(&mut self, at: usize, value: u64, order: Ordering) -> u64 {
        let newest = self.values(at).len() - 1;
        let tells = self.values(at)[newest].tells.clone();
        let found = self.take(at, newest, order);
        self.put(at, value, order, tells);
        found
    }

    fn put(&mut self, at: usize, value: u64, order: Ordering, mut tells: Known) {
        let number = self.values(at).len();
        let known = &mut self.known[self.side];
        known.insert(at, number);
        if releases(order) {
            learn(&mut tells, known);
        }
        self.values(at).push(Value { value, tells });
    }

    /// Forgets values that no side can get any more, so that states are equal whose future is.
    fn forget(&mut self) {
        let oldest = |at: &usize| {
            let known = self.known.each_ref().map(|known| known.get(at).copied().unwrap_or(0));
            (*at, known[WRITER].min(known[READER]))
        };
        let oldest: Known = self.values.keys().map(oldest).collect();
        let shift = |known: &mut Known| {
            known.iter_mut().for_each(|(at, number)| *number = number.saturating_sub(oldest[at]));
            known.retain(|_, number| *number > 0);
        };
        self.known.iter_mut().for_each(shift);
        for (at, values) in &mut self.values {
            values.drain(..oldest[at]);
            values.iter_mut().for_each(|value| shift(&mut value.tells));
        }
    }

    /// What the loads of the next attempt at this step are to get; none, if all has been tried.
    fn next_wanted(mut self) -> Option<Vec<usize>> {
        while let Some((newer, choices)) = self.taken.pop() {
            if newer + 1 < choices {
                let before = self.taken.iter().map(|(newer, _)| *newer);
                return Some(before.chain([newer + 1]).collect());
            }
        }
        None
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
struct Sides {
    writer: Writer<WeakMemory>,
    reader: Reader<WeakMemory>,
    progress: Progress,
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

impl Sides {
    /// Two sides with `filled` bytes in the ring, which both know of.
    fn new(filled: u64) -> Self {
        let memory = WeakMemory((0..DATA + 2).map(WeakWord).collect());
        let (ring, _) = ends(memory);
        let (mut writer, reader) = (Writer::new(ring.clone()), Reader::new(ring.clone()));
        WORDS.set(Words::default());
        writer.written = filled;
        ring.store(WRITTEN, filled);
        WORDS.with_borrow_mut(|words| words.known[READER] = words.known[WRITER].clone());
        let progress = Progress {
            states: [SideState::Busy; 2],
            moved: [0; 2],
            must_look: [false; 2],
            must_withdraw: false,
            notified: [false; 2],
        };
        Self { writer, reader, progress }
    }

    fn step(&mut self, side: usize, filled: u64) {
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
        } else if self.progress.moved[side] == [GOAL, filled + GOAL][side] {
            self.progress.states[side] = SideState::Done;
        } else if self.moves(side, filled) {
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
    fn moves(&mut self, side: usize, filled: u64) -> bool {
        let moved = self.progress.moved[side];
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

    /// All that a state consists of.
    fn key(&self, words: &Words) -> (Progress, [u64; 5], Words) {
        let Self { writer, reader, progress } = self;
        let sides = [writer.written, writer.read, reader.read, reader.written, reader.looked];
        (progress.clone(), sides, words.clone())
    }
}

/// Goes from two sides with so many bytes in the ring to every state that they can get into, and counts these.
fn explore(filled: u64) -> usize {
    let first = Sides::new(filled);
    let mut open = vec![(first, WORDS.take())];
    let mut seen = BTreeSet::new();
    while let Some((sides, words)) = open.pop() {
        if !seen.insert(sides.key(&words)) {
            continue;
        }
        let may_go_on = |side: &usize| {
            matches!(sides.progress.states[*side], SideState::Busy | SideState::Announced)
        };
        let able: Vec<_> = [WRITER, READER].into_iter().filter(may_go_on).collect();
        let done = sides.progress.states == [SideState::Done; 2];
        assert!(done || !able.is_empty(), "{:?}: a side sleeps on", sides.progress.states);
        for side in able {
            let mut wanted = Some(Vec::new());
            while let Some(these) = wanted {
                WORDS.set(Words { side, wanted: these, ..words.clone() });
                let mut next = sides.clone();
                next.step(side, filled);
                let after = WORDS.take();
                let (values, known) = (after.values.clone(), after.known.clone());
                let mut words = Words { values, known, ..Words::default() };
                words.forget();
                open.push((next, words));
                wanted = after.next_wanted();
            }
        }
    }
    seen.len()
}

#[test]
fn no_reader_sleeps_on_whatever_order_steps_have_and_whatever_loads_get() {
    let states = explore(0);
    assert!(states > 300, "only {states} states were found");
}

#[test]
fn no_writer_sleeps_on_whatever_order_steps_have_and_whatever_loads_get() {
    let states = explore(CAPACITY);
    assert!(states > 5_000, "only {states} states were found");
}
