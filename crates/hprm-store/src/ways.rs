//! Which way of copying large values is the quicker one: through the caches of the processor, or past them.
//!
//! That depends on the machine, and nothing that a program can ask for tells it: past the caches, a copy of 16 MiB takes 0.75
//! of the time on one server and twice the time on another. So [`Ways`] tries both on copies that are to be made anyway, and
//! decides by how long they have taken. It is plain data, and reads no clock: what copies says how long that has taken.

use crate::shm::stream;

/// From how many bytes on there are two ways. Of what is smaller, readers find much in the caches.
pub const STREAMED: usize = 8 << 20;

/// How many copies in a row try a way. The first ones through the caches find there what the other way has left, and only
/// the last ones what they leave for one another.
const CACHED_TRIAL: u32 = 4;
const STREAMED_TRIAL: u32 = 2;

/// How many copies go the quicker way after the first trials of both, which something may have interrupted, before the other
/// one is tried again; how many afterwards, as what else runs may have changed which one is quicker; and how many if it is so
/// by far.
const FIRST_PERIOD: u32 = 32;
const PERIOD: u32 = 128;
const LONG_PERIOD: u32 = 1024;

/// How many times longer the slower way takes if the other one is quicker by far.
const BY_FAR: f64 = 1.2;

/// How many classes of sizes there are, each of twice as many bytes: a way that wins at 8 MiB may lose at 64.
const CLASSES: usize = 8;

/// By how much of the difference a copy that took longer than expected changes what is expected.
const SLOWER: f64 = 0.125;

/// How bytes are copied. The bytes are the same.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Way {
    /// As everything else.
    Cached,
    /// Past the caches.
    Streamed,
}

impl Way {
    fn other(self) -> Self {
        match self {
            Self::Cached => Self::Streamed,
            Self::Streamed => Self::Cached,
        }
    }
}

/// What is known of both ways.
#[derive(Debug)]
pub struct Ways {
    classes: [Class; CLASSES],
}

/// What is known of them for values of about one size.
#[derive(Clone, Copy, Debug)]
struct Class {
    /// Which way copies go now, and how many more before that is decided again.
    way: Way,
    left: u32,
    is_trial: bool,
    /// Whether both have been tried again since the first time.
    is_sure: bool,
    /// Nanoseconds for each byte; infinite as long as nothing is known.
    cached: f64,
    streamed: f64,
}

impl Ways {
    /// Nothing is known.
    #[must_use]
    pub const fn new() -> Self {
        Self { classes: [Class::UNKNOWN; CLASSES] }
    }

    /// Which way the next copy of `len` bytes goes.
    #[must_use]
    pub fn next(&self, len: usize) -> Way {
        match class_of(len) {
            Some(class) => self.classes[class].way,
            None => Way::Cached,
        }
    }

    /// Notes that a copy of `len` bytes has taken so many nanoseconds.
    pub fn took(&mut self, way: Way, len: usize, nanos: u64) {
        if let Some(class) = class_of(len) {
            self.classes[class].took(way, nanos as f64 / len as f64);
        }
    }
}

impl Default for Ways {
    fn default() -> Self {
        Self::new()
    }
}

impl Class {
    const UNKNOWN: Self = Self {
        way: Way::Cached,
        left: CACHED_TRIAL,
        is_trial: true,
        is_sure: false,
        cached: f64::INFINITY,
        streamed: f64::INFINITY,
    };

    fn took(&mut self, way: Way, rate: f64) {
        let known = match way {
            Way::Cached => &mut self.cached,
            Way::Streamed => &mut self.streamed,
        };
        // A copy that was interrupted says little, one that was quick that it can be quick.
        *known = if rate < *known { rate } else { *known + (rate - *known) * SLOWER };
        self.left -= 1;
        if self.left == 0 {
            self.decide();
        }
    }

    /// Decides which way the next copies go: for a period the quicker way, then for a trial the other one.
    fn decide(&mut self) {
        let is_known = self.cached.is_finite() && self.streamed.is_finite();
        self.is_trial = !(self.is_trial && is_known);
        if self.is_trial {
            self.way = self.way.other();
            self.left = match self.way {
                Way::Cached => CACHED_TRIAL,
                Way::Streamed => STREAMED_TRIAL,
            };
        } else {
            self.way = if self.streamed < self.cached { Way::Streamed } else { Way::Cached };
            self.left = self.period();
        }
    }

    /// How many copies go the quicker way before the next trial.
    fn period(&mut self) -> u32 {
        let (less, more) = (self.cached.min(self.streamed), self.cached.max(self.streamed));
        match (std::mem::replace(&mut self.is_sure, true), more > less * BY_FAR) {
            (false, _) => FIRST_PERIOD,
            (true, false) => PERIOD,
            (true, true) => LONG_PERIOD,
        }
    }
}

/// Which class a value of `len` bytes belongs to; none if there is only one way.
fn class_of(len: usize) -> Option<usize> {
    let larger = (len / STREAMED).checked_ilog2()?;
    Some((larger as usize).min(CLASSES - 1))
}

