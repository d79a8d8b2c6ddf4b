//! A reader's hold on a sealed object.
//!
//! Bytes to read, shared by as many clones as one likes; when the last of them is dropped, the hold is
//! owed back to the owner. Sending that release is the business of who drains the store.

#![forbid(unsafe_code)]
#![allow(clippy::disallowed_types, reason = "one thread drains; nothing waits under it")]

use std::fmt;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

use hprm_core::ObjectRef;

use crate::forks::Forks;
use crate::returns::{Returns, Wake};
use crate::shm::{Reading, SegmentView};

/// A sealed object that this process reads in place.
#[derive(Clone)]
pub struct Object(Arc<Hold>);

struct Hold {
    // Dropped in this order: the release is owed only when the bytes are not borrowed any more.
    bytes: Bytes,
    owed: Owed,
}

/// Where the bytes are.
pub(crate) enum Bytes {
    /// In a segment of this store.
    Own(Reading),
    /// In a segment of another federate.
    Foreign(Arc<SegmentView>, Range<usize>),
}

/// The release that is due at the end.
struct Owed {
    object: ObjectRef,
    /// How many forks there had been when it was opened.
    forks: u64,
    releases: Arc<Releases>,
}

/// Where releases are owed.
#[derive(Debug)]
pub(crate) struct Releases {
    due: Returns<Release>,
    forks: Arc<Forks>,
    /// Of objects that forked processes may still read.
    withheld: Mutex<Vec<Release>>,
}

/// A hold that has ended in this process.
#[derive(Debug)]
struct Release {
    object: ObjectRef,
    /// How many forks there had been when it began.
    forks: u64,
}

impl Releases {
    pub(crate) fn new(forks: &Arc<Forks>, wake: Option<Wake>) -> Self {
        Self { due: Returns::new(wake), forks: Arc::clone(forks), withheld: Mutex::default() }
    }

    /// Owes the release of an object that nobody has opened.
    pub(crate) fn push(&self, object: ObjectRef) {
        self.due.push(Release { object, forks: self.forks.count() });
    }

    /// Takes all that are due.
    pub(crate) fn drain(&self) -> Vec<ObjectRef> {
        let mut withheld = self.withheld.lock().unwrap_or_else(PoisonError::into_inner);
        withheld.extend(self.due.drain());
        withheld
            .extract_if(.., |release| !self.forks.may_read_since(release.forks))
            .map(|release| release.object)
            .collect()
    }
}

impl Drop for Owed {
    fn drop(&mut self) {
        self.releases.due.push(Release { object: self.object, forks: self.forks });
    }
}

impl Object {
    pub(crate) fn new(object: ObjectRef, bytes: Bytes, releases: Arc<Releases>) -> Self {
        let forks = releases.forks.count();
        Self(Arc::new(Hold { bytes, owed: Owed { object, forks, releases } }))
    }

    /// The bytes. They do not change as long as this value or a clone of it lives.
    #[must_use]
    pub fn as_bytes(&self) -> &[u8] {
        match &self.0.bytes {
            Bytes::Own(reading) => reading.bytes(),
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

    /// The reference that was opened: what to send to pass the object on.
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
