//! Shared memory that this process owns, and borrows of its bytes.

#![allow(unsafe_code)]

use std::ops::Range;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::slice;
use std::sync::{Arc, MutexGuard, PoisonError};

use rustix::fs::{self, MemfdFlags, SealFlags};
use rustix::io::Errno;
use rustix::mm::{self, Advice, MapFlags, ProtFlags};

use super::mapping::{Mapping, SMALLEST_PAGE};
use crate::SegmentError;
use crate::at_fork::is_forked;
use crate::claims::Claims;

#[allow(
    clippy::disallowed_types,
    reason = "claims end on any thread; no thread waits while it holds this lock"
)]
type Shared<T> = std::sync::Mutex<T>;

/// Shared memory that this process owns: it alone writes, and passes [`Self::fd`] to its readers.
///
/// It has no name in the file system, so nothing is left of it when its last process ends, however.
#[derive(Debug)]
pub(crate) struct Segment {
    mapping: Mapping,
    file: OwnedFd,
    claims: Shared<Claims>,
}

impl Segment {
    /// Creates a segment of `len` bytes, all of them present: neither the first write to a page nor a
    /// later lack of memory can disturb the process that uses it.
    pub(crate) fn create(len: u64) -> Result<Self, SegmentError> {
        let error = |step| move |cause| SegmentError::Create { len, step, cause };
        let size = usize::try_from(len).map_err(|_| error("length")(Errno::OVERFLOW))?;
        let flags = MemfdFlags::CLOEXEC | MemfdFlags::ALLOW_SEALING;
        let file = fs::memfd_create("hprm-store", flags).map_err(error("memfd_create"))?;
        fs::ftruncate(&file, len).map_err(error("ftruncate"))?;
        let mapping = Mapping::present(&file, size).map_err(error("mmap"))?;
        // Only now: this seal spares the writable mapping that exists, and forbids all later ones.
        let seals = SealFlags::SHRINK | SealFlags::GROW | SealFlags::FUTURE_WRITE | SealFlags::SEAL;
        fs::fcntl_add_seals(&file, seals).map_err(error("seal"))?;
        Ok(Self { mapping, file, claims: Shared::default() })
    }

    /// The length in bytes.
    pub(crate) fn len(&self) -> u64 {
        self.mapping.len() as u64
    }

    /// What a reader needs to map the segment.
    pub(crate) fn fd(&self) -> BorrowedFd<'_> {
        self.file.as_fd()
    }

    /// The address of its first byte.
    pub(crate) fn address(&self) -> usize {
        self.mapping.at(0) as usize
    }

    /// Whether the address is one of its bytes.
    pub(crate) fn contains(&self, address: usize) -> bool {
        (self.address()..self.address() + self.mapping.len()).contains(&address)
    }

    /// In a process that was just forked, and has one thread: replaces the mapping by a copy-on-write
    /// mapping at the same address. Pages that this process has not written yet still show what the
    /// owner writes. Returns whether the system does that.
    pub(crate) fn make_private(&self) -> bool {
        let base = self.mapping.at(0).cast();
        let prot = ProtFlags::READ | ProtFlags::WRITE;
        let flags = MapFlags::PRIVATE | MapFlags::FIXED;
        // SAFETY: the range is exactly the mapping that is replaced, by one of the same bytes of the
        // same file and with the same rights, in one step: pointers into it stay valid, and read what
        // they read before.
        unsafe { mm::mmap(base, self.mapping.len(), prot, flags, &self.file, 0) }.is_ok()
    }

    /// After [`Self::make_private`]: frees this process's copies of the pages that lie wholly in a
    /// block. The caller must have no pointer into it.
    pub(crate) fn discard_copy(&self, address: usize, len: usize) {
        let page = rustix::param::page_size();
        let start = address.next_multiple_of(page);
        let end = address.saturating_add(len) / page * page;
        if start >= end || !self.contains(start) || !self.contains(end - 1) {
            return;
        }
        let from = self.mapping.at(start - self.address()).cast();
        // SAFETY: the range lies in the mapping, of which a forked process makes no slices, and by the
        // contract no pointer is used; the bytes are then those of the file, which are valid. If it
        // fails, the pages stay.
        let _ = unsafe { mm::madvise(from, end - start, Advice::LinuxDontNeed) };
    }

    /// After [`Self::make_private`]: copies the pages of a block now, as far as it lies in this
    /// segment.
    pub(crate) fn copy_now(&self, address: usize, len: usize) {
        let end = self.address() + self.mapping.len();
        let start = address - address % SMALLEST_PAGE;
        let block = start.max(self.address())..address.saturating_add(len).min(end);
        for at in block.step_by(SMALLEST_PAGE) {
            let byte = self.mapping.at(at - self.address());
            // SAFETY: the byte lies in the mapping, which is readable; the process has one thread.
            let value = unsafe { byte.read_volatile() };
            // SAFETY: as above, and the mapping is writable; the byte keeps its value.
            unsafe { byte.write_volatile(value) };
        }
    }

    /// Borrows `len` bytes from `offset` for one writer; `None` if any of them is borrowed already
    /// or lies outside.
    pub(crate) fn borrow_mut(self: &Arc<Self>, offset: u64, len: u64) -> Option<WriteBorrow> {
        let range = self.mapping.range(offset, len)?;
        let claimed = self.claims().claim_exclusive(&range);
        claimed.then(|| WriteBorrow { segment: Arc::clone(self), range })
    }

    /// Borrows `len` bytes from `offset` for one more reader; `None` if any of them is borrowed
    /// already, other than by readers of the same bytes, or lies outside.
    pub(crate) fn borrow(self: &Arc<Self>, offset: u64, len: u64) -> Option<ReadBorrow> {
        let range = self.mapping.range(offset, len)?;
        let claimed = self.claims().claim_shared(&range);
        claimed.then(|| ReadBorrow { segment: Arc::clone(self), range })
    }

    /// Ends the claim that starts there. A forked process makes no claims, so no claim of the parent
    /// has to end there.
    fn end_claim(&self, start: usize) {
        if !is_forked() {
            self.claims().end(start);
        }
    }

    /// Claims are changed in one step each, or panic without a change.
    fn claims(&self) -> MutexGuard<'_, Claims> {
        self.claims.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Bytes of a [`Segment`] that only this value can see and change, within this process.
