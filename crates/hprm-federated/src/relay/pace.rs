//! How fast to send: when a frame counts as lost, and how much may be on its way.
//!
//! The carrier drops what it has no room for. So an end sends little more than what arrives: twice as much for each
//! round trip without a loss, half as much after one, and little after a silence.

use hprm_core::Nanos;

use super::PUT_OFF;
use super::packet::FRAME_LIMIT;

/// Bounds of the time after which a frame without an answer is sent again. The lower one is longer than an agent that
/// is not scheduled for a moment; the upper one bounds how late a link notices that the carrier works again.
const SHORTEST: Nanos = 20_000_000;
const LONGEST: Nanos = 1_000_000_000;

/// How much longer an answer takes at least, perhaps, than those before: one waits for a frame to go with and the
/// others did not, and the clock of a loop is coarse.
const UNEVEN: Nanos = 3 * PUT_OFF;

/// That time before anything is known of the carrier.
const INITIAL: Nanos = 200_000_000;

/// What may be on its way at first and after a silence, and at least: a few long frames, or 64 short ones.
const LEAST: u64 = 4 * FRAME_LIMIT as u64;

/// See the module.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(super) struct Pace {
    /// The mean of round trips, and how much they differ from it.
    round_trip: Option<(Nanos, Nanos)>,
    /// How often in succession nothing was answered.
    timeouts: u32,
    /// How much may be on its way, and up to which amount that may double.
    window: u64,
    threshold: u64,
    limit: u64,
    /// Both before the first of these timeouts.
    before: Option<(u64, u64)>,
    /// Losses of transmissions before this one have been answered by a smaller window.
    answered: u64,
}

impl Pace {
    /// For a link that has at most so much on its way.
    pub(super) fn new(limit: u64) -> Self {
        let (round_trip, timeouts, window, threshold) = (None, 0, LEAST, limit);
        Self { round_trip, timeouts, window, threshold, limit, before: None, answered: 0 }
    }

    /// How much may be on its way, by cost.
    pub(super) fn window(&self) -> u64 {
        self.window
    }

    /// How long a frame may stay without an answer.
    pub(super) fn timeout(&self) -> Nanos {
        let patience = |(mean, spread): (Nanos, Nanos)| mean + (4 * spread).max(UNEVEN);
        let patience = self.round_trip.map_or(INITIAL, patience);
        (patience.clamp(SHORTEST, LONGEST) << self.timeouts.min(6)).min(LONGEST)
    }

    /// A frame that was sent once has been answered, perhaps after it counted as lost.
    pub(super) fn measured(&mut self, time: Nanos) {
        let time = time.max(0);
        self.round_trip = Some(match self.round_trip {
            None => (time, time / 2),
            Some((mean, spread)) => {
                let error = (mean - time).abs();
                (mean - mean / 8 + time / 8, spread - spread / 4 + error / 4)
            }
        });
    }

    /// Something of that cost has arrived.
    pub(super) fn arrived(&mut self, cost: u64) {
        self.timeouts = 0;
        let more = match self.window < self.threshold {
            true => cost,
            false => cost * FRAME_LIMIT as u64 / self.window,
        };
        self.window = (self.window + more).min(self.limit);
    }

    /// A transmission is lost, while others arrive. `latest` is the latest one that has been made.
    pub(super) fn lost(&mut self, transmission: u64, latest: u64) {
        if transmission >= self.answered {
            self.threshold = (self.window / 2).max(LEAST);
            self.window = self.threshold;
            self.answered = latest + 1;
        }
    }

    /// Nothing has been answered for as long as [`Pace::timeout`] says.
    pub(super) fn timed_out(&mut self) {
        if self.timeouts == 0 {
            self.before = Some((self.window, self.threshold));
        }
        self.timeouts += 1;
        self.threshold = (self.window / 2).max(LEAST);
        self.window = LEAST;
    }

    /// What had not been answered in time was only late.
    pub(super) fn was_hasty(&mut self) {
        if let Some((window, threshold)) = self.before.take() {
            (self.window, self.threshold) = (self.window.max(window), threshold);
        }
    }

    /// The carrier works again: what was learnt of its silence is void.
    pub(super) fn resumed(&mut self) {
        self.timeouts = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_that_waits_for_a_frame_is_not_late() {
        for round_trip in [1_000_000, 25_000_000, 300_000_000] {
            let mut pace = Pace::new(1 << 20);
            (0..100).for_each(|_| pace.measured(round_trip));
            assert!(pace.timeout() > round_trip + 2 * PUT_OFF, "{round_trip}");
        }
    }
}
