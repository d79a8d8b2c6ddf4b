//! How the clock of another machine compares with that of this one, in the course of a run.
//!
//! The launcher asks what the clock there shows, again and again; each answer bounds the offset by half of the time that it
//! took. What is known already bounds it, too, less and less: clocks drift. Both hold, and one pair of bounds is kept for some
//! seconds. Between two of them, the offset is taken to go in a straight line. What follows for the times of a trace is in
//! `times`.

use hprm_core::{Nanos, PhysicalTime};
use hprm_federated::DRIFT;

use crate::agent::ClockReading;

/// Of how much time one comparison is kept.
const SLOT: Nanos = 10_000_000_000;

/// The comparisons of a run, in the order of time.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub(super) struct Comparisons(Vec<(PhysicalTime, ClockReading)>);

impl Comparisons {
    /// The clock there has shown `shown` between the two moments here. Returns whether that says more than what is known.
    pub(super) fn add(&mut self, [sent, shown, answered]: [i64; 3]) -> bool {
        let (at, fresh) = (PhysicalTime(shown), ClockReading::of(sent, shown, answered));
        let slot = |at: PhysicalTime| at.0.div_euclid(SLOT);
        let latest = self.0.last().copied();
        let Some(both) = latest.map_or(Some(fresh), |it| both(drifted(it, at), fresh)) else {
            // A clock has been set, or has stood still.
            return false;
        };
        let replaced = latest.filter(|(before, _)| slot(*before) == slot(at));
        let kept = self.0.len() - usize::from(replaced.is_some());
        let before = kept.checked_sub(1).map(|place| self.0[place]);
        let counts = replaced.is_none_or(|(_, known)| both.bound < known.bound)
            && before.is_none_or(|before| is_later(before, (at, both)));
        if counts {
            self.0.truncate(kept);
            self.0.push((at, both));
        }
        counts
    }

    /// By how much the clock there is ahead when it shows `at`.
    pub(super) fn at(&self, at: PhysicalTime) -> Option<ClockReading> {
        let next = self.0.partition_point(|(time, _)| *time <= at);
        let before = next.checked_sub(1).map(|place| self.0[place]);
        match (before, self.0.get(next).copied()) {
            (Some(before), Some(after)) => Some(between(before, after, at)),
            (one, other) => one.or(other).map(|known| drifted(known, at)),
        }
    }

    /// The least exact of them; none if there are none.
    pub(super) fn worst_bound(&self) -> Option<Nanos> {
        self.0.iter().map(|(_, reading)| reading.bound).max()
    }
}

/// What a comparison says of another moment.
fn drifted((time, reading): (PhysicalTime, ClockReading), at: PhysicalTime) -> ClockReading {
    let drifted = i128::from(at.since(time)).abs() * i128::from(DRIFT) / 1_000_000_000;
    let drifted = i64::try_from(drifted).unwrap_or(i64::MAX);
    ClockReading { bound: reading.bound.saturating_add(drifted), ..reading }
}

/// What two say together of one moment; none if one of them must be wrong.
fn both(one: ClockReading, other: ClockReading) -> Option<ClockReading> {
    let least = |it: ClockReading| it.offset.saturating_sub(it.bound);
    let most = |it: ClockReading| it.offset.saturating_add(it.bound);
    let (least, most) = (least(one).max(least(other)), most(one).min(most(other)));
    let width = i128::from(most) - i128::from(least);
    let bound = i64::try_from((width + 1) / 2).unwrap_or(i64::MAX);
    (width >= 0).then(|| ClockReading { offset: most.saturating_sub(bound), bound })
}

/// Whether the later one of two moments there is later here as well.
fn is_later(
    (before, last): (PhysicalTime, ClockReading),
    (at, fresh): (PhysicalTime, ClockReading),
) -> bool {
    let changed = fresh.offset.saturating_sub(last.offset).saturating_abs();
    changed < at.since(before)
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
    fn an_answer_counts_if_it_says_more_than_those_before() {
        let mut comparisons = Comparisons::default();
        assert!(comparisons.add([0, 500, 1_000]));
        assert!(!comparisons.add([2_000, 2_700, 4_000]), "it took longer");
        assert!(comparisons.add([5_000, 5_100, 5_200]));
        assert!(comparisons.add([20 * SECOND, 20 * SECOND + 2_000, 20 * SECOND + 4_000]));
        let at = |time| comparisons.at(PhysicalTime(time)).unwrap();
        assert_eq!(at(5_100), ClockReading { offset: 0, bound: 100 });
        assert_eq!(at(20 * SECOND + 2_000).bound, 2_000);
        assert_eq!(comparisons.worst_bound(), Some(2_000));
        // What was known before says more than an answer that took long.
        assert!(comparisons.add([30 * SECOND, 31 * SECOND, 32 * SECOND]));
        assert_eq!(comparisons.worst_bound(), Some(2_000 + 11 * DRIFT - 1));
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
        assert!(comparisons.add(shown(20 * SECOND, 9_000_000)));
    }

    proptest! {
        /// Of clocks that drift no more than others, the truth is within the bounds, at any time.
        #[test]
        fn the_truth_is_within_the_bounds(
            ahead in -SECOND..SECOND, drift in -DRIFT..DRIFT,
            answers in prop::collection::vec((1..20 * SECOND, 0..10_000_000_i64, 0..10_000_000_i64), 1..40),
            asked in 0..400 * SECOND,
        ) {
            let there = |here: i64| here + ahead + here / 1_000 * drift / 1_000_000;
            let (mut comparisons, mut here) = (Comparisons::default(), 0);
            for (pause, to, from) in answers {
                here += pause;
                comparisons.add([here, there(here + to), here + to + from]);
                here += to + from;
            }
            let known = comparisons.at(PhysicalTime(there(asked))).unwrap();
            let wrong = (known.offset - (there(asked) - asked)).abs();
            // Here drift is counted in the time of the other clock, which is a little longer or shorter.
            let slack = 10 + asked / 1_000_000;
            prop_assert!(wrong <= known.bound + slack, "{wrong} {known:?}");
        }

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
