//! A queue for values that are dropped on any thread and that the store's thread processes.
//!
//! Values of Python and of Rust are dropped on the thread of their last user, but only the thread of the
//! store changes the ledger. So a drop only adds an entry to this queue.

#![forbid(unsafe_code)]
#![allow(
    clippy::disallowed_types,
    reason = "drops come from any thread; no thread waits while it holds this lock"
)]

use std::fmt;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::at_fork::is_forked;

/// Called when an entry is added to an empty queue; on any thread, so it should only wake another one.
pub type Wake = Box<dyn Fn() + Send + Sync>;

/// Entries, in the order in which they were added.
pub(crate) struct DropQueue<T> {
    entries: Mutex<Vec<T>>,
    /// Whether there may be entries: most of the time there is none, and then no thread takes the lock.
    has_entries: AtomicBool,
    wake: Option<Wake>,
}

impl<T> DropQueue<T> {
    /// An empty queue.
    pub(crate) fn new(wake: Option<Wake>) -> Self {
        Self { entries: Mutex::new(Vec::new()), has_entries: AtomicBool::new(false), wake }
    }

    /// Adds an entry. Not in a forked process: there no thread reads the queue, and it may be locked for
    /// ever.
    pub(crate) fn push(&self, entry: T) {
        if is_forked() {
            return;
        }
        let mut entries = self.lock();
        entries.push(entry);
        let first = entries.len() == 1;
        self.has_entries.store(true, Ordering::Release);
        drop(entries);
        if let Some(wake) = self.wake.as_ref().filter(|_| first) {
            wake();
        }
    }

    /// Whether there may be entries. Asking takes no lock.
    pub(crate) fn may_have_entries(&self) -> bool {
        self.has_entries.load(Ordering::Acquire)
    }

    /// Takes all entries.
    pub(crate) fn drain(&self) -> Vec<T> {
        if !self.may_have_entries() {
            return Vec::new();
        }
        // Before the entries are taken: one that is added from here on is found now or the next time.
        self.has_entries.store(false, Ordering::Release);
        std::mem::take(&mut *self.lock())
    }

    /// A push cannot leave the vector half changed, so a panic elsewhere does not matter.
    fn lock(&self) -> MutexGuard<'_, Vec<T>> {
        self.entries.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<T> fmt::Debug for DropQueue<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("DropQueue").field("entries", &self.lock().len()).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    #[test]
    fn the_first_entry_wakes_and_the_next_do_not() {
        let calls = Arc::new(AtomicUsize::new(0));
        let counter = Arc::clone(&calls);
        let wake: Wake = Box::new(move || {
            counter.fetch_add(1, Ordering::Relaxed);
        });
        let queue = DropQueue::new(Some(wake));
        queue.push(1);
        queue.push(2);
        assert_eq!((queue.drain(), calls.load(Ordering::Relaxed)), (vec![1, 2], 1));
        queue.push(3);
        assert_eq!((queue.drain(), calls.load(Ordering::Relaxed)), (vec![3], 2));
    }
}
