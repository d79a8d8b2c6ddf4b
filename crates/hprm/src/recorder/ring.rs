//! A ring of records: one thread puts them in, another one takes them out, and neither waits.
//!
//! All memory is there from the beginning. Records for which there is no room are counted; the count is a record
//! itself, where they are missing.

use std::sync::atomic::{AtomicI64, AtomicU64, AtomicUsize, Ordering};

use hprm_core::{PhysicalTime, Tag};

use super::record::{Flags, Kind, Record, Words};

const WORDS: usize = size_of::<Words>() / size_of::<u64>();

/// A ring. That one thread only puts records in, and one only takes them out, is up to the users: otherwise records
/// are mixed up, and nothing worse.
#[derive(Debug)]
pub(super) struct Ring {
    slots: Box<[AtomicU64]>,
    capacity: usize,
    producer: Producer,
    consumer: Consumer,
}

/// What the thread writes that puts records in: in a cache line of its own.
#[derive(Default, Debug)]
#[repr(align(128))]
struct Producer {
    /// How many records were put in.
    written: AtomicUsize,
    /// How many records were lost since the last one that was put in.
    missing: AtomicU64,
    /// How many were lost altogether.
    lost: AtomicU64,
    /// The latest time of a record.
    time: AtomicI64,
}

#[derive(Default, Debug)]
#[repr(align(128))]
struct Consumer {
    /// How many records were taken out.
    read: AtomicUsize,
}

impl Ring {
    /// A ring with room for so many records, at least two.
    pub(super) fn new(capacity: usize) -> Self {
        let capacity = capacity.max(2).next_power_of_two();
        Self {
            slots: (0..capacity * WORDS).map(|_| AtomicU64::new(0)).collect(),
            capacity,
            producer: Producer::default(),
            consumer: Consumer::default(),
        }
    }

    /// The latest time of a record is this one.
    #[inline]
    pub(super) fn note_time(&self, now: PhysicalTime) {
        self.producer.time.store(now.0, Ordering::Relaxed);
    }

    /// What [`Self::note_time`] has noted last.
    #[inline]
    pub(super) fn latest(&self) -> PhysicalTime {
        PhysicalTime(self.producer.time.load(Ordering::Relaxed))
    }

    /// Puts a record in, or counts it as lost. Returns whether the ring has become half full.
    #[inline]
    pub(super) fn push(&self, record: &Record) -> bool {
        let written = self.producer.written.load(Ordering::Relaxed);
        let filled = written.wrapping_sub(self.consumer.read.load(Ordering::Acquire));
        let missing = self.producer.missing.load(Ordering::Relaxed);
        if missing != 0 || filled == self.capacity {
            return self.push_scarce(record, written, filled, missing);
        }
        self.put(written, &record.words());
        self.producer.written.store(written.wrapping_add(1), Ordering::Release);
        filled + 1 == self.capacity / 2
    }

    /// The same where there is no room, or was none for the record before.
    #[cold]
    fn push_scarce(&self, record: &Record, written: usize, filled: usize, missing: u64) -> bool {
        if self.capacity - filled < 2 {
            self.producer.missing.store(missing + 1, Ordering::Relaxed);
            self.producer.lost.fetch_add(1, Ordering::Relaxed);
            return false;
        }
        self.put(written, &lost(missing, record.time).words());
        self.put(written.wrapping_add(1), &record.words());
        self.producer.missing.store(0, Ordering::Relaxed);
        self.producer.written.store(written.wrapping_add(2), Ordering::Release);
        filled + 2 >= self.capacity / 2
    }

    #[inline]
    fn put(&self, at: usize, words: &Words) {
        let place = (at & (self.capacity - 1)) * WORDS;
        for (slot, word) in self.slots[place..place + WORDS].iter().zip(words) {
            slot.store(*word, Ordering::Relaxed);
        }
    }

    /// Takes out all records that are there.
    pub(super) fn drain(&self, mut take: impl FnMut(Words)) {
        let read = self.consumer.read.load(Ordering::Relaxed);
        let written = self.producer.written.load(Ordering::Acquire);
        for at in 0..written.wrapping_sub(read) {
            let place = (read.wrapping_add(at) & (self.capacity - 1)) * WORDS;
            let slots = &self.slots[place..place + WORDS];
            take(std::array::from_fn(|word| slots[word].load(Ordering::Relaxed)));
        }
        self.consumer.read.store(written, Ordering::Release);
    }

    /// How many records were lost.
    pub(super) fn lost(&self) -> u64 {
        self.producer.lost.load(Ordering::Relaxed)
    }

    /// How many of them no record in the ring tells of.
    pub(super) fn missing(&self) -> u64 {
        self.producer.missing.load(Ordering::Relaxed)
    }
}

/// The record that says how many are missing before it.
pub(super) fn lost(count: u64, time: PhysicalTime) -> Record {
    let record = Record::new(Kind::Lost, Flags::NONE, 0, Tag::NEVER).with_values([count, 0]);
    Record { time, ..record }
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;
    use std::sync::atomic::AtomicBool;

    use proptest::prelude::*;

    use super::*;

    fn numbered(number: u64) -> Record {
        Record::new(Kind::Scheduled, Flags::NONE, 0, Tag::START).with_values([number, !number])
    }

    fn drained(ring: &Ring) -> Vec<Record> {
        let mut records = Vec::new();
        ring.drain(|words| records.push(Record::of_words(words).unwrap()));
        records
    }

    proptest! {
        /// The ring does what a queue does that is as long, and says where it lost how many.
        #[test]
        fn it_is_a_bounded_queue(capacity in 2_usize..9, steps in prop::collection::vec(0_usize..12, 1..30)) {
            let ring = Ring::new(capacity);
            let room = capacity.next_power_of_two();
            let (mut model, mut missing, mut number) = (VecDeque::new(), 0, 0);
            for pushes in steps {
                for _ in 0..pushes {
                    let needed = if missing > 0 { 2 } else { 1 };
                    if model.len() + needed > room {
                        missing += 1;
                    } else {
                        if missing > 0 {
                            model.push_back(lost(missing, PhysicalTime(0)));
                            missing = 0;
                        }
                        model.push_back(numbered(number));
                    }
                    ring.push(&numbered(number));
                    number += 1;
                }
                prop_assert_eq!(ring.missing(), missing);
                prop_assert_eq!(drained(&ring), model.drain(..).collect::<Vec<_>>());
            }
        }
    }

    #[test]
    fn two_threads_lose_nothing_that_is_not_counted() {
        const ALL: u64 = 200_000;
        let ring = Ring::new(64);
        let done = AtomicBool::new(false);
        let mut records = Vec::new();
        std::thread::scope(|scope| {
            scope.spawn(|| {
                for number in 0..ALL {
                    ring.push(&numbered(number));
                }
                done.store(true, Ordering::Release);
            });
            while !done.load(Ordering::Acquire) {
                records.extend(drained(&ring));
            }
            records.extend(drained(&ring));
        });
        let mut next = 0;
        for record in records {
            match record.kind {
                Kind::Lost => next += record.values[0],
                _ => {
                    assert_eq!(record.values, [next, !next]);
                    next += 1;
                }
            }
        }
        assert_eq!(next + ring.missing(), ALL);
    }
}
