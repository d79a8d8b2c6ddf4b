//! Received objects that their reader may write to, without anybody else seeing it.
//!
//! For libraries that know no read-only memory. Nothing is copied at first: of each segment there is one
//! more mapping, of which the kernel copies a page when it is written. It stays, so that an object costs
//! no page faults unless it is written; pages that were are given up when the object ends.
//!
//! A page has one object at a time. Whoever has it holds the object, because the pages that were not
//! written are still the owner's. Copying page by page costs many times what copying at once does, so
//! after objects that were written to some are refused, and the caller copies them.

#![forbid(unsafe_code)]
#![allow(clippy::disallowed_types, reason = "objects end on any thread; nothing waits under it")]

use std::collections::BTreeMap;
use std::fmt;
use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::Object;
use crate::at_fork::is_forked;
use crate::shm::{SegmentView, Twin};

/// An object counts as written to if one page in so many was.
const FEW: usize = 32;

/// The most objects that are refused before one is tried again.
const PATIENCE: u32 = 63;

/// A segment to write to, and whose its pages are.
#[derive(Debug)]
pub(crate) struct Owned {
    twin: Twin,
    books: Mutex<Books>,
}

#[derive(Debug, Default)]
struct Books {
    /// Pages of objects that live, or that cannot be used any more: from the first to their end.
    taken: BTreeMap<usize, usize>,
    /// How many objects to refuse, and how many it will be after the next one that is written to.
    refuse: u32,
    next: u32,
}

impl Owned {
    pub(crate) fn new(twin: Twin) -> Self {
        Self { twin, books: Mutex::default() }
    }

    /// Takes pages, unless one of them is taken or not the segment's, or objects are being refused.
    fn take(&self, pages: &Range<usize>) -> bool {
        let mut books = self.books();
        if books.refuse > 0 {
            books.refuse -= 1;
            return false;
        }
        let before = books.taken.range(..pages.end).next_back();
        if before.is_some_and(|(_, end)| *end > pages.start) {
            return false;
        }
        // Whoever locks the memory of a process has all its pages copied, also those that nobody has
        // written: these are stale, and stay taken.
        books.taken.insert(pages.start, pages.end);
        drop(books);
        self.twin.written(pages) == 0
    }

    /// Ends that. Nobody has a pointer to the pages any more.
    fn give_back(&self, pages: &Range<usize>) {
        if is_forked() {
            // Nothing is taken here any more, and the books may be locked for ever.
            self.twin.discard(pages);
            return;
        }
        let written = self.twin.written(pages);
        let clean = written == 0 || self.twin.discard(pages);
        let mut books = self.books();
        if written > pages.len() / rustix::param::page_size() / FEW {
            books.next = (2 * books.next + 1).min(PATIENCE);
            books.refuse = books.next;
        } else {
            books.next = 0;
        }
        if clean {
            books.taken.remove(&pages.start);
        }
    }

    fn books(&self) -> MutexGuard<'_, Books> {
        self.books.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// See the module.
pub struct OwnObject {
    // Dropped in this order: the object is released only when its pages are given back.
    pages: Pages,
    offset: usize,
    object: Object,
}

/// Pages of a segment that are nobody else's here.
struct Pages {
    view: Arc<SegmentView>,
    range: Range<usize>,
}

impl OwnObject {
    /// The bytes of an object of another federate, to write to. None if that is not to be; then copy.
    pub(crate) fn of(object: &Object) -> Option<Self> {
        let (view, range) = object.foreign()?;
        let pages = Twin::pages_of(range);
        if !view.owned()?.take(&pages) {
            return None;
        }
        let pages = Pages { view: Arc::clone(view), range: pages };
        Some(Self { pages, offset: range.start, object: object.clone() })
    }

    /// The address of the first byte. All bytes may be read and written as long as this value lives;
    /// they are as many as the object has, and what is written stays in this process.
    #[must_use]
    pub fn start(&self) -> *mut u8 {
        self.pages.owned().twin.at(self.offset)
    }

    /// The number of bytes.
    #[must_use]
    #[allow(clippy::len_without_is_empty, reason = "what is empty is not mapped")]
    pub fn len(&self) -> usize {
        self.object.as_bytes().len()
    }

