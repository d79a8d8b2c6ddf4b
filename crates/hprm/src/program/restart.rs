//! When a federate of a program in Rust is started again, in the words of systemd.

use std::time::Duration;

use hprm_core::RestartCondition;

use crate::nanoseconds;

/// When a launcher starts a federate again that has ended: see [`Federate::restart`](crate::Federate::restart).
///
/// ```
/// use std::time::Duration;
///
/// use hprm::prelude::*;
///
/// let restart = Restart::on_failure().pause(Duration::from_secs(1)).limit(3, Duration::from_secs(60));
/// let viewer = Federate::new("viewer").restart(restart);
/// ```
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Restart(hprm_core::Restart);

impl Restart {
    /// After an exit code that is not zero, a signal, or silence for longer than the hang timeout.
    #[must_use]
    pub const fn on_failure() -> Self {
        Self(hprm_core::Restart::new(RestartCondition::OnFailure))
    }

    /// After a signal, or silence for longer than the hang timeout.
    #[must_use]
    pub const fn on_abnormal() -> Self {
        Self(hprm_core::Restart::new(RestartCondition::OnAbnormal))
    }

    /// After any end but that of the federation.
    #[must_use]
    pub const fn always() -> Self {
        Self(hprm_core::Restart::new(RestartCondition::Always))
    }

    /// How long after the end. Without this, 100 ms.
    #[must_use]
    pub fn pause(mut self, pause: Duration) -> Self {
        self.0.pause = nanoseconds(pause);
        self
    }

    /// How often the federate may be started within `interval`, the first time included: at least once. Without this,
    /// five times within 10 s; without an end if `interval` is zero.
    #[must_use]
    pub fn limit(mut self, burst: u32, interval: Duration) -> Self {
        (self.0.burst, self.0.interval) = (burst.max(1), nanoseconds(interval));
        self
    }

    pub(super) const fn stated(self) -> hprm_core::Restart {
        self.0
    }
}
