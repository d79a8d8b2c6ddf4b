//! Whether what a federate sends may wait for what it will send next.
//!
//! One write is cheaper than many, and wakes its reader once. While tags follow one another so quickly
//! that the delay does not matter, messages wait for those of the next tags; a command must not wait for a long
//! reaction. The machine here decides by how long tags have taken, and knows nothing of links or tags.

use hprm_core::{Nanos, PhysicalTime};
use nix::sys::resource::{UsageWho, getrusage};
use nix::sys::time::TimeValLike;

/// How long what is to be written, and what is to be read, may wait while one tag follows another, in
/// nanoseconds: about as long as it takes to wake up a process.
pub(super) const LINGER: Nanos = 50_000;

/// The same for a federate that has been busy for long.
const LONGEST_LINGER: Nanos = 500_000;

/// How long a tag may usually take where messages wait for the next one.
const SHORT: Nanos = LINGER / 2;

/// How many tags follow one another without a pause before anything waits: a command must not wait for
/// the long reaction that a short one precedes.
const BURST: u32 = 16;

/// How many tags it takes to forget that one took long: one that is ten milliseconds late keeps what
/// follows from waiting for more than a hundred.
const MEMORY: Nanos = 64;

/// What a thread has used of a processor so far.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub(super) struct ThreadUsage {
    /// Time on a processor.
    processor: Nanos,
    /// How often it left its processor because it had to wait for something.
    pauses: i64,
}

impl ThreadUsage {
    /// What the calling thread has used; zero where the system does not tell.
    pub(super) fn of_this_thread() -> Self {
        getrusage(UsageWho::RUSAGE_THREAD).map_or_else(
            |_| Self::default(),
            |usage| Self {
                processor: (usage.user_time() + usage.system_time()).num_nanoseconds(),
                pauses: usage.voluntary_context_switches(),
            },
        )
    }
}

/// How long the tags of a federate have taken, and how busy it has been.
#[derive(Debug)]
pub(super) struct Pace {
    /// When its links were last written.
    flushed_at: PhysicalTime,
    /// When it last had nothing to do.
    waited_at: PhysicalTime,
    /// How many tags it has completed since.
    in_a_row: u32,
    /// How long a tag takes, of late: one that took long is forgotten slowly.
    usual_tag: Nanos,
    /// What the thread had used when it was last asked.
    used: ThreadUsage,
    /// How long the tags since then have taken.
    known: Nanos,
}

impl Pace {
    pub(super) fn new() -> Self {
        Self {
            flushed_at: PhysicalTime(0),
            waited_at: PhysicalTime(0),
            in_a_row: 0,
            usual_tag: 0,
            used: ThreadUsage::default(),
            known: 0,
        }
    }

    /// Notes that everything has been written.
    pub(super) fn flushed(&mut self, now: PhysicalTime) {
        self.flushed_at = now;
    }

    /// Notes that there was nothing to do until now.
    pub(super) fn waited(&mut self, now: PhysicalTime) {
        self.waited_at = now;
        self.in_a_row = 0;
    }

    /// Notes how long a tag has taken; `used` is asked now and then.
    pub(super) fn tag_took(&mut self, duration: Nanos, used: impl Fn() -> ThreadUsage) {
        let duration = duration.max(0);
        self.in_a_row = self.in_a_row.saturating_add(1);
        if self.in_a_row == BURST {
            self.used = used();
            self.known = 0;
        }
        let own = match duration < SHORT {
            true => duration,
            false => self.own_share(duration, used()),
        };
        self.known = self.known.saturating_add(own);
        self.usual_tag += own / MEMORY - self.usual_tag / MEMORY;
    }

    /// How much of the duration of a tag is due to the tag itself. While other processes have the processor,
    /// the tag seems long; if the federate therefore wrote every message at once, the readers would take the
    /// processor again. A body that sleeps or waits for a file is slow itself.
    fn own_share(&mut self, duration: Nanos, used: ThreadUsage) -> Nanos {
        let before = std::mem::replace(&mut self.used, used);
        let known = std::mem::take(&mut self.known);
        if self.in_a_row < BURST || used.pauses != before.pauses {
            return duration;
        }
        (used.processor - before.processor - known).clamp(0, duration)
    }

