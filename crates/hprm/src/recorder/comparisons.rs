//! How the clock of another machine compares with that of this one, in the course of a run.
//!
//! The launcher asks what the clock there shows, again and again; each answer tells the offset to half of the time that it
//! took. Of several answers in a few seconds the quickest one counts. Between them, the offset is taken to go in a straight
//! line. What follows for the times of a trace is in `times`.

use hprm_core::{Nanos, PhysicalTime};
use hprm_federated::DRIFT;

use crate::agent::ClockReading;

/// Of how much time one comparison is kept.
const SLOT: Nanos = 10_000_000_000;

/// The offset changes by a tenth of the time that goes by, at most; otherwise a clock has been set, or has stood still.
const FASTEST: Nanos = 10;

/// The comparisons of a run, in the order of time.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub(super) struct Comparisons(Vec<(PhysicalTime, ClockReading)>);

impl Comparisons {
    /// The clock there has shown `shown` between the two moments here. Returns whether that says more than what is known.
    pub(super) fn add(&mut self, [sent, shown, answered]: [i64; 3]) -> bool {
        let fresh = ClockReading::of(sent, shown, answered);
        let at = PhysicalTime(shown);
        let slot = |at: PhysicalTime| at.0.div_euclid(SLOT);
        let replaced = self.0.last().copied().filter(|(before, _)| slot(*before) == slot(at));
        let known = self.0.len() - usize::from(replaced.is_some());
        let last = known.checked_sub(1).map(|place| self.0[place]);
        let is_better = replaced.is_none_or(|(_, reading)| fresh.bound < reading.bound);
        let counts = is_better && last.is_none_or(|last| is_possible(last, (at, fresh)));
        if counts {
            self.0.truncate(known);
            self.0.push((at, fresh));
        }
        counts
    }

    /// By how much the clock there is ahead when it shows `at`.
    pub(super) fn at(&self, at: PhysicalTime) -> Option<ClockReading> {
        let next = self.0.partition_point(|(time, _)| *time <= at);
        let before = next.checked_sub(1).map(|place| self.0[place]);
        match (before, self.0.get(next).copied()) {
            (Some(before), Some(after)) => Some(between(before, after, at)),
            (one, other) => one.or(other).map(|(time, reading)| {
                let away = i128::from(at.since(time)).abs() * i128::from(DRIFT) / 1_000_000_000;
                let drifted = i64::try_from(away).unwrap_or(i64::MAX);
                ClockReading { bound: reading.bound.saturating_add(drifted), ..reading }
            }),
        }
    }

    /// The least exact of them; none if there are none.
    pub(super) fn worst_bound(&self) -> Option<Nanos> {
        self.0.iter().map(|(_, reading)| reading.bound).max()
    }
}

/// Whether two comparisons in a row are of clocks that only drift.
fn is_possible(
    (before, last): (PhysicalTime, ClockReading),
    (at, fresh): (PhysicalTime, ClockReading),
) -> bool {
    let passed = at.since(before);
    let changed = fresh.offset.saturating_sub(last.offset).saturating_abs();
    let bounds = fresh.bound.saturating_add(last.bound);
    passed > 0 && changed.saturating_sub(bounds) <= passed / FASTEST && changed < passed
}

fn between(
    (from, first): (PhysicalTime, ClockReading),
    (to, second): (PhysicalTime, ClockReading),
    at: PhysicalTime,
) -> ClockReading {
    let (passed, all) = (i128::from(at.since(from)), i128::from(to.since(from).max(1)));
    let along = |from: i64, to: i64| {
        let change = (i128::from(to) - i128::from(from)) * passed / all;
        from.saturating_add(i64::try_from(change).unwrap_or_default())
    };
    ClockReading {
        offset: along(first.offset, second.offset),
        bound: along(first.bound, second.bound),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const SECOND: i64 = 1_000_000_000;

    fn compared(answers: &[[i64; 3]]) -> Comparisons {
        let mut comparisons = Comparisons::default();
        answers.iter().for_each(|answer| _ = comparisons.add(*answer));
        comparisons
    }

    #[test]
    fn the_quickest_answer_of_some_seconds_counts() {
        let mut comparisons = Comparisons::default();
        assert!(comparisons.add([0, 500, 1_000]));
        assert!(!comparisons.add([2_000, 2_700, 4_000]), "it took longer");
        assert!(comparisons.add([5_000, 5_100, 5_200]));
        assert!(comparisons.add([20 * SECOND, 20 * SECOND + 2_000, 20 * SECOND + 4_000]));
        let at = |time| comparisons.at(PhysicalTime(time)).unwrap();
        assert_eq!(at(5_100), ClockReading { offset: 0, bound: 100 });
        assert_eq!(at(20 * SECOND + 2_000).bound, 2_000);
        assert_eq!(comparisons.worst_bound(), Some(2_000));
        assert_eq!(Comparisons::default().at(PhysicalTime(0)), None);
    }

    #[test]
    fn between_two_the_offset_goes_in_a_straight_line_and_outside_it_is_less_sure() {
        let shown = |at: i64, ahead: i64| [at - ahead - 50, at, at - ahead + 50];
        let comparisons = compared(&[shown(0, 100), shown(100 * SECOND, 1_100)]);
        let at = |time| comparisons.at(PhysicalTime(time)).unwrap();
        assert_eq!([at(0).offset, at(50 * SECOND).offset], [100, 600]);
        assert_eq!(at(50 * SECOND).bound, 50);
        assert_eq!([at(101 * SECOND).offset, at(101 * SECOND).bound], [1_100, 50 + DRIFT]);
        assert_eq!([at(-SECOND).offset, at(-SECOND).bound], [100, 50 + DRIFT]);
    }

    #[test]
    fn a_clock_that_jumps_is_not_followed() {
        let shown = |at: i64, ahead: i64| [at - ahead, at, at - ahead];
        let mut comparisons = compared(&[shown(0, 0)]);
        for answer in [shown(20 * SECOND, 15 * SECOND), shown(-20 * SECOND, 0)] {
            assert!(!comparisons.add(answer));
        }
        assert!(comparisons.add(shown(20 * SECOND, SECOND)));
    }

    proptest! {
        /// Whatever comes, later is later: times of a lane stay in their order.
        #[test]
        fn later_is_later(answers: Vec<[i64; 3]>, times: [i64; 2]) {
            let comparisons = compared(&answers);
            let [first, second] = if times[0] <= times[1] { times } else { [times[1], times[0]] };
            let here = |time| {
                let offset = comparisons.at(PhysicalTime(time)).map_or(0, |it| it.offset);
                i128::from(time) - i128::from(offset)
            };
            prop_assert!(here(first) <= here(second));
        }
    }
}
