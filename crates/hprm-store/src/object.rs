//! A reader's hold on a sealed object.
//!
//! Bytes to read, shared by any number of clones. When the last clone is dropped, this process owes the
//! owner a release; the driver that drains the store sends it.

#![forbid(unsafe_code)]
#![allow(
    clippy::disallowed_types,
    reason = "one thread drains; no thread waits while it holds this lock"
)]

use std::fmt;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use hprm_core::ObjectRef;

use crate::drop_queue::{DropQueue, Wake};
use crate::forks::Forks;
use crate::shm::{ReadBorrow, SegmentView};

/// A sealed object that this process reads in place.
#[derive(Clone)]
pub struct Object(Arc<Hold>);

struct Hold {
    // Dropped in this order: the release is owed only when the bytes are not borrowed any more.
    bytes: Bytes,
    owed: OwedRelease,
}

/// Where the bytes are.
pub(crate) enum Bytes {
    /// In a segment of this store.
    Own(ReadBorrow),
    /// In a segment of another federate.
    Foreign(Arc<SegmentView>, Range<usize>),
}

/// The release that is due when the object is dropped.
struct OwedRelease {
    object: ObjectRef,
    /// How many forks there had been when the object was opened.
    forks: u64,
    queue: Arc<ReleaseQueue>,
}

/// Releases that this process owes.
#[derive(Debug)]
pub(crate) struct ReleaseQueue {
    due: DropQueue<EndedHold>,
    forks: Arc<Forks>,
    /// Holds on objects that forked processes may still read.
    withheld: Mutex<Vec<EndedHold>>,
    /// Whether there are any; only [`Self::drain`] changes it.
    withholds: AtomicBool,
}

/// A hold that has ended in this process.
#[derive(Debug)]
struct EndedHold {
    object: ObjectRef,
    /// How many forks there had been when the hold began.
    forks: u64,
}

impl ReleaseQueue {
    pub(crate) fn new(forks: &Arc<Forks>, wake: Option<Wake>) -> Self {
        let (due, forks) = (DropQueue::new(wake), Arc::clone(forks));
        Self { due, forks, withheld: Mutex::default(), withholds: AtomicBool::new(false) }
    }

    /// Adds the release of an object that was never opened.
    pub(crate) fn push(&self, object: ObjectRef) {
        self.due.push(EndedHold { object, forks: self.forks.count() });
    }

    /// Whether some may be due.
    pub(crate) fn may_be_due(&self) -> bool {
        self.due.may_have_entries() || self.withholds.load(Ordering::Relaxed)
    }

    /// Takes all that are due.
    pub(crate) fn drain(&self) -> Vec<ObjectRef> {
        if !self.may_be_due() {
            return Vec::new();
        }
        let mut withheld = self.withheld.lock().unwrap_or_else(PoisonError::into_inner);
        withheld.extend(self.due.drain());
        let due = withheld
            .extract_if(.., |hold| !self.forks.may_read_since(hold.forks))
            .map(|hold| hold.object)
            .collect();
        self.withholds.store(!withheld.is_empty(), Ordering::Relaxed);
        due
    }
}

impl Drop for OwedRelease {
    fn drop(&mut self) {
        self.queue.due.push(EndedHold { object: self.object, forks: self.forks });
    }
}

impl Object {
    pub(crate) fn new(object: ObjectRef, bytes: Bytes, queue: Arc<ReleaseQueue>) -> Self {
        let forks = queue.forks.count();
        Self(Arc::new(Hold { bytes, owed: OwedRelease { object, forks, queue } }))
    }

    /// The bytes. They do not change as long as this value or a clone of it lives.
    #[must_use]
    pub fn as_bytes(&self) -> &[u8] {
        match &self.0.bytes {
            Bytes::Own(borrow) => borrow.bytes(),
            Bytes::Foreign(view, range) => {
                view.bytes(range).expect("the range was checked when the object was opened")
            }
        }
    }

    /// Where the bytes are, if they are another federate's.
    pub(crate) fn foreign(&self) -> Option<(&Arc<SegmentView>, &Range<usize>)> {
        match &self.0.bytes {
            Bytes::Own(_) => None,
            Bytes::Foreign(view, range) => Some((view, range)),
        }
    }

    /// The reference that was opened: what a message carries to forward the object.
    #[must_use]
    pub fn object_ref(&self) -> ObjectRef {
        self.0.owed.object
    }
}

impl AsRef<[u8]> for Object {
    fn as_ref(&self) -> &[u8] {
        self.as_bytes()
    }
}

impl fmt::Debug for Object {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Object").field(&self.0.owed.object).finish()
    }
}