    /// Whether what the last tags have sent may wait for what the next one sends. A federate that has been
    /// busy for long may take longer: what its messages wait for is not a small share of that.
    pub(super) fn may_linger(&self, now: PhysicalTime) -> bool {
        let busy = now.since(self.waited_at);
        let linger = (busy / 16).clamp(LINGER, LONGEST_LINGER);
        self.in_a_row > BURST && self.usual_tag < SHORT && now.since(self.flushed_at) < linger
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;

    const QUICK: Nanos = 4_000;
    const LONG: Nanos = 3_000_000;

    /// A federate, its time and what its thread has used.
    struct Busy {
        pace: Pace,
        now: PhysicalTime,
        used: Cell<ThreadUsage>,
    }

    impl Busy {
        /// After some quick tags in a row.
        fn new() -> Self {
            let (pace, now) = (Pace::new(), PhysicalTime(1_000_000_000));
            let mut busy = Self { pace, now, used: Cell::default() };
            busy.pace.waited(busy.now);
            busy.quick_tags(BURST + 1);
            busy
        }

        fn tag(&mut self, duration: Nanos, processor: Nanos, pauses: i64) {
            let ThreadUsage { processor: before, pauses: paused } = self.used.get();
            self.used.set(ThreadUsage { processor: before + processor, pauses: paused + pauses });
            self.now = PhysicalTime(self.now.0 + duration);
            self.pace.tag_took(duration, || self.used.get());
        }

        fn quick_tags(&mut self, count: u32) {
            for _ in 0..count {
                self.tag(QUICK, QUICK, 0);
            }
        }

        fn lingers(&mut self) -> bool {
            self.pace.flushed(self.now);
            self.pace.may_linger(self.now)
        }
    }

    #[test]
    fn messages_wait_for_one_another_only_in_a_long_row_of_quick_tags() {
        let mut busy = Busy::new();
        assert!(busy.lingers());
        busy.pace.waited(busy.now);
        assert!(!busy.lingers());
        busy.quick_tags(BURST);
        assert!(!busy.lingers());
        busy.quick_tags(1);
        assert!(busy.lingers());
    }

    #[test]
    fn what_has_waited_long_is_written() {
        let mut busy = Busy::new();
        assert!(busy.lingers());
        assert!(!busy.pace.may_linger(PhysicalTime(busy.now.0 + LINGER)));
        // After ten milliseconds of work it may take longer.
        busy.quick_tags(2_500);
        assert!(busy.lingers());
        assert!(busy.pace.may_linger(PhysicalTime(busy.now.0 + LINGER)));
        assert!(!busy.pace.may_linger(PhysicalTime(busy.now.0 + LONGEST_LINGER)));
    }

    #[test]
    fn nothing_waits_for_a_while_after_a_reaction_that_computes() {
        let mut busy = Busy::new();
        busy.tag(LONG, LONG, 0);
        assert!(!busy.lingers());
        busy.quick_tags(200);
        assert!(busy.lingers());
    }

    #[test]
    fn nothing_waits_for_a_while_after_a_reaction_that_sleeps() {
        let mut busy = Busy::new();
        busy.tag(LONG, QUICK, 1);
        assert!(!busy.lingers());
    }

    #[test]
    fn time_in_which_other_processes_ran_does_not_count() {
        let mut busy = Busy::new();
        for _ in 0..100 {
            busy.tag(LONG, QUICK, 0);
            assert!(busy.lingers());
            busy.quick_tags(20);
        }
        busy.tag(LONG, LONG / 2, 0);
        assert!(!busy.lingers());
    }

    #[test]
    fn the_system_says_what_a_thread_has_used() {
        let before = ThreadUsage::of_this_thread();
        while ThreadUsage::of_this_thread().processor == before.processor {}
        std::thread::sleep(std::time::Duration::from_millis(1));
        assert!(ThreadUsage::of_this_thread().pauses > before.pauses);
    }
}
