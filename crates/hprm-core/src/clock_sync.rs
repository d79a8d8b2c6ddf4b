//! The options of a program for the clocks of its federates. Drivers read the clocks.

use serde::{Deserialize, Serialize};

use crate::Nanos;

/// When a federate compares its clock with that of the RTI.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Default, Serialize, Deserialize)]
pub enum ClockSyncMode {
    /// Never.
    Off,
    /// Before it starts.
    #[default]
    Init,
    /// Before it starts and from then on.
    On,
}

/// The target properties `clock-sync` and `clock-sync-options`.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub struct ClockSyncOptions {
    /// `clock-sync`.
    pub mode: ClockSyncMode,
    /// `local-federates-on`: also on the host of the RTI, whose clock is the same anyway.
    pub local_federates: bool,
    /// `test-offset`: the error that a federate's clock is given at first.
    pub test_offset: Nanos,
    /// `period`: between two comparisons while the program runs.
    pub period: Nanos,
    /// `trials`: how many comparisons make one correction.
    pub trials: u32,
    /// `attenuation`: over how many corrections an error is spread.
    pub attenuation: u32,
}

impl Default for ClockSyncOptions {
    fn default() -> Self {
        Self {
            mode: ClockSyncMode::default(),
            local_federates: false,
            test_offset: 0,
            period: 5_000_000,
            trials: 10,
            attenuation: 10,
        }
    }
}
