//! What an agent tells its user: lines for its standard error.
//!
//! A terminal that is stopped, or a program that does not read, takes no more at some point. The loop of an agent must not wait
//! for that, so a thread writes the lines. What it cannot write for long is dropped, as is what it has not written a second
//! after the agent has ended.

use std::io::{Write, stderr};
use std::sync::{Mutex, PoisonError};

use tracing_appender::non_blocking::{NonBlocking, NonBlockingBuilder, WorkerGuard};

/// How many texts may wait.
const TEXTS: usize = 1024;

/// Where texts go, and what waits for the last of them; none while the program writes them itself.
static LINES: Mutex<Option<(NonBlocking, WorkerGuard)>> = Mutex::new(None);

/// From now on, a thread writes what is told.
pub(crate) fn begin() {
    let builder = NonBlockingBuilder::default().buffered_lines_limit(TEXTS).lossy(true);
    *lines() = Some(builder.thread_name("lines").finish(stderr()));
}

/// Tells a text of one or more lines, without the end of the last one.
pub(crate) fn tell(text: &str) {
    let text = format!("{text}\n");
    // Without a reader, the agent runs as well.
    drop(match lines().as_mut() {
        Some((thread, _)) => thread.write_all(text.as_bytes()),
        None => stderr().write_all(text.as_bytes()),
    });
}

/// Waits for what has been told, for about a second at most.
pub(crate) fn end() {
    let ended = lines().take();
    drop(ended);
}

fn lines() -> std::sync::MutexGuard<'static, Option<(NonBlocking, WorkerGuard)>> {
    LINES.lock().unwrap_or_else(PoisonError::into_inner)
}
