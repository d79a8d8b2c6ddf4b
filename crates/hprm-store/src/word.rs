//! A word that several processes load and store, as rings and boards use it.
//!
//! It is an atomic word of shared memory. In tests it is one of a memory in which words are as old as the language
//! permits, so that what is tested there is the code that runs.

use std::sync::atomic::{AtomicU64, Ordering, fence};

use crate::shm::{fetch, fetch_to_store};

/// See the module.
pub(crate) trait Word {
    fn load(&self, order: Ordering) -> u64;

    fn store(&self, value: u64, order: Ordering);

    /// Stores a value in the place of what is there, which it returns.
    fn swap(&self, value: u64, order: Ordering) -> u64;

    /// Has the processor fetch the word: it will soon be loaded.
    fn fetch(&self) {}

    /// The same where it will soon be stored: other processors give it up.
    fn fetch_to_store(&self) {}

    /// Orders what this process does before and after, as [`std::sync::atomic::fence`].
    fn fence(order: Ordering);
}

impl Word for AtomicU64 {
    #[inline]
    fn load(&self, order: Ordering) -> u64 {
        self.load(order)
    }

    #[inline]
    fn store(&self, value: u64, order: Ordering) {
        self.store(value, order);
    }

    #[inline]
    fn swap(&self, value: u64, order: Ordering) -> u64 {
        self.swap(value, order)
    }

    #[inline]
    fn fetch(&self) {
        fetch(self);
    }

    #[inline]
    fn fetch_to_store(&self) {
        fetch_to_store(self);
    }

    #[inline]
    fn fence(order: Ordering) {
        fence(order);
    }
}
