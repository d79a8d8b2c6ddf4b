//! Received objects that their reader may write to, without any other process seeing it.
//!
//! For libraries that know no read-only memory. Nothing is copied at first: each segment has one
//! copy-on-write mapping in this process. It stays mapped, so an object costs no page faults unless it is
//! written; pages that were copied are freed when the object ends.
//!
//! A page is used by one object at a time, and the reader holds that object until its pages are
//! released: pages that were not written are still the owner's. Which pages may be used is decided in
//! `shm/cow_pages.rs`.

#![forbid(unsafe_code)]

use std::fmt;
use std::ops::Range;
use std::sync::Arc;

use crate::Object;
use crate::shm::{CowMapping, CowPages, SegmentView};

/// A received object in a copy-on-write mapping.
pub struct CowObject {
    // Dropped in this order: the object is released only when its pages are released.
    pages: Pages,
    offset: usize,
    object: Object,
}

/// Pages of a segment that no other object of this process uses.
struct Pages {
    view: Arc<SegmentView>,
    range: Range<usize>,
}

impl CowObject {
    /// The bytes of an object of another federate, to write to. None if the system has no such mapping,
    /// or if the pages are refused; then copy.
    pub(crate) fn of(object: &Object) -> Option<Self> {
        let (view, range) = object.foreign()?;
        let pages = CowMapping::pages_of(range);
        if !view.cow()?.take(&pages) {
            return None;
        }
        let pages = Pages { view: Arc::clone(view), range: pages };
        Some(Self { pages, offset: range.start, object: object.clone() })
    }

    /// The address of the first byte. As many bytes as the object has may be read and written as long
    /// as this value lives, and what is written stays in this process.
    #[must_use]
    pub fn start(&self) -> *mut u8 {
        self.pages.cow().mapping().at(self.offset)
    }

    /// The number of bytes.
    #[must_use]
    #[allow(clippy::len_without_is_empty, reason = "what is empty is not mapped")]
    pub fn len(&self) -> usize {
        self.object.as_bytes().len()
    }

    /// Copies all bytes now, so that they do not depend on the owner's. Returns whether there is memory
    /// for that.
    pub(crate) fn copy_now(&self) -> bool {
        self.pages.cow().mapping().copy_now(&self.pages.range)
    }
}

impl Pages {
    fn cow(&self) -> &CowPages {
        self.view.cow().expect("the pages were taken from it")
    }
}

impl Drop for Pages {
    fn drop(&mut self) {
        self.cow().release(&self.range);
    }
}

impl fmt::Debug for CowObject {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("CowObject").field(&self.object.object_ref()).finish()
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
    fn it_holds_the_object_as_any_other_reader_does() {
        let mut pair = Pair::new();
        let came = pair.pass(&vec![1; LEN]);
        let own = CowObject::of(&came).unwrap();
        assert_eq!(own.len(), LEN);
        assert_ne!(own.start().cast_const(), came.as_bytes().as_ptr());
        // A page is used by one object at a time.
        assert!(CowObject::of(&came).is_none());
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
            let own = CowObject::of(&pair.pass(&vec![round; LEN])).unwrap();
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
        let own = CowObject::of(&one).unwrap();
        let near = one.as_bytes().as_ptr() as usize / 4096..other.as_bytes().as_ptr() as usize;
        assert!(near.end / 4096 <= near.start + 1, "they lie side by side");
        assert!(CowObject::of(&other).is_none());
        drop(own);
        assert!(CowObject::of(&other).is_some());
    }

    #[test]
    fn pages_that_the_kernel_copied_before_are_not_used() {
        let mut pair = Pair::new();
        let came = pair.pass(&vec![1; LEN]);
        let (view, range) = came.foreign().unwrap();
        let pages = CowMapping::pages_of(range);
        assert!(view.cow().unwrap().mapping().copy_now(&(pages.start..pages.start + 1)));
        assert!(CowObject::of(&came).is_none());
    }

    #[test]
    fn after_a_write_some_objects_are_refused() {
        let mut pair = Pair::new();
        let mapped = |pair: &mut Pair| {
            let own = CowObject::of(&pair.pass(&vec![1; LEN]));
            own.inspect(|own| assert!(own.copy_now())).is_some()
        };
        let got: Vec<_> = (0..12).map(|_| mapped(&mut pair)).collect();
        let at = |index| index == 0 || index == 2 || index == 6;
        assert_eq!(got, (0..12).map(at).collect::<Vec<_>>());
    }
}