    /// Makes all bytes independent of the owner's. Returns whether there is memory for that.
    pub(crate) fn copy_now(&self) -> bool {
        self.pages.owned().twin.take(&self.pages.range)
    }
}

impl Pages {
    fn owned(&self) -> &Owned {
        self.view.owned().expect("the pages are from there")
    }
}

impl Drop for Pages {
    fn drop(&mut self) {
        self.owned().give_back(&self.range);
    }
}

impl fmt::Debug for OwnObject {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("OwnObject").field(&self.object.object_ref()).finish()
    }
}

#[cfg(test)]
mod tests {
    use std::os::fd::AsFd;

    use hprm_core::FederateId;

    use super::*;
    use crate::{Store, StoreLimits};

    const OWNER: FederateId = FederateId(0);
    const READER: FederateId = FederateId(1);
    const LEN: usize = 1 << 20;

    struct Pair(Store, Store);

    impl Pair {
        fn new() -> Self {
            Self(
                Store::new(OWNER, StoreLimits::default()),
                Store::new(READER, StoreLimits::default()),
            )
        }

        /// Sends bytes, as the reader gets them.
        fn pass(&mut self, bytes: &[u8]) -> Object {
            let Self(owner, reader) = self;
            for object in reader.drain_releases() {
                owner.release(object.serial, READER).unwrap();
            }
            let object = owner.put(bytes, &[READER]).unwrap();
            for segment in owner.unannounced(READER) {
                let fd = segment.as_fd().try_clone_to_owned().unwrap();
                reader.attach(OWNER, segment.segment, segment.len, fd).unwrap();
            }
            reader.open(object).unwrap()
        }
    }

    #[test]
    fn it_is_a_reader_as_any_other() {
        let mut pair = Pair::new();
        let came = pair.pass(&vec![1; LEN]);
        let own = OwnObject::of(&came).unwrap();
        assert_eq!(own.len(), LEN);
        assert_ne!(own.start().cast_const(), came.as_bytes().as_ptr());
        // A page is one object's at a time.
        assert!(OwnObject::of(&came).is_none());
        drop(came);
        assert_eq!(pair.1.drain_releases(), []);
        drop(own);
        assert_eq!(pair.1.drain_releases().len(), 1);
    }

    #[test]
    fn what_was_not_written_costs_nothing_and_is_used_again() {
        let mut pair = Pair::new();
        let mut starts = Vec::new();
        for round in 0..20 {
            let own = OwnObject::of(&pair.pass(&vec![round; LEN])).unwrap();
            starts.push(own.start());
        }
        starts.sort_unstable();
        starts.dedup();
        assert!(starts.len() < 4, "{starts:?}");
    }

    #[test]
    fn objects_that_share_a_page_are_apart() {
        let mut pair = Pair::new();
        let (one, other) = (pair.pass(&[1; 5_000]), pair.pass(&[2; 5_000]));
        let own = OwnObject::of(&one).unwrap();
        let near = one.as_bytes().as_ptr() as usize / 4096..other.as_bytes().as_ptr() as usize;
        assert!(near.end / 4096 <= near.start + 1, "they lie side by side");
        assert!(OwnObject::of(&other).is_none());
        drop(own);
        assert!(OwnObject::of(&other).is_some());
    }

    #[test]
    fn pages_that_were_copied_unasked_are_not_used() {
        let mut pair = Pair::new();
        let came = pair.pass(&vec![1; LEN]);
        let (view, range) = came.foreign().unwrap();
        let pages = Twin::pages_of(range);
        assert!(view.owned().unwrap().twin.take(&(pages.start..pages.start + 1)));
        assert!(OwnObject::of(&came).is_none());
    }

    #[test]
    fn who_writes_gets_copies_for_a_while() {
        let mut pair = Pair::new();
        let given = |pair: &mut Pair| {
            let own = OwnObject::of(&pair.pass(&vec![1; LEN]));
            own.inspect(|own| assert!(own.copy_now())).is_some()
        };
        let got: Vec<_> = (0..12).map(|_| given(&mut pair)).collect();
        let at = |index| index == 0 || index == 2 || index == 6;
        assert_eq!(got, (0..12).map(at).collect::<Vec<_>>());
    }
}
