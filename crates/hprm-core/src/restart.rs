//! When a transient federate that has ended is started again: what a program states, in the words of systemd.
//!
//! A scheduler has nothing to do with it. The launcher of the federate obeys it.

use serde::{Deserialize, Serialize};

use crate::Nanos;

/// When a federate that has ended is started again.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub struct Restart {
    /// After which ends.
    pub condition: RestartCondition,
    /// How long after its end (systemd's `RestartSec=`).
    pub pause: Nanos,
    /// How often it may be started within `interval`, the first time included: at least once (systemd's
    /// `StartLimitBurst=`).
    pub burst: u32,
    /// See `burst`; without an end, if it is zero (systemd's `StartLimitIntervalSec=`).
    pub interval: Nanos,
}

/// After which ends a federate is started again (systemd's `Restart=`).
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Default, Serialize, Deserialize)]
pub enum RestartCondition {
    /// An exit code that is not zero, a signal, silence.
    #[default]
    OnFailure,
    /// A signal, silence.
    OnAbnormal,
    /// Any end.
    Always,
}

impl RestartCondition {
    /// All of them, by the names that systemd gives them.
    pub const NAMES: [(&'static str, Self); 3] = [
        ("on-failure", Self::OnFailure),
        ("on-abnormal", Self::OnAbnormal),
        ("always", Self::Always),
    ];
}

impl Restart {
    /// With systemd's pause and limit: after 100 ms, and at most five times within 10 s.
    #[must_use]
    pub const fn new(condition: RestartCondition) -> Self {
        Self { condition, pause: 100_000_000, burst: 5, interval: 10_000_000_000 }
    }
}
