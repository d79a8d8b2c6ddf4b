//! What an agent tells its user: lines for its standard error.
//!
//! A terminal that is stopped, or a program that does not read, takes no more at some point. No loop of an agent must wait
//! for that, so a thread writes the lines. What it cannot write for long is dropped, as is what it has not written a second
//! after the agent has ended.

use std::io::{Write, stderr};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

use crate::Failure;

/// How many texts may wait.
const TEXTS: usize = 1024;

/// How long the end of the program waits for what has been told.
const LAST: Duration = Duration::from_secs(1);

/// What writes that which is told.
enum Writer {
    /// The thread that tells it.
    None,
    /// A thread, which takes texts, and ends the other channel when it ends.
    Thread { texts: SyncSender<String>, ended: Receiver<()> },
    /// Nothing does any more.
    Ended,
}

static WRITER: Mutex<Writer> = Mutex::new(Writer::None);

/// As long as it is there, a thread writes what is told. When it goes, that is waited for.
pub(crate) struct Telling(());

impl Telling {
    /// Starts the thread.
    pub(crate) fn begin() -> Result<Self, Failure> {
        let (texts, told) = sync_channel::<String>(TEXTS);
        let (ends, ended) = sync_channel(0);
        let write = move || {
            for text in told {
                // Without a reader, the agent runs as well.
                drop(stderr().write_all(text.as_bytes()));
            }
            drop::<SyncSender<()>>(ends);
        };
        let thread = thread::Builder::new().name("lines".to_owned());
        thread
            .spawn(write)
            .map_err(|error| Failure::new(format!("the agent has no thread left: {error}")))?;
        *writer() = Writer::Thread { texts, ended };
        Ok(Self(()))
    }
}

impl Drop for Telling {
    fn drop(&mut self) {
        end();
    }
}

/// Tells a text of one or more lines, without the end of the last one.
pub(crate) fn tell(text: &str) {
    let text = format!("{text}\n");
    match &*writer() {
        Writer::None => drop(stderr().write_all(text.as_bytes())),
        Writer::Thread { texts, .. } => drop(texts.try_send(text)),
        Writer::Ended => {}
    }
}

/// Waits for what has been told, for a second at most. What is told later is not written.
pub(crate) fn end() {
    let before = std::mem::replace(&mut *writer(), Writer::Ended);
    if let Writer::Thread { texts, ended } = before {
        drop(texts);
        // It is an error in either case.
        let _ = ended.recv_timeout(LAST);
    }
}

fn writer() -> MutexGuard<'static, Writer> {
    WRITER.lock().unwrap_or_else(PoisonError::into_inner)
}