/// Copies bytes.
///
/// # Panics
///
/// If the lengths differ.
pub fn copy(way: Way, to: &mut [u8], from: &[u8]) {
    assert_eq!(to.len(), from.len(), "what is copied has a place of its size");
    match way {
        Way::Cached => to.copy_from_slice(from),
        Way::Streamed => stream(to, from),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MIB: u64 = 1 << 20;

    /// A machine on which both ways take so many nanoseconds for each MiB.
    struct Machine {
        ways: Ways,
        cached: u64,
        streamed: u64,
    }

    impl Machine {
        fn new(cached: u64, streamed: u64) -> Self {
            Self { ways: Ways::new(), cached, streamed }
        }

        /// Makes copies of that many MiB; returns how many of them went past the caches.
        fn copies(&mut self, count: u32, mib: u64) -> u32 {
            let len = usize::try_from(mib * MIB).unwrap();
            let mut streamed = 0;
            for _ in 0..count {
                let way = self.ways.next(len);
                let rate = if way == Way::Cached { self.cached } else { self.streamed };
                streamed += u32::from(way == Way::Streamed);
                self.ways.took(way, len, rate * mib);
            }
            streamed
        }

        /// The way of the next copy of that many MiB.
        fn next(&self, mib: usize) -> Way {
            self.ways.next(mib << 20)
        }
    }

    /// How many copies are the first trials.
    const TRIALS: u32 = CACHED_TRIAL + STREAMED_TRIAL;

    #[test]
    fn the_quicker_way_is_found_and_kept() {
        let (mut caches, mut memory) = (Machine::new(70, 160), Machine::new(160, 120));
        assert_eq!(caches.copies(TRIALS, 16), STREAMED_TRIAL);
        assert_eq!(memory.copies(TRIALS, 16), STREAMED_TRIAL);
        assert_eq!(caches.copies(FIRST_PERIOD, 16), 0);
        assert_eq!(memory.copies(FIRST_PERIOD, 16), FIRST_PERIOD);
        // Trials become rare.
        let count = 10 * LONG_PERIOD;
        assert_eq!(caches.copies(count, 16), 10 * STREAMED_TRIAL);
        assert_eq!(count - memory.copies(count, 16), 10 * CACHED_TRIAL);
    }

    #[test]
    fn ways_that_are_about_as_quick_are_tried_more_often() {
        let mut machine = Machine::new(100, 110);
        machine.copies(TRIALS + FIRST_PERIOD, 16);
        assert_eq!(machine.copies(10 * (PERIOD + STREAMED_TRIAL), 16), 10 * STREAMED_TRIAL);
    }

    #[test]
    fn the_other_way_wins_once_it_is_quicker() {
        let mut machine = Machine::new(70, 160);
        machine.copies(3 * LONG_PERIOD, 16);
        assert_eq!(machine.next(16), Way::Cached);
        // Another program fills the caches from now on.
        (machine.cached, machine.streamed) = (300, 150);
        machine.copies(2 * LONG_PERIOD, 16);
        assert!(machine.copies(LONG_PERIOD, 16) >= LONG_PERIOD - CACHED_TRIAL);
    }

    #[test]
    fn the_first_copies_of_a_trial_say_little() {
        let mut ways = Ways::new();
        let len = 16 << 20;
        // Copies through the caches have to come after one another.
        let rates = [(Way::Cached, &[116, 112, 90, 80][..]), (Way::Streamed, &[85; 2][..])];
        for (way, rates) in rates {
            for rate in rates {
                assert_eq!(ways.next(len), way);
                ways.took(way, len, rate * 16);
            }
        }
        assert_eq!(ways.next(len), Way::Cached);
    }

    #[test]
    fn trials_that_were_interrupted_are_made_again_soon() {
        let mut machine = Machine::new(300, 100);
        machine.copies(TRIALS, 16);
        machine.cached = 70;
        assert_eq!(machine.copies(FIRST_PERIOD, 16), FIRST_PERIOD);
        assert_eq!(machine.copies(CACHED_TRIAL + PERIOD, 16), 0);
    }

    #[test]
    fn one_copy_that_is_interrupted_changes_nothing() {
        let mut machine = Machine::new(70, 100);
        machine.copies(TRIALS, 16);
        machine.ways.took(Way::Cached, 16 << 20, 16 * 250);
        assert_eq!(machine.copies(FIRST_PERIOD - 1, 16), 0);
        machine.copies(STREAMED_TRIAL, 16);
        assert_eq!(machine.copies(PERIOD, 16), 0);
    }

    #[test]
    fn each_size_has_a_way_of_its_own_and_small_values_have_one() {
        use Way::{Cached, Streamed};
        let mut machine = Machine::new(70, 160);
        machine.copies(TRIALS, 8);
        (machine.cached, machine.streamed) = (160, 70);
        machine.copies(TRIALS, 64);
        let ways = [8, 15, 64, 127].map(|mib| machine.next(mib));
        assert_eq!(ways, [Cached, Cached, Streamed, Streamed]);
        assert_eq!(machine.copies(100, 7), 0);
        // What is larger than all classes is in the last one.
        machine.copies(TRIALS, 1 << 14);
        assert_eq!(machine.next(1 << 20), Streamed);
    }

    #[test]
    fn both_ways_copy_the_same_bytes_wherever_they_begin_and_end() {
        let from: Vec<u8> = (0..STREAMED + 300).map(|at| (at * 7 / 3) as u8).collect();
        for (skip, len) in [(0, STREAMED), (1, STREAMED + 77), (63, STREAMED + 64), (5, 1000)] {
            for way in [Way::Cached, Way::Streamed] {
                let mut to = vec![0xAA; len + skip + 100];
                copy(way, &mut to[skip..skip + len], &from[skip + 9..skip + 9 + len]);
                assert!(to[skip..skip + len] == from[skip + 9..skip + 9 + len]);
                assert!(to[..skip].iter().chain(&to[skip + len..]).all(|byte| *byte == 0xAA));
            }
        }
    }

    #[test]
    #[should_panic(expected = "a place of its size")]
    fn a_copy_of_another_length_is_a_fault() {
        copy(Way::Streamed, &mut [0; 3], &[0; 4]);
    }
}
