//! The signals by which a person or a system asks the command to stop.
//!
//! They become events like all others. What they lead to is the supervisor's business.

use std::io;
use std::thread;

use signal_hook::consts::{SIGINT, SIGKILL, SIGPIPE, SIGTERM};
use signal_hook::iterator::Signals;

/// A signal, by its number.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Signal(pub(crate) i32);

impl Signal {
    /// Nobody reads the output any more. Rust turns the signal into an error; this turns it back.
    pub(crate) const BROKEN_PIPE: Self = Self(SIGPIPE);
    /// What nobody can refuse.
    pub(crate) const KILL: Self = Self(SIGKILL);
    /// What asks a process to end.
    pub(crate) const TERMINATE: Self = Self(SIGTERM);
    /// Ctrl-C.
    #[cfg(test)]
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

/// From now on, Ctrl-C and SIGTERM do not end this process but call `report`, until it returns
/// false.
///
/// # Errors
///
/// If the system refuses.
pub(crate) fn watch(report: impl Fn(Signal) -> bool + Send + 'static) -> io::Result<()> {
    let mut signals = Signals::new([SIGINT, SIGTERM])?;
    thread::Builder::new().name("signals".to_owned()).spawn(move || {
        for signal in signals.forever() {
            if !report(Signal(signal)) {
                return;
            }
        }
    })?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::Signal;

    #[test]
    fn signals_have_names_and_exit_codes() {
        assert_eq!(Signal::KILL.description(), "9 (SIGKILL)");
        assert_eq!(Signal(63).description(), "63");
        assert_eq!(Signal::INTERRUPT.exit_code(), 130);
    }
}
