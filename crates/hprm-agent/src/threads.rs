//! How many threads read and write Zenoh's connections: one, in which the loop of the agent is a task as well.
//!
//! Zenoh 1.10 reads a TLS connection on one thread and writes it on another one, without a lock between them. When both
//! do so at the same time, the connection breaks ("handshake not complete"), many times a second where much is sent both ways; and
//! nobody knows what else such a race does. If one thread does both, there is none. Zenoh takes that from its environment
//! only, so this program starts itself once more.
//!
//! It is quick, too: what is for a process of this machine, or comes from one, wakes up no other thread on its way (`waiting.rs`).

use std::env;
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::Command;

use tokio::runtime::Handle;
use zenoh_runtime::ZRuntime;

use crate::Failure;

/// The variable that Zenoh reads, and what is in it here.
const VARIABLE: &str = "ZENOH_RUNTIME";
const ONE: &str =
    "(rx: (handover: tx), acc: (handover: tx), net: (handover: tx), tx: (worker_threads: 1))";

/// How many heaps the C library has at most. While the loop blocks, another thread goes on, and then another one: each would have
/// a heap of its own, and what is free in one of no use to the others.
const HEAPS: (&str, &str) = ("MALLOC_ARENA_MAX", "2");

/// Comes back in a process in which one thread reads and writes.
///
/// # Errors
///
/// If there is no such process.
pub(crate) fn share() -> Result<(), Failure> {
    if env::var_os(VARIABLE).is_some_and(|set| set == ONE) {
        return Ok(());
    }
    // A file that was replaced meanwhile is still there under that name.
    let this = env::current_exe().ok().filter(|path| path.is_file());
    let mut again = Command::new(this.unwrap_or_else(|| PathBuf::from("/proc/self/exe")));
    let mut words = env::args_os();
    if let Some(name) = words.next() {
        again.arg0(name);
    }
    again.args(words).env(VARIABLE, ONE);
    if env::var_os(HEAPS.0).is_none() {
        again.env(HEAPS.0, HEAPS.1);
    }
    let error = again.exec();
    Err(Failure::new(format!("the agent cannot start itself again: {error}")))
}

/// What runs tasks on that thread.
pub(crate) fn runtime() -> &'static Handle {
    const SHARED: &ZRuntime = &ZRuntime::TX;
    SHARED
}

/// Keeps from a process that this one starts what was only for this one.
pub(crate) fn forget(command: &mut Command) {
    for (name, value) in [(VARIABLE, ONE), HEAPS] {
        if env::var_os(name).is_some_and(|set| set == value) {
            command.env_remove(name);
        }
    }
}
