//! Where the times of a share lie on the clock of the launcher, and how exact that is.
//!
//! A federate that sets its clock by the RTI's records times of that clock, as far as the two agree; one that does not
//! records those of its machine. What is known besides are comparisons of the two machines' clocks (`comparisons`).
//!
//! | clock | times | within |
//! |---|---|---|
//! | follows the RTI's all the time | as they are | the federate's own bound |
//! | is set once | moved by what the comparisons say that it has drifted since, beyond their bounds | that, and the bounds |
//! | is never set | moved by what the comparisons say | their bounds |

use hprm_core::{Nanos, PhysicalTime};

use super::comparisons::Comparisons;
use super::record::{Kind, Record};
use crate::agent::ClockReading;

/// A federate sets its clock.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct ClockSet {
    /// When, by the clock that is set.
    pub(super) at: PhysicalTime,
    /// The RTI's time minus that of the machine.
    pub(super) offset: Nanos,
    /// By how much that may be wrong.
    pub(super) error: Nanos,
    /// Whether it follows the RTI's clock from then on.
    pub(super) is_kept: bool,
}

impl ClockSet {
    /// What a record says.
    pub(super) fn of(record: &Record) -> Option<Self> {
        let [offset, error] = record.values.map(u64::cast_signed);
        let set = Self { at: record.time, offset, error, is_kept: record.detail != 0 };
        (record.kind == Kind::ClockSet).then_some(set)
    }
}

/// See the module.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub(super) struct Times {
    set: Option<ClockSet>,
    comparisons: Comparisons,
    /// Whether records are from before the clock was set.
    is_before: bool,
}

impl Times {
    pub(super) fn new(set: Option<ClockSet>, comparisons: Comparisons) -> Self {
        Self { set, comparisons, is_before: set.is_some() }
    }

    /// The record at which the clock is set has come.
    pub(super) fn note_set(&mut self) {
        self.is_before = false;
    }

    /// The launcher's time of what has that time in the share.
    pub(super) fn shown(&self, time: PhysicalTime) -> PhysicalTime {
        let Some(set) = self.set else {
            let ahead = self.comparisons.at(time).map_or(0, |reading| reading.offset);
            return time.plus(ahead.saturating_neg());
        };
        let time = if self.is_before { time.plus(set.offset) } else { time };
        if set.is_kept { time } else { time.plus(self.drifted(&set, time).saturating_neg()) }
    }

    /// By how much a clock that was set has gained on the RTI's since, as far as that is certain.
    fn drifted(&self, set: &ClockSet, time: PhysicalTime) -> Nanos {
        let now = self.comparisons.at(time.plus(set.offset.saturating_neg()));
        let (Some(then), Some(now)) = (self.compared_at(set), now) else { return 0 };
        let gained = now.offset.saturating_sub(then.offset);
        let uncertain = self.uncertain(then);
        match gained {
            ..0 => gained.saturating_add(uncertain).min(0),
            _ => gained.saturating_sub(uncertain).max(0),
        }
    }

    /// How the clocks compared when one was set.
    fn compared_at(&self, set: &ClockSet) -> Option<ClockReading> {
        self.comparisons.at(set.at.plus(set.offset.saturating_neg()))
    }

    /// By how much a clock may have drifted that compared like this, without that it shows.
    fn uncertain(&self, then: ClockReading) -> Nanos {
        then.bound.saturating_add(self.comparisons.worst_bound().unwrap_or_default())
    }

    /// How far times can be from the launcher's, if that is known.
    pub(super) fn within(&self) -> Option<Nanos> {
        match &self.set {
            None => self.comparisons.worst_bound(),
            Some(set) if set.is_kept => Some(set.error),
            Some(set) => {
                let uncertain = self.compared_at(set).map_or(0, |then| self.uncertain(then));
                Some(set.error.saturating_add(uncertain))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const SECOND: i64 = 1_000_000_000;

    /// A clock that is so far ahead of the launcher's, and gains so much in each second.
    fn compared(ahead: i64, gains: i64) -> Comparisons {
        let mut comparisons = Comparisons::default();
        for second in (0..100).step_by(10) {
            let here = second * SECOND;
            let there = here + ahead + gains * second;
            assert!(comparisons.add([here - 10, there, here + 10]));
        }
        comparisons
    }

    fn set(offset: i64, is_kept: bool) -> Option<ClockSet> {
        Some(ClockSet { at: PhysicalTime(5), offset, error: 7, is_kept })
    }

    #[test]
    fn a_clock_that_is_never_set_is_moved_by_what_it_is_ahead() {
        let times = Times::new(None, compared(-3_000, 0));
        assert_eq!(times.shown(PhysicalTime(50 * SECOND)), PhysicalTime(50 * SECOND + 3_000));
        assert_eq!(times.within(), Some(10));
        let unknown = Times::default();
        assert_eq!((unknown.shown(PhysicalTime(9)), unknown.within()), (PhysicalTime(9), None));
    }

    #[test]
    fn a_clock_that_follows_the_rti_is_left_as_it_is() {
        let mut times = Times::new(set(-500, true), compared(500, 1_000));
        times.note_set();
        assert_eq!(times.shown(PhysicalTime(50 * SECOND)), PhysicalTime(50 * SECOND));
        assert_eq!(times.within(), Some(7));
    }

    #[test]
    fn drift_since_a_clock_was_set_is_taken_away_where_it_is_certain() {
        let mut times = Times::new(set(-500, false), compared(500, 1_000));
        times.note_set();
        // It has gained 50 us, of which two bounds of 10 ns are not certain.
        let shown = times.shown(PhysicalTime(50 * SECOND)).0;
        assert!((shown - (50 * SECOND - 50_000 + 20)).abs() <= 2, "{shown}");
        assert_eq!(times.within(), Some(27));
        let mut steady = Times::new(set(-500, false), compared(500, 0));
        steady.note_set();
        assert_eq!(steady.shown(PhysicalTime(50 * SECOND)), PhysicalTime(50 * SECOND));
        let alone = Times::new(set(0, false), Comparisons::default());
        assert_eq!((alone.shown(PhysicalTime(9)).0, alone.within()), (9, Some(7)));
    }

    #[test]
    fn what_is_from_before_the_clock_was_set_is_moved_as_far_as_it_was() {
        for is_kept in [true, false] {
            let mut times = Times::new(set(-500, is_kept), compared(500, 0));
            assert_eq!(times.shown(PhysicalTime(700)), PhysicalTime(200));
            times.note_set();
            assert_eq!(times.shown(PhysicalTime(700)), PhysicalTime(700));
        }
    }

    proptest! {
        #[test]
        fn later_is_later(
            answers: Vec<[i64; 3]>, set in prop::option::of((any::<[i64; 3]>(), any::<bool>())), times: [i64; 2],
        ) {
            let mut comparisons = Comparisons::default();
            answers.iter().for_each(|answer| _ = comparisons.add(*answer));
            let set = set.map(|([at, offset, error], is_kept)| ClockSet {
                at: PhysicalTime(at), offset, error, is_kept,
            });
            let mut shown = Times::new(set, comparisons);
            shown.note_set();
            let [first, second] = if times[0] <= times[1] { times } else { [times[1], times[0]] };
            prop_assert!(shown.shown(PhysicalTime(first)) <= shown.shown(PhysicalTime(second)));
        }
    }
}
