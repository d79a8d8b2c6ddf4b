//! The physical clock of this process. The only place that reads one.

use std::sync::LazyLock;

use hprm_core::PhysicalTime;
use rustix::time::{ClockId, clock_gettime};

/// Reads physical time; never goes back (handbook, "physical time").
///
/// It is the monotonic clock, moved to the Unix epoch once: somebody who sets the clock of the
/// machine does not stop a program or make it run ahead.
#[derive(Debug)]
pub struct Clock;

/// From the monotonic clock to the Unix epoch, in nanoseconds.
static OFFSET: LazyLock<i64> = LazyLock::new(|| read(ClockId::Realtime) - read(ClockId::Monotonic));

impl Clock {
    /// The time now.
    #[must_use]
    pub fn now() -> PhysicalTime {
        PhysicalTime(*OFFSET + read(ClockId::Monotonic))
    }
}

fn read(clock: ClockId) -> i64 {
    let time = clock_gettime(clock);
    time.tv_sec * 1_000_000_000 + time.tv_nsec
}

#[cfg(test)]
mod tests {
    use super::Clock;

    #[test]
    fn never_goes_back() {
        let mut before = Clock::now();
        for _ in 0..1_000 {
            let now = Clock::now();
            assert!(now >= before);
            before = now;
        }
    }
}
