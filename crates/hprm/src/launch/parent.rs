//! A process that ends with the one that has started it.

use std::io;

use rustix::process::{Signal, getppid, set_parent_process_death_signal};

/// Has the kernel end this process when the thread that started it ends. Returns whether the process that
/// started it is still alive: `parent` is its process id.
///
/// # Errors
///
/// If the kernel refuses.
pub fn die_with_parent(parent: i32) -> io::Result<bool> {
    set_parent_process_death_signal(Some(Signal::KILL))?;
    // It may have ended before the kernel was asked.
    Ok(getppid().is_some_and(|pid| pid.as_raw_nonzero().get() == parent))
}
