//! The signals by which a person or a system asks this process to stop, while something watches them.
//!
//! They become events like all others. What they lead to is the supervisor's business. When nothing watches
//! them any more, they do what they did before, so the library has no lasting effect on the program that uses
//! it. There is no safe way to remove a handler: it stays, and does what the system would do without it. So a
//! program that registers handlers of its own through `signal-hook` (or Tokio) does that before its first
//! federation runs; those that it installs otherwise replace the handler at any time.

use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::flag;
use signal_hook::iterator::{Handle, Signals};

use crate::supervisor;

/// Whether signals that ended this process, before they were first watched, end it again.
static IS_UNWATCHED: AtomicBool = AtomicBool::new(false);

static WATCHES: Mutex<Watches> = Mutex::new(Watches { count: 0, signals: Vec::new() });

/// The watches of this process.
#[derive(Debug)]
struct Watches {
    /// How many there are.
    count: usize,
    /// The signals that have ever been watched.
    signals: Vec<i32>,
}

/// Reports signals until it is dropped.
#[derive(Debug)]
pub struct Watch {
    signals: Handle,
    thread: Option<JoinHandle<()>>,
}

/// Has Ctrl-C, SIGTERM and the end of the terminal not end this process but call `report`, until that returns
/// false or the result is dropped. Several watches at a time get the same signals. Handlers that the program
/// has installed before run as well.
///
/// # Errors
///
/// If the system refuses.
pub fn watch(report: impl Fn(supervisor::Signal) -> bool + Send + 'static) -> io::Result<Watch> {
    let (mut signals, mut watch) = Watch::begin()?;
    let run = move || {
        for signal in signals.forever() {
            if !report(supervisor::Signal(signal)) {
                return;
            }
        }
    };
    watch.thread = Some(thread::Builder::new().name("signals".to_owned()).spawn(run)?);
    Ok(watch)
}

/// Whether this process ignores a signal.
#[must_use]
pub fn is_ignored(signal: i32) -> bool {
    Handling::of_this_process().is_ignored(signal)
}

impl Watch {
    /// Installs the handlers.
    fn begin() -> io::Result<(Signals, Self)> {
        let mut watches = watches();
        let before = Handling::of_this_process();
        let mut asking = vec![SIGINT, SIGTERM];
        // Started with `nohup`, the process is meant to stay.
        if !before.is_ignored(SIGHUP) {
            asking.push(SIGHUP);
        }
        let signals = Signals::new(&asking)?;
        for signal in asking {
            if watches.signals.contains(&signal) {
                continue;
            }
            if !before.is_ignored(signal) && !before.is_caught(signal) {
                flag::register_conditional_default(signal, &IS_UNWATCHED)?;
            }
            watches.signals.push(signal);
        }
        watches.count += 1;
        IS_UNWATCHED.store(false, Ordering::SeqCst);
        let watch = Self { signals: signals.handle(), thread: None };
        Ok((signals, watch))
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        let mut watches = watches();
        watches.count -= 1;
        IS_UNWATCHED.store(watches.count == 0, Ordering::SeqCst);
        drop(watches);
        self.signals.close();
        if let Some(thread) = self.thread.take() {
            // A panic of `report` has been shown.
            let _ = thread.join();
        }
    }
}

fn watches() -> MutexGuard<'static, Watches> {
    WATCHES.lock().unwrap_or_else(PoisonError::into_inner)
}

/// How a process handles signals: a bit for each.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
struct Handling {
    ignored: u64,
    caught: u64,
}

impl Handling {
    fn of_this_process() -> Self {
        Self::of(&std::fs::read_to_string("/proc/self/status").unwrap_or_default())
    }

    /// How a process of that status, as the kernel writes it, handles signals.
    fn of(status: &str) -> Self {
        let mask = |label| {
            let mask = status.lines().find_map(|line| line.strip_prefix(label));
            mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or_default()
        };
        Self { ignored: mask("SigIgn:"), caught: mask("SigCgt:") }
    }

    fn is_ignored(self, signal: i32) -> bool {
        has(self.ignored, signal)
    }

    fn is_caught(self, signal: i32) -> bool {
        has(self.caught, signal)
    }
}

fn has(mask: u64, signal: i32) -> bool {
    mask >> (signal - 1) & 1 == 1
}

#[cfg(test)]
mod tests {
    use signal_hook::consts::SIGPIPE;

    use super::*;

    #[test]
    fn how_signals_are_handled_stands_in_the_status() {
        let status =
            "SigBlk:\t0000000000000000\nSigIgn:\t0000000000001001\nSigCgt:\t0000000000004002\n";
        let handling = Handling::of(status);
        assert!(handling.is_ignored(SIGHUP) && handling.is_ignored(SIGPIPE));
        assert!(!handling.is_ignored(SIGTERM) && handling.is_caught(SIGTERM));
        assert!(handling.is_caught(SIGINT) && !handling.is_caught(SIGHUP));
        assert!(!Handling::of("").is_ignored(SIGHUP));
    }
}
