//! Signals, by their numbers: what asks a federation to stop, and what ends a process.

use std::fmt;

use signal_hook::consts::{SIGHUP, SIGINT, SIGKILL, SIGPIPE, SIGTERM};
use signal_hook::low_level::signal_name;

/// A signal, by its number.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Signal(pub i32);

impl Signal {
    /// The reader of the output has closed it. Rust turns the signal into an error; this turns it back.
    pub const BROKEN_PIPE: Self = Self(SIGPIPE);
    /// The signal that no process can refuse.
    pub const KILL: Self = Self(SIGKILL);
    /// What asks a process to end.
    pub const TERMINATE: Self = Self(SIGTERM);
    /// The terminal is gone.
    pub const HANG_UP: Self = Self(SIGHUP);
    /// Ctrl-C.
    pub const INTERRUPT: Self = Self(SIGINT);

    /// The exit code of a process that ended because of it, as shells have it.
    #[must_use]
    pub const fn exit_code(self) -> i32 {
        128 + self.0
    }
}

/// `9 (SIGKILL)`.
impl fmt::Display for Signal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match signal_name(self.0) {
            Some(name) => write!(f, "{} ({name})", self.0),
            None => write!(f, "{}", self.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signals_have_names_and_exit_codes() {
        assert_eq!(Signal::KILL.to_string(), "9 (SIGKILL)");
        assert_eq!(Signal(63).to_string(), "63");
        assert_eq!(Signal::INTERRUPT.exit_code(), 130);
    }
}