#[derive(Debug)]
pub(crate) struct WriteBorrow {
    segment: Arc<Segment>,
    range: Range<usize>,
}

impl WriteBorrow {
    pub(crate) fn segment(&self) -> &Arc<Segment> {
        &self.segment
    }

    pub(crate) fn bytes(&self) -> &[u8] {
        let start = self.segment.mapping.at(self.range.start);
        // SAFETY: the range lies in the mapping, which `self` keeps; `self` has an exclusive claim
        // on it, so only `bytes_mut` could change it, and that borrows `self` mutably.
        unsafe { slice::from_raw_parts(start, self.range.len()) }
    }

    pub(crate) fn bytes_mut(&mut self) -> &mut [u8] {
        let start = self.segment.mapping.at(self.range.start);
        // SAFETY: the range lies in the mapping, which `self` keeps and which is writable; `self`
        // has an exclusive claim on it and is borrowed mutably, so there is no other slice of it.
        unsafe { slice::from_raw_parts_mut(start, self.range.len()) }
    }
}

impl Drop for WriteBorrow {
    fn drop(&mut self) {
        self.segment.end_claim(self.range.start);
    }
}

/// Bytes of a [`Segment`] that do not change while this value lives, within this process.
#[derive(Debug)]
pub(crate) struct ReadBorrow {
    segment: Arc<Segment>,
    range: Range<usize>,
}

impl ReadBorrow {
    pub(crate) fn bytes(&self) -> &[u8] {
        let start = self.segment.mapping.at(self.range.start);
        // SAFETY: the range lies in the mapping, which `self` keeps; `self` has a shared claim on it,
        // so there is no exclusive claim, without which there is no writable slice.
        unsafe { slice::from_raw_parts(start, self.range.len()) }
    }
}

impl Drop for ReadBorrow {
    fn drop(&mut self) {
        self.segment.end_claim(self.range.start);
    }
}

#[cfg(test)]
mod tests {
    use std::os::fd::AsRawFd;

    use super::super::SegmentView;
    use super::*;

    const LEN: u64 = 1 << 16;

    fn segment() -> Arc<Segment> {
        Arc::new(Segment::create(LEN).unwrap())
    }

    #[test]
    fn the_kernel_refuses_a_second_writer() {
        let segment = segment();
        let path = format!("/proc/self/fd/{}", segment.fd().as_raw_fd());
        let file = std::fs::OpenOptions::new().read(true).write(true).open(path).unwrap();
        let file = OwnedFd::from(file);
        let prot = ProtFlags::READ | ProtFlags::WRITE;
        let mapped = Mapping::new(&file, 4096, prot, MapFlags::empty());
        assert_eq!(mapped.map(|_| ()), Err(Errno::PERM));
        assert_eq!(rustix::io::write(&file, b"x"), Err(Errno::PERM));
        assert_eq!(fs::ftruncate(&file, 0), Err(Errno::PERM));
        assert_eq!(fs::ftruncate(&file, LEN * 2), Err(Errno::PERM));
        assert!(Mapping::new(&file, 4096, ProtFlags::READ, MapFlags::empty()).is_ok());
        assert!(SegmentView::map(file, LEN).is_ok());
    }

    #[test]
    fn memory_that_the_system_does_not_have_is_an_error() {
        let error = Segment::create(1 << 62).unwrap_err();
        assert!(matches!(error, SegmentError::Create { .. }), "{error}");
        assert!(error.to_string().contains("lower the limit"), "{error}");
    }

    #[test]
    fn writers_are_apart_and_readers_are_not() {
        let segment = segment();
        let first = segment.borrow_mut(0, 64).unwrap();
        assert!(segment.borrow_mut(32, 64).is_none());
        assert!(segment.borrow(0, 64).is_none());
        assert!(segment.borrow_mut(LEN, 1).is_none());
        let second = segment.borrow_mut(64, 64).unwrap();
        drop((first, second));
        let readers = [(); 2].map(|()| segment.borrow(0, 64).unwrap());
        assert!(segment.borrow_mut(0, 64).is_none());
        drop(readers);
        assert!(segment.borrow_mut(0, 64).is_some());
    }

    #[test]
    fn every_page_of_a_new_segment_is_present() {
        let segment = Segment::create(4 << 20).unwrap();
        let blocks = fs::fstat(segment.fd()).unwrap().st_blocks;
        assert_eq!(u64::try_from(blocks).unwrap() * 512, segment.len());
    }
}
