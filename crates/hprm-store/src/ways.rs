//! Which way of copying large values is the quicker one: through the caches of the processor, or past them.
//!
//! That depends on the machine, and nothing that a program can ask for tells it: past the caches, a copy of 16 MiB takes 0.75
//! of the time on one server and twice the time on another. So [`Ways`] tries both on copies that are to be made anyway, and
//! decides by how long they have taken. It is plain data, and reads no clock: what copies says how long that has taken.

use crate::shm::stream;

/// From how many bytes on there are two ways. Of what is smaller, readers find much in the caches.
pub const STREAMED: usize = 8 << 20;

/// How often each way is tried before one is chosen. More than once: the first copy of a process may find anything.
const TRIALS: u32 = 2;

/// At every copy of so many, the slower way is tried again: what else runs may have changed which one that is.
const AGAIN: u32 = 128;

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

/// What is known of both ways.
#[derive(Debug)]
pub struct Ways {
    classes: [Class; CLASSES],
}

/// What is known of them for values of about one size.
#[derive(Clone, Copy, Debug)]
struct Class {
    copies: u32,
    /// Nanoseconds for each byte; infinite as long as nothing is known.
    cached: f64,
    streamed: f64,
}

impl Ways {
    /// Nothing is known.
    #[must_use]
    pub const fn new() -> Self {
        let unknown = Class { copies: 0, cached: f64::INFINITY, streamed: f64::INFINITY };
        Self { classes: [unknown; CLASSES] }
    }

    /// Which way the next copy of `len` bytes goes.
    #[must_use]
    pub fn next(&self, len: usize) -> Way {
        match class_of(len) {
            Some(class) => self.classes[class].next(),
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
    fn next(&self) -> Way {
        let is_trial = self.copies < 2 * TRIALS;
        let streams = match is_trial {
            true => self.copies % 2 == 1,
            false => (self.streamed < self.cached) != self.copies.is_multiple_of(AGAIN),
        };
        if streams { Way::Streamed } else { Way::Cached }
    }

    fn took(&mut self, way: Way, rate: f64) {
        self.copies = self.copies.wrapping_add(1).max(1);
        let known = match way {
            Way::Cached => &mut self.cached,
            Way::Streamed => &mut self.streamed,
        };
        // A copy that was interrupted says little, one that was quick that it can be quick.
        *known = if rate < *known { rate } else { *known + (rate - *known) * SLOWER };
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
    }

    #[test]
    fn the_quicker_way_is_found_and_kept() {
        let (mut caches, mut memory) = (Machine::new(70, 160), Machine::new(160, 120));
        assert_eq!(caches.copies(2 * TRIALS, 16), TRIALS);
        assert_eq!(memory.copies(2 * TRIALS, 16), TRIALS);
        assert_eq!(caches.copies(AGAIN - 2 * TRIALS, 16), 0);
        assert_eq!(memory.copies(AGAIN - 2 * TRIALS, 16), AGAIN - 2 * TRIALS);
    }

    #[test]
    fn the_other_way_is_tried_again_and_wins_once_it_is_quicker() {
        let mut machine = Machine::new(70, 160);
        machine.copies(2 * TRIALS, 16);
        assert_eq!(machine.copies(10 * AGAIN, 16), 10);
        // Another program fills the caches from now on.
        (machine.cached, machine.streamed) = (300, 150);
        machine.copies(2 * AGAIN, 16);
        assert!(machine.copies(AGAIN, 16) >= AGAIN - 1);
    }

    #[test]
    fn a_copy_that_is_interrupted_changes_nothing() {
        let mut machine = Machine::new(70, 100);
        machine.copies(2 * TRIALS, 16);
        let len = usize::try_from(16 * MIB).unwrap();
        machine.ways.took(Way::Cached, len, 16 * 200);
        assert_eq!(machine.ways.next(len), Way::Cached);
    }

    #[test]
    fn each_size_has_a_way_of_its_own_and_small_values_have_one() {
        let mut machine = Machine::new(70, 160);
        machine.copies(2 * TRIALS, 8);
        (machine.cached, machine.streamed) = (160, 70);
        machine.copies(2 * TRIALS, 64);
        assert_eq!((machine.copies(5, 8), machine.copies(5, 64)), (0, 5));
        assert_eq!(machine.copies(100, 7), 0);
        // What is larger than all classes is in the last one.
        machine.copies(2 * TRIALS, 1 << 14);
        assert_eq!(machine.copies(5, 1 << 20), 5);
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
