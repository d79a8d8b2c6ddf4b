//! Which pages of a copy-on-write mapping are in use, and whether it is worth using more of them.
//!
//! Each page is used by one object at a time. To copy page by page costs many times what one large
//! copy does, so after an object that was written to, some objects are refused, and the caller copies
//! them.

#![forbid(unsafe_code)]
#![allow(
    clippy::disallowed_types,
    reason = "objects end on any thread; no thread waits while it holds this lock"
)]

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::{Mutex, MutexGuard, PoisonError};

use super::cow::CowMapping;
use crate::at_fork::is_forked;

/// An object counts as written to if more than one page in this many was copied.
const WRITTEN_SHARE: usize = 32;

/// The most objects that are refused before the next one is tried.
const MAX_REFUSALS: u32 = 63;

/// A copy-on-write mapping of a segment, and which of its pages are in use.
#[derive(Debug)]
pub(crate) struct CowPages {
    mapping: CowMapping,
    usage: Mutex<Usage>,
}

#[derive(Debug, Default)]
struct Usage {
    /// Pages of objects that live, or that cannot be used any more: from the first to their end.
    taken: BTreeMap<usize, usize>,
    /// How many objects to refuse.
    refuse: u32,
    /// How many objects were refused after the last one that was written to; zero after one that was
    /// not.
    last_refused: u32,
}

impl CowPages {
    pub(super) fn new(mapping: CowMapping) -> Self {
        Self { mapping, usage: Mutex::default() }
    }

    pub(crate) fn mapping(&self) -> &CowMapping {
        &self.mapping
    }

    /// Takes pages. Returns false if one of them is taken or copied already, or if objects are being
    /// refused.
    pub(crate) fn take(&self, pages: &Range<usize>) -> bool {
        let mut usage = self.usage();
        if usage.refuse > 0 {
            usage.refuse -= 1;
            return false;
        }
        let before = usage.taken.range(..pages.end).next_back();
        if before.is_some_and(|(_, end)| *end > pages.start) {
            return false;
        }
        // A program that locks the memory of its process has all pages copied, also those to which
        // nothing was written: these are stale, and stay taken.
        usage.taken.insert(pages.start, pages.end);
        drop(usage);
        self.mapping.count_copied(pages) == 0
    }

    /// Releases pages that were taken. The caller must have no pointer to them.
    pub(crate) fn release(&self, pages: &Range<usize>) {
        if is_forked() {
            // A forked process takes no pages, and its parent's lock may be held for ever.
            self.mapping.discard(pages);
            return;
        }
        let copied = self.mapping.count_copied(pages);
        let clean = copied == 0 || self.mapping.discard(pages);
        let mut usage = self.usage();
        if copied > pages.len() / rustix::param::page_size() / WRITTEN_SHARE {
            usage.last_refused = (2 * usage.last_refused + 1).min(MAX_REFUSALS);
            usage.refuse = usage.last_refused;
        } else {
            usage.last_refused = 0;
        }
        if clean {
            usage.taken.remove(&pages.start);
        }
    }

    fn usage(&self) -> MutexGuard<'_, Usage> {
        self.usage.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
