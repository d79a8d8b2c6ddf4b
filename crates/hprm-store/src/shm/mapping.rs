//! Ranges of the address space that show a file, and how their pages become present.
//!
//! Which bytes of a mapping may be read or written is decided by the types that own it.

#![allow(unsafe_code)]

use std::ops::Range;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::ptr::{self, NonNull};

use rustix::fs::{self, FallocateFlags};
use rustix::io::Errno;
use rustix::mm::{self, Advice, MapFlags, ProtFlags};

/// No page is smaller, so steps of this many bytes touch every page.
pub(super) const SMALLEST_PAGE: usize = 4096;
/// Length from which huge pages are asked for, in bytes.
const HUGE_PAGE: usize = 2 << 20;

/// A range of the address space that shows a file; unmapped when dropped.
#[derive(Debug)]
pub(super) struct Mapping {
    base: NonNull<u8>,
    len: usize,
}

// SAFETY: a mapping belongs to the process, not to a thread, and `Mapping` itself only unmaps it;
// access to the bytes is through the types that own a mapping, which order it.
unsafe impl Send for Mapping {}
// SAFETY: as for `Send`; a shared `Mapping` only tells its address and length.
unsafe impl Sync for Mapping {}

impl Mapping {
    /// Maps `len` bytes of a file, shared with other mappings of the file.
    pub(super) fn new(
        file: &OwnedFd,
        len: usize,
        prot: ProtFlags,
        flags: MapFlags,
    ) -> Result<Self, Errno> {
        Self::with(file.as_fd(), len, prot, MapFlags::SHARED | flags)
    }

    /// Maps `len` bytes of a file; the flags say whether shared or private.
    pub(super) fn with(
        file: BorrowedFd<'_>,
        len: usize,
        prot: ProtFlags,
        flags: MapFlags,
    ) -> Result<Self, Errno> {
        // SAFETY: the kernel chooses the address, so no existing mapping is replaced.
        let base = unsafe { mm::mmap(ptr::null_mut(), len, prot, flags, file, 0) }?;
        let base = NonNull::new(base.cast()).expect("the kernel maps nothing at address zero");
        Ok(Self { base, len })
    }

    /// Maps `len` bytes of an empty file for writing, every page present.
    ///
    /// Huge pages have to be asked for before the pages are made present, so the call that maps the
    /// file cannot make them present. Kernels before 5.14 cannot populate a mapping that exists:
    /// there the call that maps the file does it.
    pub(super) fn present(file: &OwnedFd, len: usize) -> Result<Self, Errno> {
        let prot = ProtFlags::READ | ProtFlags::WRITE;
        let mapping = Self::new(file, len, prot, MapFlags::empty())?;
        if len >= HUGE_PAGE {
            // Optional: a kernel without huge pages for shared memory refuses it, and nothing is lost.
            let _ = mapping.advise(0..len, Advice::LinuxHugepage);
        }
        match mapping.populate(0..len) {
            Ok(()) => Ok(mapping),
            Err(Errno::INVAL) => {
                fs::fallocate(file, FallocateFlags::empty(), 0, len as u64)?;
                Self::new(file, len, prot, MapFlags::POPULATE)
            }
            Err(cause) => Err(cause),
        }
    }

    /// Makes the pages of these bytes present, for writing; `INVAL` of kernels before 5.14.
    pub(super) fn populate(&self, bytes: Range<usize>) -> Result<(), Errno> {
        self.advise(bytes, Advice::LinuxPopulateWrite)
    }

    fn advise(&self, bytes: Range<usize>, advice: Advice) -> Result<(), Errno> {
        assert!(bytes.end <= self.len, "what is advised lies in the mapping");
        // From the page in which the first byte is: pages of any size are multiples of this one, or the kernel refuses.
        let start = bytes.start - bytes.start % SMALLEST_PAGE;
        let len = bytes.end - start;
        // SAFETY: the range lies in this mapping, and the advice given in this file (huge pages,
        // populate) changes no byte of it.
        unsafe { mm::madvise(self.at(start).cast(), len, advice) }
    }

    /// The length in bytes.
    pub(super) fn len(&self) -> usize {
        self.len
    }

    /// The address of the byte `offset`. The pointer is valid for as many bytes as follow in the
    /// mapping.
    pub(super) fn at(&self, offset: usize) -> *mut u8 {
        assert!(offset <= self.len, "every range was checked before it came here");
        self.base.as_ptr().wrapping_add(offset)
    }

    /// The range of `len` bytes from `offset`; `None` if it does not lie in the mapping.
    pub(super) fn range(&self, offset: u64, len: u64) -> Option<Range<usize>> {
        let start = usize::try_from(offset).ok()?;
        let end = start.checked_add(usize::try_from(len).ok()?)?;
        (end <= self.len).then_some(start..end)
    }
}

impl Drop for Mapping {
    fn drop(&mut self) {
        // SAFETY: the range is exactly this mapping; slices borrow from a value that owns it, so
        // there are none left.
        let unmapped = unsafe { mm::munmap(self.base.as_ptr().cast(), self.len) };
        debug_assert!(unmapped.is_ok(), "unmapping a whole mapping does not fail");
    }
}
