//! A copy-on-write mapping of another federate's segment.
//!
//! Which objects use which of its pages is not known here; see `cow_pages`.

#![allow(unsafe_code)]

use std::ops::Range;
use std::os::fd::{BorrowedFd, OwnedFd};

use rustix::fs;
use rustix::io::Errno;
use rustix::mm::{self, Advice, MapFlags, ProtFlags};

use super::mapping::{Mapping, SMALLEST_PAGE};

/// A private mapping of a segment: the kernel copies a page at the first write to it, and no other
/// process sees what is written.
///
/// Pages that were not copied still show the segment. So their bytes are stable only as long as the
/// owner does not write them.
#[derive(Debug)]
pub(crate) struct CowMapping {
    mapping: Mapping,
    /// The kernel's table of this process's pages; none if the kernel does not give it.
    page_map: Option<OwnedFd>,
}

/// In the kernel's entry for a page: it is in memory or swapped out.
const PRESENT: u64 = 0b11 << 62;
/// In the kernel's entry for a page: it is a page of the file, not a copy.
const OF_FILE: u64 = 1 << 61;

impl CowMapping {
    /// The bytes of the pages that a range touches.
    pub(crate) fn pages_of(range: &Range<usize>) -> Range<usize> {
        let page = rustix::param::page_size();
        range.start - range.start % page..range.end.next_multiple_of(page)
    }

    /// Maps `len` bytes of a segment.
    pub(super) fn new(file: BorrowedFd<'_>, len: usize) -> Result<Self, Errno> {
        let prot = ProtFlags::READ | ProtFlags::WRITE;
        let mapping = Mapping::with(file, len, prot, MapFlags::PRIVATE)?;
        let flags = fs::OFlags::RDONLY | fs::OFlags::CLOEXEC;
        let page_map = fs::open("/proc/self/pagemap", flags, fs::Mode::empty()).ok();
        let cow = Self { mapping, page_map };
        // Where memory is locked as soon as it is mapped, the kernel has copied all of it.
        match cow.count_copied(&Self::pages_of(&(0..len))) {
            0 => Ok(cow),
            _ => Err(Errno::NOTSUP),
        }
    }

    /// The address of a byte. All bytes that follow in the mapping may be read and written.
    pub(crate) fn at(&self, offset: usize) -> *mut u8 {
        self.mapping.at(offset)
    }

    /// How many of some pages are copies, because they were written. All of them if the kernel does not
    /// tell.
    pub(crate) fn count_copied(&self, pages: &Range<usize>) -> usize {
        let page = rustix::param::page_size();
        let count = pages.len() / page;
        let Some(file) = &self.page_map else { return count };
        let mut entries = vec![0; count * size_of::<u64>()];
        let first = (self.at(pages.start) as usize / page * size_of::<u64>()) as u64;
        if rustix::io::pread(file, &mut entries[..], first) != Ok(entries.len()) {
            return count;
        }
        let (entries, _) = entries.as_chunks();
        let entries = entries.iter().map(|entry| u64::from_ne_bytes(*entry));
        entries.filter(|entry| entry & PRESENT != 0 && entry & OF_FILE == 0).count()
    }

    /// Frees the copies of some pages: they show the segment again. The caller must have no pointer to
    /// them. Returns whether that is done.
    pub(crate) fn discard(&self, pages: &Range<usize>) -> bool {
        let len = pages.end.min(self.mapping.len()) - pages.start;
        // SAFETY: the range lies in the mapping, of which no slices are made, and by the contract no
        // pointer is used; the bytes are then those of the file, which are valid.
        unsafe { mm::madvise(self.at(pages.start).cast(), len, Advice::LinuxDontNeed) }.is_ok()
    }

    /// Has the kernel copy some pages now. Returns whether there is memory for that.
    pub(crate) fn copy_now(&self, pages: &Range<usize>) -> bool {
        let len = pages.end.min(self.mapping.len()) - pages.start;
        let (start, advice) = (self.at(pages.start).cast(), Advice::LinuxPopulateWrite);
        // SAFETY: the range lies in the mapping, and the advice changes no byte of it.
        match unsafe { mm::madvise(start, len, advice) } {
            Ok(()) => true,
            // A kernel that does not know the advice copies a page when it is written.
            Err(Errno::INVAL) => {
                for at in pages.clone().step_by(SMALLEST_PAGE) {
                    let byte = self.at(at);
                    // SAFETY: the byte lies in the mapping, which is readable.
                    let value = unsafe { byte.read_volatile() };
                    // SAFETY: as above, and the mapping is writable; the byte keeps its value.
                    unsafe { byte.write_volatile(value) };
                }
                true
            }
            Err(_) => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::{Segment, SegmentView};
    use super::*;

    #[test]
    fn what_is_written_to_a_copy_on_write_mapping_is_nowhere_else_until_it_is_discarded() {
        const LEN: u64 = 1 << 16;
        let segment = Arc::new(Segment::create(LEN).unwrap());
        segment.borrow_mut(0, LEN).unwrap().bytes_mut().fill(7);
        let view = SegmentView::map(segment.fd().try_clone_to_owned().unwrap(), LEN).unwrap();
        let cow = CowMapping::new(segment.fd(), 1 << 16).unwrap();
        let read = |at| {
            // SAFETY: the byte lies in the mapping, and the test has one thread.
            unsafe { cow.at(at).read_volatile() }
        };
        let pages = CowMapping::pages_of(&(4_100..20_001));
        assert_eq!((pages.start, read(4_100), cow.count_copied(&pages)), (4_096, 7, 0));
        // SAFETY: as above; there is no slice of it.
        unsafe { cow.at(4_100).write_volatile(8) };
        assert_eq!((read(4_100), cow.count_copied(&pages)), (8, 1));
        assert_eq!(view.bytes(&(4_100..4_101)), Some(&[7][..]));
        segment.borrow_mut(0, LEN).unwrap().bytes_mut().fill(9);
        assert_eq!((read(4_100), read(4_101), read(20_000)), (8, 7, 9));
        assert!(cow.discard(&pages));
        assert_eq!((read(4_100), read(4_101), cow.count_copied(&pages)), (9, 9, 0));
        // Pages that were copied do not change with the segment any more, and others do.
        assert!(cow.copy_now(&pages));
        assert_eq!(cow.count_copied(&pages), pages.len() / rustix::param::page_size());
        segment.borrow_mut(0, LEN).unwrap().bytes_mut().fill(10);
        assert_eq!((read(pages.end - 1), read(pages.end)), (9, 10));
    }
}
