//! The physical clock of this process. The only place that reads one.
//!
//! In a federate on another host than the RTI, the clock follows the time of the RTI.
//! `hprm_federated::ClockSync` finds out how far the two are apart.

use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};
use std::sync::{LazyLock, PoisonError, RwLock};
use std::time::Duration;

use hprm_core::{Nanos, PhysicalTime};
use hprm_federated::{Correction, SlewedClock};
use rustix::time::{ClockId, clock_gettime};

/// A length of time as tags count it; longer than they can count is for ever.
#[must_use]
pub fn nanoseconds(duration: Duration) -> Nanos {
    Nanos::try_from(duration.as_nanos()).unwrap_or(Nanos::MAX)
}

/// Reads physical time; never goes back while a program runs (handbook, "physical time").
///
/// It is the monotonic clock, moved to the Unix epoch once: setting the clock of the
/// machine does not stop a program or make it run ahead.
#[derive(Debug)]
pub struct Clock;

/// From the monotonic clock to the Unix epoch, in nanoseconds.
static OFFSET: LazyLock<i64> = LazyLock::new(|| read(ClockId::Realtime) - read(ClockId::Monotonic));

/// How wrong the local clock is made, for tests.
static DISTURBANCE: AtomicI64 = AtomicI64::new(0);

/// Whether [`FEDERATION`] is anything but the local clock.
static IS_CORRECTED: AtomicBool = AtomicBool::new(false);

/// The federation's time, as a function of the local one.
static FEDERATION: RwLock<SlewedClock> = RwLock::new(SlewedClock::new());

impl Clock {
    /// The time now, in the federation.
    #[must_use]
    pub fn now() -> PhysicalTime {
        if !IS_CORRECTED.load(Ordering::Acquire) {
            return Self::local();
        }
        // The local clock is read under the lock, so that readings are in the order of corrections.
        let clock = FEDERATION.read().unwrap_or_else(PoisonError::into_inner);
        clock.at(Self::local())
    }

    /// The time now by the clock of this machine, which is never corrected: for timeouts.
    #[must_use]
    pub fn local() -> PhysicalTime {
        let local = *OFFSET + read(ClockId::Monotonic);
        PhysicalTime(local + DISTURBANCE.load(Ordering::Relaxed))
    }

    /// The time now by the clock of this machine as a process has it that starts now. It may go back: the machine's time may
    /// have been set since this process has started.
    #[must_use]
    pub fn of_new_processes() -> PhysicalTime {
        PhysicalTime(read(ClockId::Realtime) + DISTURBANCE.load(Ordering::Relaxed))
    }

    /// The monotonic clock of this machine, in nanoseconds: the same for all of its processes.
    pub(crate) fn monotonic() -> Nanos {
        read(ClockId::Monotonic)
    }

    /// How long it takes until `at`.
    pub(crate) fn until(at: PhysicalTime) -> Nanos {
        Self::local_at(at).since(Self::local())
    }

    /// What the local clock will show, as far as is known, when this one shows `at`.
    pub(crate) fn local_at(at: PhysicalTime) -> PhysicalTime {
        if !IS_CORRECTED.load(Ordering::Acquire) {
            return at;
        }
        FEDERATION.read().unwrap_or_else(PoisonError::into_inner).local(at)
    }

    /// What the clock will show, as far as is known, when the local one shows `local`.
    pub(crate) fn at(local: PhysicalTime) -> PhysicalTime {
        if !IS_CORRECTED.load(Ordering::Acquire) {
            return local;
        }
        FEDERATION.read().unwrap_or_else(PoisonError::into_inner).at(local)
    }

    /// Follows another clock from now on.
    pub(crate) fn correct(correction: Correction) {
        let mut clock = FEDERATION.write().unwrap_or_else(PoisonError::into_inner);
        clock.correct(Self::local(), correction);
        IS_CORRECTED.store(true, Ordering::Release);
    }

    /// Makes the local clock wrong: what it is worth to compare clocks shows on one machine, too.
    pub(crate) fn disturb(by: Nanos) {
        DISTURBANCE.store(by, Ordering::Relaxed);
    }
}

fn read(clock: ClockId) -> i64 {
    let time = clock_gettime(clock);
    time.tv_sec * 1_000_000_000 + time.tv_nsec
}

#[cfg(test)]
mod tests {
    use hprm_federated::Correction;

    use super::Clock;

    #[test]
    fn a_process_that_starts_now_has_the_same_time() {
        let ahead = Clock::of_new_processes().since(Clock::local());
        assert!(ahead.abs() < 60_000_000_000, "{ahead} ns, or the time of this machine was set");
    }

    #[test]
    fn never_goes_back_however_it_is_corrected() {
        let mut before = Clock::now();
        for round in 0..1_000 {
            let now = Clock::now();
            assert!(now >= before);
            before = now;
            let offset = if round % 2 == 0 { 1_000_000 } else { -1_000_000 };
            Clock::correct(Correction::Steer { offset, drift: 0, within: 1_000_000 });
        }
        let soon = Clock::now().plus(1_000_000_000);
        // It runs a twentieth too fast or too slow at most.
        assert!(Clock::until(soon) <= 1_060_000_000);
    }
}
