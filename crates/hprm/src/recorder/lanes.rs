//! The rings of a process: one for each thread that runs reactions, and one for tracepoints of all others.

use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread::Thread;

use hprm_core::PhysicalTime;

use super::record::{Record, Words};
use super::ring::{Ring, lost};
use crate::Clock;

/// How many records a ring holds if nothing else is said: 3 MiB.
pub const DEFAULT_CAPACITY: usize = 1 << 16;

/// The rings, and what the collector must know besides.
#[derive(Debug)]
pub struct Lanes {
    /// The last one is that of tracepoints.
    rings: Vec<Ring>,
    /// The names of tracepoints. It is locked by those that record one, so that one at a time does.
    names: Mutex<Vec<String>>,
    collector: OnceLock<Thread>,
}

impl Lanes {
    /// Lanes for so many threads, whose rings hold `capacity` records each.
    #[must_use]
    pub fn new(threads: usize, capacity: usize) -> Self {
        Self {
            rings: (0..=threads).map(|_| Ring::new(capacity)).collect(),
            names: Mutex::default(),
            collector: OnceLock::new(),
        }
    }

    /// Records in the lane of a thread what happens now.
    #[inline]
    pub(super) fn push(&self, lane: usize, record: Record) {
        let now = Clock::now();
        self.push_during(lane, record, [now; 2]);
    }

    /// Records in the lane of a thread what has begun and ended at these times. Where something later is recorded already,
    /// it has begun then: times go up in a lane.
    #[inline]
    pub(super) fn push_during(&self, lane: usize, record: Record, [begin, end]: [PhysicalTime; 2]) {
        let ring = &self.rings[lane];
        let time = begin.max(ring.latest());
        ring.note_time(time.max(end));
        if ring.push(&Record { time, ..record }) {
            self.wake();
        }
    }

    /// The clock of the thread of this lane was set: earlier times may follow.
    pub(super) fn forget_time(&self, lane: usize) {
        self.rings[lane].note_time(PhysicalTime(0));
    }

    /// The latest time that threads have recorded: to read the clock takes longer than to record.
    #[inline]
    pub(super) fn latest(&self) -> PhysicalTime {
        let threads = &self.rings[..self.rings.len() - 1];
        let latest = threads.iter().map(Ring::latest).max();
        latest.filter(|it| *it > PhysicalTime(0)).unwrap_or_else(Clock::now)
    }

    /// The number that a tracepoint of this name has: 1 or more.
    pub(super) fn name(&self, name: &str) -> u32 {
        let mut names = self.names();
        let place = names.iter().position(|known| known == name).unwrap_or_else(|| {
            names.push(name.to_owned());
            names.len() - 1
        });
        u32::try_from(place).map_or(u32::MAX, |place| place.saturating_add(1))
    }

    /// Records a tracepoint; any thread may.
    pub(super) fn push_tracepoint(&self, record: Record) {
        let names = self.names();
        self.push(self.rings.len() - 1, record);
        drop(names);
    }

    /// How many lanes there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.rings.len()
    }

    /// There is always one.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        false
    }

    /// The names that have come since there were `known`.
    pub(super) fn names_since(&self, known: usize) -> Vec<String> {
        self.names()[known..].to_vec()
    }

    pub(super) fn drain(&self, lane: usize, take: impl FnMut(Words)) {
        self.rings[lane].drain(take);
    }

    /// The record of those that are missing at the end of a lane.
    pub(super) fn missing(&self, lane: usize) -> Option<Record> {
        let missing = self.rings[lane].missing();
        (missing > 0).then(|| lost(missing, Clock::now()))
    }

    /// How many records were lost in all lanes.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.rings.iter().map(Ring::lost).sum()
    }

    /// From now on, the collector is this thread.
    pub(super) fn collected_by(&self, thread: Thread) {
        // The first one stays.
        let _ = self.collector.set(thread);
    }

    #[cold]
    pub(super) fn wake(&self) {
        if let Some(collector) = self.collector.get() {
            collector.unpark();
        }
    }

    fn names(&self) -> MutexGuard<'_, Vec<String>> {
        self.names.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use hprm_core::Tag;

    use super::super::record::{Flags, Kind};
    use super::*;

    #[test]
    fn times_go_up_in_a_lane() {
        let lanes = Lanes::new(2, 8);
        let push = |lane, time, end| {
            let record = Record::new(Kind::Waited, Flags::NONE, 0, Tag::START);
            lanes.push_during(lane, record, [time, end].map(PhysicalTime));
        };
        [(0, 5, 9), (0, 7, 7), (1, 3, 20), (0, 8, 12), (0, 30, 30)]
            .into_iter()
            .for_each(|(lane, time, end)| push(lane, time, end));
        let mut times = [Vec::new(), Vec::new()];
        for (lane, times) in times.iter_mut().enumerate() {
            lanes.drain(lane, |words| times.push(Record::of_words(words).unwrap().time.0));
        }
        assert_eq!(times, [vec![5, 9, 9, 30], vec![3]]);
        assert_eq!(lanes.latest(), PhysicalTime(30));
        push(2, 40, 40);
        assert_eq!(lanes.latest(), PhysicalTime(30), "tracepoints are of any thread");
        lanes.forget_time(0);
        push(0, 4, 4);
        lanes.drain(0, |words| assert_eq!(Record::of_words(words).unwrap().time.0, 4));
    }
}
