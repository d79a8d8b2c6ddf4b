//! A queue for things that end on any thread and are dealt with by the store's own.
//!
//! Values of Python and of Rust are dropped wherever their last user is; the ledger has one owner.
//! So a drop only leaves a note here.

#![forbid(unsafe_code)]
#![allow(clippy::disallowed_types, reason = "drops come from any thread; nothing waits under it")]

use std::fmt;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::at_fork::is_forked;

/// Called when the first note is left in an empty queue; on any thread, so it should only wake one.
pub type Wake = Box<dyn Fn() + Send + Sync>;

/// Notes, in the order in which they were left.
pub(crate) struct Returns<T> {
    notes: Mutex<Vec<T>>,
    /// Whether there may be notes: most of the time there is none, and nobody takes the lock for that.
    some: AtomicBool,
    wake: Option<Wake>,
}

impl<T> Returns<T> {
    /// An empty queue.
    pub(crate) fn new(wake: Option<Wake>) -> Self {
        Self { notes: Mutex::new(Vec::new()), some: AtomicBool::new(false), wake }
    }

    /// Leaves a note. In a forked process nobody reads it, and the queue may be locked for ever.
    pub(crate) fn push(&self, note: T) {
        if is_forked() {
            return;
        }
        let mut notes = self.lock();
        notes.push(note);
        let first = notes.len() == 1;
        self.some.store(true, Ordering::Release);
        drop(notes);
        if let Some(wake) = self.wake.as_ref().filter(|_| first) {
            wake();
        }
    }

    /// Takes all notes.
    pub(crate) fn drain(&self) -> Vec<T> {
        if !self.some.load(Ordering::Acquire) {
            return Vec::new();
        }
        // Before the notes: one that is left from here on is found now or the next time.
        self.some.store(false, Ordering::Release);
        std::mem::take(&mut *self.lock())
    }

    /// A push cannot leave the vector half changed, so a panic elsewhere does not matter.
    fn lock(&self) -> MutexGuard<'_, Vec<T>> {
        self.notes.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<T> fmt::Debug for Returns<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Returns").field("notes", &self.lock().len()).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    #[test]
    fn the_first_note_wakes_and_the_next_do_not() {
        let calls = Arc::new(AtomicUsize::new(0));
        let counter = Arc::clone(&calls);
        let wake: Wake = Box::new(move || {
            counter.fetch_add(1, Ordering::Relaxed);
        });
        let returns = Returns::new(Some(wake));
        returns.push(1);
        returns.push(2);
        assert_eq!((returns.drain(), calls.load(Ordering::Relaxed)), (vec![1, 2], 1));
        returns.push(3);
        assert_eq!((returns.drain(), calls.load(Ordering::Relaxed)), (vec![3], 2));
    }
}
