//! What is counted for a channel: messages, bytes, and the physical time between messages.

use hprm_core::{Nanos, PhysicalTime};
use serde::{Deserialize, Serialize};

/// Messages of one channel in some time.
#[derive(Clone, PartialEq, Debug, Default, Serialize, Deserialize)]
pub struct Tally {
    /// How many there were.
    pub messages: u64,
    /// How many bytes their values had.
    pub bytes: u64,
    /// How many intervals between two messages are known.
    pub intervals: u64,
    /// The shortest one.
    pub shortest: Nanos,
    /// The longest one.
    pub longest: Nanos,
    /// Their mean, and the sum of the squares of what differs from it (Welford's method).
    mean: f64,
    squares: f64,
    /// When the last message was sent, also if that was before the time that is counted.
    last: Option<PhysicalTime>,
}

impl Tally {
    /// A message of that many bytes is sent now.
    pub(super) fn count(&mut self, bytes: u64, now: PhysicalTime) {
        self.messages += 1;
        self.bytes = self.bytes.saturating_add(bytes);
        if let Some(last) = self.last.replace(now) {
            self.add_interval(now.since(last));
        }
    }

    #[expect(
        clippy::cast_precision_loss,
        reason = "of so many nanoseconds, the last few do not matter"
    )]
    fn add_interval(&mut self, interval: Nanos) {
        self.intervals += 1;
        let is_first = self.intervals == 1;
        self.shortest = if is_first { interval } else { self.shortest.min(interval) };
        self.longest = self.longest.max(interval);
        let deviation = interval as f64 - self.mean;
        self.mean += deviation / self.intervals as f64;
        self.squares += deviation * (interval as f64 - self.mean);
    }

    /// What has been counted; counting begins anew.
    pub(super) fn take(&mut self) -> Self {
        let fresh = Self { last: self.last, ..Self::default() };
        std::mem::replace(self, fresh)
    }

    /// The mean interval in nanoseconds; none without intervals.
    #[must_use]
    pub fn mean(&self) -> Option<f64> {
        (self.intervals > 0).then_some(self.mean)
    }

    /// The standard deviation of the intervals in nanoseconds; none without intervals.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "a count is not so large")]
    pub fn deviation(&self) -> Option<f64> {
        (self.intervals > 0).then(|| (self.squares / self.intervals as f64).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn an_interval_may_begin_before_the_time_that_is_counted() {
        let mut tally = Tally::default();
        tally.count(5, PhysicalTime(100));
        let first = tally.take();
        assert_eq!((first.messages, first.bytes, first.mean()), (1, 5, None));
        tally.count(7, PhysicalTime(130));
        let second = tally.take();
        assert_eq!((second.messages, second.bytes), (1, 7));
        assert_eq!((second.shortest, second.longest, second.mean()), (30, 30, Some(30.0)));
        assert_eq!(second.deviation(), Some(0.0));
        assert_eq!(tally.take().messages, 0);
    }

    proptest! {
        #[test]
        fn it_is_what_the_definitions_say(
            intervals in prop::collection::vec(0..1_000_000_000_i64, 1..50),
        ) {
            let mut tally = Tally::default();
            let mut now = PhysicalTime(0);
            tally.count(1, now);
            for interval in &intervals {
                now = now.plus(*interval);
                tally.count(1, now);
            }
            let count = intervals.len() as f64;
            let mean = intervals.iter().sum::<i64>() as f64 / count;
            let squares = intervals.iter().map(|it| (*it as f64 - mean).powi(2)).sum::<f64>();
            let close = |one: f64, other: f64| (one - other).abs() <= 1e-6 * other.abs().max(1.0);
            prop_assert!(close(tally.mean().unwrap(), mean));
            prop_assert!(close(tally.deviation().unwrap(), (squares / count).sqrt()));
            prop_assert_eq!(Some(&tally.shortest), intervals.iter().min());
            prop_assert_eq!(Some(&tally.longest), intervals.iter().max());
            prop_assert_eq!(tally.messages, intervals.len() as u64 + 1);
        }
    }
}
