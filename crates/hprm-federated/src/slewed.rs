//! A clock that follows another one's time, and never goes back.
//!
//! It is a function of a local clock: two straight pieces, the first of which makes up for an error
//! and ends, while the second one only makes up for the local clock's drift.

use hprm_core::{Nanos, PhysicalTime};

/// The most by which it runs too fast or too slow to make up for an error, in billionths.
pub(crate) const FASTEST: i64 = 50_000_000;

const BILLION: i128 = 1_000_000_000;

/// See the module.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub struct SlewedClock {
    /// Where the first piece begins, by the local clock.
    from: PhysicalTime,
    /// Where it ends.
    until: PhysicalTime,
    /// How far it is ahead of the local clock at `from`.
    offset: Nanos,
    /// How fast that grows in the first piece, in billionths.
    rate: i64,
    /// How fast it grows afterwards.
    drift: i64,
}

impl SlewedClock {
    /// A clock that shows the local time.
    #[must_use]
    pub const fn new() -> Self {
        Self { from: PhysicalTime(0), until: PhysicalTime(0), offset: 0, rate: 0, drift: 0 }
    }

    /// What it shows when the local clock shows `local`.
    #[must_use]
    pub fn at(&self, local: PhysicalTime) -> PhysicalTime {
        local.plus(self.offset_at(local))
    }

    /// When it shows `at`, by the local clock.
    #[must_use]
    pub fn local(&self, at: PhysicalTime) -> PhysicalTime {
        let first = self.from.plus(self.offset);
        let turn = self.at(self.until);
        let (from, shows, rate) =
            if at <= turn { (self.from, first, self.rate) } else { (self.until, turn, self.drift) };
        let left = i128::from(at.since(shows)).max(0);
        let left = (left * BILLION).div_euclid(BILLION + i128::from(rate));
        if at < first { at.plus(-self.offset) } else { from.plus(saturated(left)) }
    }

    /// How far it is ahead of the local clock.
    pub(crate) fn offset_at(&self, local: PhysicalTime) -> Nanos {
        let first = local.min(self.until).since(self.from).max(0);
        let rest = local.since(self.until.max(self.from)).max(0);
        self.offset.saturating_add(part(first, self.rate)).saturating_add(part(rest, self.drift))
    }

    /// Shows another time from now on. A reader that has read it before may see time go back.
    pub(crate) fn step(&mut self, local: PhysicalTime, offset: Nanos) {
        *self = Self { from: local, until: local, offset, rate: 0, drift: 0 };
    }

    /// Heads for another offset, which it reaches `within` that time if that is not too fast.
    pub(crate) fn steer(&mut self, local: PhysicalTime, target: Nanos, drift: i64, within: Nanos) {
        let offset = self.offset_at(local);
        let error = i128::from(target) - i128::from(offset);
        let rate = (error * BILLION / i128::from(within.max(1)))
            .clamp(i128::from(-FASTEST), i128::from(FASTEST));
        let rate = saturated(rate).saturating_add(drift);
        *self = Self { from: local, until: local.plus(within), offset, rate, drift };
    }
}

impl Default for SlewedClock {
    fn default() -> Self {
        Self::new()
    }
}

/// So many billionths of a time, rounded down.
pub(crate) fn part(time: Nanos, billionths: i64) -> Nanos {
    saturated((i128::from(time) * i128::from(billionths)).div_euclid(BILLION))
}

fn saturated(number: i128) -> i64 {
    i64::try_from(number).unwrap_or(if number < 0 { i64::MIN } else { i64::MAX })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn at(nanos: i64) -> PhysicalTime {
        PhysicalTime(nanos)
    }

    #[test]
    fn it_reaches_what_it_is_steered_to_and_stays() {
        let mut clock = SlewedClock::new();
        clock.steer(at(1_000), 50, 0, 10_000);
        assert_eq!(clock.at(at(1_000)), at(1_000));
        assert_eq!(clock.at(at(6_000)), at(6_025));
        assert_eq!(clock.at(at(11_000)), at(11_050));
        assert_eq!(clock.at(at(99_000)), at(99_050));
    }

    #[test]
    fn it_is_never_faster_than_it_may_be() {
        let mut clock = SlewedClock::new();
        clock.steer(at(0), -1_000_000, 0, 1_000);
        assert_eq!(clock.at(at(1_000)), at(950));
        assert_eq!(clock.at(at(2_000)), at(1_950));
    }

    proptest! {
        #[test]
        fn it_never_goes_back_whatever_it_is_steered_to(
            steps in prop::collection::vec(
                (0..10_000_i64, any::<i32>(), -500_000..500_000_i64, 0..100_000_i64),
                1..40,
            ),
        ) {
            let mut clock = SlewedClock::new();
            let (mut local, mut before) = (at(0), clock.at(at(0)));
            for (pause, target, drift, within) in steps {
                for piece in [pause / 3, 1, 0, pause / 2] {
                    local = local.plus(piece);
                    prop_assert!(clock.at(local) >= before);
                    before = clock.at(local);
                }
                clock.steer(local, i64::from(target), drift, within);
                prop_assert_eq!(clock.at(local), before);
            }
        }

        #[test]
        fn it_tells_when_it_will_show_a_time(
            target in any::<i32>(),
            drift in -500_000..500_000_i64,
            within in 1..100_000_000_i64,
            later in 0..1_000_000_000_i64,
        ) {
            let mut clock = SlewedClock::new();
            clock.step(at(5_000), 77);
            clock.steer(at(9_000), i64::from(target), drift, within);
            let local = clock.local(at(9_077 + later));
            let shown = clock.at(local);
            prop_assert!(shown.since(at(9_077 + later)).abs() <= 3, "{:?}", shown);
        }
    }
}
