//! The physical clock of this process. The only place that reads one.

use std::sync::atomic::{AtomicI64, Ordering};

use hprm_core::PhysicalTime;
use rustix::time::{ClockId, clock_gettime};

/// Reads physical time; never goes back (handbook, "physical time").
#[derive(Debug)]
pub struct Clock;

/// The latest reading, in nanoseconds.
static LATEST: AtomicI64 = AtomicI64::new(i64::MIN);

impl Clock {
    /// The time now. A reading earlier than the last one counts as one nanosecond after it.
    #[must_use]
    pub fn now() -> PhysicalTime {
        let read = clock_gettime(ClockId::Realtime);
        let nanos = read.tv_sec * 1_000_000_000 + i64::from(read.tv_nsec as i32);
        let before = LATEST.fetch_max(nanos, Ordering::Relaxed);
        if nanos >= before {
            return PhysicalTime(nanos);
        }
        PhysicalTime(LATEST.fetch_add(1, Ordering::Relaxed) + 1)
    }
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
