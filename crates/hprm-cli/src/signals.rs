//! The signals by which a person or a system asks the command to stop.
//!
//! They become events like all others. What they lead to is the supervisor's business.

use std::io;
use std::thread;

use signal_hook::consts::{SIGHUP, SIGINT, SIGKILL, SIGPIPE, SIGTERM};
use signal_hook::iterator::Signals;

/// A signal, by its number.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Signal(pub(crate) i32);

impl Signal {
    /// The reader of the output has closed it. Rust turns the signal into an error; this turns it back.
    pub(crate) const BROKEN_PIPE: Self = Self(SIGPIPE);
    /// The signal that no process can refuse.
    pub(crate) const KILL: Self = Self(SIGKILL);
    /// What asks a process to end.
    pub(crate) const TERMINATE: Self = Self(SIGTERM);
    /// The terminal is gone.
    pub(crate) const HANG_UP: Self = Self(SIGHUP);
    /// Ctrl-C.
    pub(crate) const INTERRUPT: Self = Self(SIGINT);

    /// The exit code of a process that ended because of it, as shells have it.
    pub(crate) fn exit_code(self) -> i32 {
        128 + self.0
    }

    /// `9 (SIGKILL)`.
    pub(crate) fn description(self) -> String {
        match signal_hook::low_level::signal_name(self.0) {
            Some(name) => format!("{} ({name})", self.0),
            None => self.0.to_string(),
        }
    }
}

/// From now on, Ctrl-C, SIGTERM and the end of the terminal do not end this process but call
/// `report`, until it returns false.
///
/// # Errors
///
/// If the system refuses.
pub(crate) fn watch(report: impl Fn(Signal) -> bool + Send + 'static) -> io::Result<()> {
    let mut signals = Signals::new([SIGINT, SIGTERM])?;
    // Started with `nohup`, it is meant to stay.
    if !is_ignored(SIGHUP) {
        signals.add_signal(SIGHUP)?;
    }
    thread::Builder::new().name("signals".to_owned()).spawn(move || {
        for signal in signals.forever() {
            if !report(Signal(signal)) {
                return;
            }
        }
    })?;
    Ok(())
}

fn is_ignored(signal: i32) -> bool {
    ignores(&std::fs::read_to_string("/proc/self/status").unwrap_or_default(), signal)
}

/// Whether a process of that status, as the kernel writes it, ignores a signal.
fn ignores(status: &str, signal: i32) -> bool {
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    mask.is_some_and(|mask| mask >> (signal - 1) & 1 == 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_ignored_stands_in_the_status() {
        let status = "SigBlk:\t0000000000000000\nSigIgn:\t0000000000001001\n";
        assert!(ignores(status, SIGHUP) && ignores(status, SIGPIPE));
        assert!(!ignores(status, SIGTERM) && !ignores("", SIGHUP));
    }

    #[test]
    fn signals_have_names_and_exit_codes() {
        assert_eq!(Signal::KILL.description(), "9 (SIGKILL)");
        assert_eq!(Signal(63).description(), "63");
        assert_eq!(Signal::INTERRUPT.exit_code(), 130);
    }
}
