//! The mapping of shared memory: the one place of this crate with unsafe code, with `words` below it.
//!
//! What it buys: 50 MB that several processes read where they were written, without a copy. What it
//! owns: memfds, mappings, and slices into them. What it does not: who may read or write which bytes
//! and when, which is the ledger's business; but within a process it trusts nobody and checks every
//! borrow against [`Claims`].
//!
//! The argument for soundness, on which the blocks below rely:
//!
//! - A [`Mapping`] is a live mapping of `len` bytes from `base` until it is dropped, and every slice
//!   borrows from a value that owns the mapping. The memory behind it exists as long: the owner has
//!   faulted in each page before the segment is used, and a view is made only of a file that is
//!   sealed against shrinking.
//! - Within the owner's process, a slice is only made under a claim, and claims do not overlap unless
//!   all of them are for reading.
//! - Other processes cannot write: the file is sealed against writable mappings other than the one
//!   that the owner made before. That the owner itself does not write what a reader holds is the
//!   protocol of the store (an object is freed only by its releases), and the one thing a reader has
//!   to trust its peer for; the bytes are plain `u8`, valid whatever they are.
//! - Memory that two processes write is never seen as bytes: [`SharedWords`] are atomic words.

#![allow(unsafe_code)]

mod words;

use std::ops::Range;
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd};
use std::ptr::{self, NonNull};
use std::slice;
use std::sync::{Arc, MutexGuard, OnceLock, PoisonError};

use rustix::fs::{self, FallocateFlags, MemfdFlags, SealFlags};
use rustix::io::Errno;
use rustix::mm::{self, Advice, MapFlags, ProtFlags};

use crate::SegmentError;
use crate::at_fork::is_forked;
use crate::claims::Claims;
use crate::own::Owned;
pub(crate) use words::SharedWords;

/// No page is smaller, so every page is touched by steps of this many bytes.
const OWN_STEP: usize = 4096;
/// Length from which huge pages are asked for, in bytes.
const HUGE_PAGE: usize = 2 << 20;

#[allow(clippy::disallowed_types, reason = "claims end on any thread; nothing waits under it")]
type Shared<T> = std::sync::Mutex<T>;

/// A range of the address space that shows a file; unmapped when dropped.
#[derive(Debug)]
struct Mapping {
    base: NonNull<u8>,
    len: usize,
}

// SAFETY: a mapping belongs to the process, not to a thread, and `Mapping` itself only unmaps it;
// access to the bytes is through `Segment` and `SegmentView`, which order it.
unsafe impl Send for Mapping {}
// SAFETY: as for `Send`; a shared `Mapping` only tells its address and length.
unsafe impl Sync for Mapping {}

impl Mapping {
    fn new(file: &OwnedFd, len: usize, prot: ProtFlags, flags: MapFlags) -> Result<Self, Errno> {
        Self::with(file.as_fd(), len, prot, MapFlags::SHARED | flags)
    }

    fn with(
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

    fn advise(&self, advice: Advice) -> Result<(), Errno> {
        // SAFETY: the range is exactly this mapping, and the advice given in this file (huge pages,
        // populate) changes no byte of it.
        unsafe { mm::madvise(self.base.as_ptr().cast(), self.len, advice) }
    }

    /// Where the byte `offset` is. The pointer is good for as many bytes as follow in the mapping.
    fn at(&self, offset: usize) -> *mut u8 {
        assert!(offset <= self.len, "every range was checked before it came here");
        self.base.as_ptr().wrapping_add(offset)
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
    /// Creates a segment of `len` bytes, all of them present: neither the first write to a page nor
    /// the lack of memory later can disturb who uses it.
    pub(crate) fn create(len: u64) -> Result<Self, SegmentError> {
        let error = |step| move |cause| SegmentError::Create { len, step, cause };
        let size = usize::try_from(len).map_err(|_| error("length")(Errno::OVERFLOW))?;
        let flags = MemfdFlags::CLOEXEC | MemfdFlags::ALLOW_SEALING;
        let file = fs::memfd_create("hprm-store", flags).map_err(error("memfd_create"))?;
        fs::ftruncate(&file, len).map_err(error("ftruncate"))?;
        let mapping = map_present(&file, size).map_err(error("mmap"))?;
        // Only now: this seal spares the writable mapping that exists, and forbids all later ones.
        let seals = SealFlags::SHRINK | SealFlags::GROW | SealFlags::FUTURE_WRITE | SealFlags::SEAL;
        fs::fcntl_add_seals(&file, seals).map_err(error("seal"))?;
        Ok(Self { mapping, file, claims: Shared::default() })
    }

    /// The length in bytes.
    pub(crate) fn len(&self) -> u64 {
        self.mapping.len as u64
    }

    /// What a reader needs to map the segment.
    pub(crate) fn fd(&self) -> BorrowedFd<'_> {
        self.file.as_fd()
    }

    /// The address of its first byte.
    pub(crate) fn address(&self) -> usize {
        self.mapping.base.as_ptr() as usize
    }

    /// Whether the address is one of its bytes.
    pub(crate) fn contains(&self, address: usize) -> bool {
        (self.address()..self.address() + self.mapping.len).contains(&address)
    }

    /// In a process that was just forked, and has one thread: replaces the mapping by one at the same
    /// place of which this process has its own copy of each page, once it writes to it. What the
    /// owner writes to other pages is seen until then. Returns whether the system does that.
    pub(crate) fn make_private(&self) -> bool {
        let base = self.mapping.base.as_ptr().cast();
        let prot = ProtFlags::READ | ProtFlags::WRITE;
        let flags = MapFlags::PRIVATE | MapFlags::FIXED;
        // SAFETY: the range is exactly the mapping that is replaced, by one of the same bytes of the
        // same file and with the same rights, in one step: pointers into it stay good, and read what
        // they read before.
        unsafe { mm::mmap(base, self.mapping.len, prot, flags, &self.file, 0) }.is_ok()
    }

    /// After [`Self::make_private`]: gives back this process's copies of the pages that lie wholly in a
    /// block. Nobody may have a pointer into it.
    pub(crate) fn disown(&self, address: usize, len: usize) {
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

    /// After [`Self::make_private`]: has this process take its own copies of the pages of a block, as
    /// far as it lies in this segment.
    pub(crate) fn own(&self, address: usize, len: usize) {
        let end = self.address() + self.mapping.len;
        let start = address - address % OWN_STEP;
        let block = start.max(self.address())..address.saturating_add(len).min(end);
        for at in block.step_by(OWN_STEP) {
            let byte = self.mapping.at(at - self.address());
            // SAFETY: the byte lies in the mapping, which is readable; the process has one thread.
            let value = unsafe { byte.read_volatile() };
            // SAFETY: as above, and the mapping is writable; the byte keeps its value.
            unsafe { byte.write_volatile(value) };
        }
    }

    /// Borrows `len` bytes from `offset` for one writer; `None` if any of them is borrowed already
    /// or lies outside.
    pub(crate) fn writing(self: &Arc<Self>, offset: u64, len: u64) -> Option<Writing> {
        let range = range_within(offset, len, self.mapping.len)?;
        let claimed = self.claims().claim_exclusive(&range);
        claimed.then(|| Writing { segment: Arc::clone(self), range })
    }

    /// Borrows `len` bytes from `offset` for one more reader; `None` if any of them is borrowed
    /// already, other than by readers of the same bytes, or lies outside.
    pub(crate) fn reading(self: &Arc<Self>, offset: u64, len: u64) -> Option<Reading> {
        let range = range_within(offset, len, self.mapping.len)?;
        let claimed = self.claims().claim_shared(&range);
        claimed.then(|| Reading { segment: Arc::clone(self), range })
    }

    /// Ends the claim that starts there. A forked process makes no claims, so none is in its way.
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

/// Maps `len` bytes of an empty file for writing, every page present.
///
/// Huge pages have to be asked for before the pages come, so the pages cannot come with the file.
/// Kernels before 5.14 cannot populate a mapping that exists: there the pages come with the file.
fn map_present(file: &OwnedFd, len: usize) -> Result<Mapping, Errno> {
    let prot = ProtFlags::READ | ProtFlags::WRITE;
    let mapping = Mapping::new(file, len, prot, MapFlags::empty())?;
    if len >= HUGE_PAGE {
        // A wish: a kernel without huge pages for shared memory refuses it, and nothing is lost.
        let _ = mapping.advise(Advice::LinuxHugepage);
    }
    match mapping.advise(Advice::LinuxPopulateWrite) {
        Ok(()) => Ok(mapping),
        Err(Errno::INVAL) => {
            fs::fallocate(file, FallocateFlags::empty(), 0, len as u64)?;
            Mapping::new(file, len, prot, MapFlags::POPULATE)
        }
        Err(cause) => Err(cause),
    }
}

fn range_within(offset: u64, len: u64, bound: usize) -> Option<Range<usize>> {
    let start = usize::try_from(offset).ok()?;
    let end = start.checked_add(usize::try_from(len).ok()?)?;
    (end <= bound).then_some(start..end)
}

/// Bytes of a [`Segment`] that only this value can see and change, within this process.
#[derive(Debug)]
pub(crate) struct Writing {
    segment: Arc<Segment>,
    range: Range<usize>,
}

impl Writing {
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

impl Drop for Writing {
    fn drop(&mut self) {
        self.segment.end_claim(self.range.start);
    }
}

/// Bytes of a [`Segment`] that do not change while this value lives, within this process.
#[derive(Debug)]
pub(crate) struct Reading {
    segment: Arc<Segment>,
    range: Range<usize>,
}

impl Reading {
    pub(crate) fn bytes(&self) -> &[u8] {
        let start = self.segment.mapping.at(self.range.start);
        // SAFETY: the range lies in the mapping, which `self` keeps; `self` has a shared claim on it,
        // so nobody has an exclusive one, without which there is no writable slice.
        unsafe { slice::from_raw_parts(start, self.range.len()) }
    }
}

impl Drop for Reading {
    fn drop(&mut self) {
        self.segment.end_claim(self.range.start);
    }
}

/// Shared memory of another federate, mapped for reading.
#[derive(Debug)]
pub(crate) struct SegmentView {
    /// Device and number of the file: the same for all ways to one segment.
    identity: (u64, u64),
    mapping: Mapping,
    file: Option<OwnedFd>,
    /// The same once more, to be written to; none if the system does not do that.
    twin: OnceLock<Option<Owned>>,
}

impl SegmentView {
    /// Maps what the owner announced, every page present, if it can do no harm.
    pub(crate) fn map(file: OwnedFd, len: u64) -> Result<Self, SegmentError> {
        let error = |step| move |cause| SegmentError::Map { len, step, cause };
        let size = usize::try_from(len).map_err(|_| error("length")(Errno::OVERFLOW))?;
        let needed = SealFlags::SHRINK | SealFlags::FUTURE_WRITE;
        match fs::fcntl_get_seals(&file) {
            Ok(seals) if seals.contains(needed) => {}
            // Not a memfd, or one that cannot be sealed.
            Ok(_) | Err(Errno::INVAL) => return Err(SegmentError::NotSealed),
            Err(cause) => return Err(error("get seals")(cause)),
        }
        let status = fs::fstat(&file).map_err(error("fstat"))?;
        let actual = u64::try_from(status.st_size).unwrap_or(0);
        if actual < len {
            return Err(SegmentError::TooShort { announced: len, actual });
        }
        let mapping = Mapping::new(&file, size, ProtFlags::READ, MapFlags::POPULATE);
        let mapping = mapping.map_err(error("mmap"))?;
        let identity = (status.st_dev, status.st_ino);
        Ok(Self { identity, mapping, file: Some(file), twin: OnceLock::new() })
    }

    /// The length in bytes.
    pub(crate) fn len(&self) -> u64 {
        self.mapping.len as u64
    }

    /// Equal for views of one segment, whatever way they came.
    pub(crate) fn identity(&self) -> (u64, u64) {
        self.identity
    }

    /// What came from the owner, or from who passed it on; none if it was [closed](Self::close).
    pub(crate) fn fd(&self) -> Option<BorrowedFd<'_>> {
        self.file.as_ref().map(AsFd::as_fd)
    }

    /// What of it is to be written to in this process; none if the system does not do that.
    pub(crate) fn owned(&self) -> Option<&Owned> {
        let owned = self.twin.get_or_init(|| Twin::of(self).ok().map(Owned::new));
        owned.as_ref()
    }

    /// Gives up the descriptor: what is mapped stays, but cannot be passed on.
    pub(crate) fn close(&mut self) {
        self.file = None;
    }

    /// The range of `len` bytes from `offset`, if there is one.
    pub(crate) fn range(&self, offset: u64, len: u64) -> Option<Range<usize>> {
        range_within(offset, len, self.mapping.len)
    }

    /// The bytes of a range; `None` if it lies outside. They are stable only as long as the owner
    /// has not been told that the object in them is released.
    pub(crate) fn bytes(&self, range: &Range<usize>) -> Option<&[u8]> {
        if range.start > range.end || range.end > self.mapping.len {
            return None;
        }
        let start = self.mapping.at(range.start);
        // SAFETY: the range lies in the mapping, which `self` keeps, and whose file cannot shrink;
        // this process cannot write it, and its owner does not while the object is held.
        Some(unsafe { slice::from_raw_parts(start, range.len()) })
    }
}

/// A segment of another federate as this process may write to it: the kernel copies a page when it is
/// first written, and nobody else sees it.
///
/// Pages that were not written are the segment's. So bytes are stable only as long as nobody writes
/// them there. Which pages belong to whom in this process is not known here.
#[derive(Debug)]
pub(crate) struct Twin {
    mapping: Mapping,
    /// What the kernel tells of each page; none if it does not.
    pages: Option<OwnedFd>,
}

/// In the kernel's entry for a page: it is in memory or swapped out, and not the file's.
const PRESENT: u64 = 0b11 << 62;
const OF_FILE: u64 = 1 << 61;

impl Twin {
    /// The bytes of the pages that a range touches.
    pub(crate) fn pages_of(range: &Range<usize>) -> Range<usize> {
        let page = rustix::param::page_size();
        range.start - range.start % page..range.end.next_multiple_of(page)
    }

    fn of(view: &SegmentView) -> Result<Self, Errno> {
        let file = view.fd().ok_or(Errno::BADF)?;
        let prot = ProtFlags::READ | ProtFlags::WRITE;
        let mapping = Mapping::with(file, view.mapping.len, prot, MapFlags::PRIVATE)?;
        let flags = fs::OFlags::RDONLY | fs::OFlags::CLOEXEC;
        let pages = fs::open("/proc/self/pagemap", flags, fs::Mode::empty()).ok();
        let twin = Self { mapping, pages };
        // Where memory is locked as soon as it is mapped, all of it has been copied.
        match twin.written(&Self::pages_of(&(0..view.mapping.len))) {
            0 => Ok(twin),
            _ => Err(Errno::NOTSUP),
        }
    }

    /// Where a byte is. All that follow in the twin may be read and written.
    pub(crate) fn at(&self, offset: usize) -> *mut u8 {
        self.mapping.at(offset)
    }

    /// How many of some pages were written, and are not the segment's any more. If the kernel does not
    /// tell, all of them.
    pub(crate) fn written(&self, pages: &Range<usize>) -> usize {
        let page = rustix::param::page_size();
        let count = pages.len() / page;
        let Some(file) = &self.pages else { return count };
        let mut entries = vec![0; count * size_of::<u64>()];
        let first = (self.at(pages.start) as usize / page * size_of::<u64>()) as u64;
        if rustix::io::pread(file, &mut entries[..], first) != Ok(entries.len()) {
            return count;
        }
        let (entries, _) = entries.as_chunks();
        let entries = entries.iter().map(|entry| u64::from_ne_bytes(*entry));
        entries.filter(|entry| entry & PRESENT != 0 && entry & OF_FILE == 0).count()
    }

    /// Gives up what was written to some pages: they are the segment's again. Nobody may have a
    /// pointer to them. Returns whether that is done.
    pub(crate) fn discard(&self, pages: &Range<usize>) -> bool {
        let len = pages.end.min(self.mapping.len) - pages.start;
        // SAFETY: the range lies in the mapping, of which no slices are made, and by the contract no
        // pointer is used; the bytes are then those of the file, which are valid.
        unsafe { mm::madvise(self.at(pages.start).cast(), len, Advice::LinuxDontNeed) }.is_ok()
    }

    /// Has the kernel copy some pages now. Returns whether there is memory for that.
    pub(crate) fn take(&self, pages: &Range<usize>) -> bool {
        let len = pages.end.min(self.mapping.len) - pages.start;
        let (start, advice) = (self.at(pages.start).cast(), Advice::LinuxPopulateWrite);
        // SAFETY: the range lies in the mapping, and the advice changes no byte of it.
        match unsafe { mm::madvise(start, len, advice) } {
            Ok(()) => true,
            // A kernel that does not know the advice copies a page when it is written.
            Err(Errno::INVAL) => {
                for at in pages.clone().step_by(OWN_STEP) {
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

/// A way to a segment for one reader: a description of the file of its own, on which bytes can be
/// marked as in use.
///
/// The kernel keeps the marks until the last process that has the description gives it up, however it
/// ends. So they tell the owner of the memory what a reader has of which it was never told.
#[derive(Debug)]
pub(crate) struct Passage(OwnedFd);

impl Passage {
    /// A new way to the segment of `file`.
    pub(crate) fn to(file: BorrowedFd<'_>) -> Result<Self, Errno> {
        let path = format!("/proc/self/fd/{}", file.as_raw_fd());
        let flags = fs::OFlags::RDONLY | fs::OFlags::CLOEXEC;
        Ok(Self(fs::open(path, flags, fs::Mode::empty())?))
    }

    pub(crate) fn fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }

    /// Marks bytes as in use. Returns whether the kernel does that.
    pub(crate) fn mark(&self, offset: u64, len: u64) -> bool {
        lock(self.fd(), libc::F_OFD_SETLK, libc::F_RDLCK, offset, len).is_some()
    }

    /// Takes the mark away.
    pub(crate) fn unmark(&self, offset: u64, len: u64) {
        // A range that was marked can be unmarked.
        let _ = lock(self.fd(), libc::F_OFD_SETLK, libc::F_UNLCK, offset, len);
    }
}

/// A file of which bytes can be marked; it has none, so it needs no memory.
pub(crate) fn marks() -> Result<OwnedFd, Errno> {
    fs::memfd_create("forks-hprm", MemfdFlags::CLOEXEC)
}

/// A mark on a byte of a file, kept by a mapping: this process has it until it is dropped, and a process
/// that is forked meanwhile until it ends or starts another program, whatever descriptors it closes.
#[derive(Debug)]
pub(crate) struct Tether {
    /// Shows nothing, and is never read.
    _mapping: Mapping,
}

impl Tether {
    /// Marks a byte of the file.
    pub(crate) fn to(file: BorrowedFd<'_>, byte: u64) -> Result<Self, Errno> {
        let passage = Passage::to(file)?;
        if !passage.mark(byte, 1) {
            return Err(Errno::NOLCK);
        }
        // The mapping keeps the description of the file, and that keeps the mark.
        let (page, prot) = (rustix::param::page_size(), ProtFlags::empty());
        let mapping = Mapping::with(passage.fd(), page, prot, MapFlags::SHARED)?;
        Ok(Self { _mapping: mapping })
    }
}

/// Whether some of the bytes are marked by others than who has this description of the file.
pub(crate) fn is_marked(file: BorrowedFd<'_>, offset: u64, len: u64) -> bool {
    let found = lock(file, libc::F_OFD_GETLK, libc::F_WRLCK, offset, len);
    // If the kernel does not tell, nobody could mark anything either.
    found.is_some_and(|kind| kind != libc::F_UNLCK)
}

/// Asks for a lock on bytes of a file, by its description. Returns the kind that the kernel answers,
/// or none if it refuses.
fn lock(
    file: BorrowedFd<'_>,
    command: libc::c_int,
    kind: libc::c_int,
    offset: u64,
    len: u64,
) -> Option<libc::c_int> {
    let mut range = libc::flock {
        l_type: libc::c_short::try_from(kind).ok()?,
        l_whence: libc::c_short::try_from(libc::SEEK_SET).ok()?,
        l_start: i64::try_from(offset).ok()?,
        l_len: i64::try_from(len).ok().filter(|len| *len > 0)?,
        l_pid: 0,
    };
    // SAFETY: the descriptor is open, and these commands read and write one `flock`, which is ours.
    let status = unsafe { libc::fcntl(file.as_raw_fd(), command, &raw mut range) };
    (status == 0).then_some(libc::c_int::from(range.l_type))
}

#[cfg(test)]
mod tests {
    use super::*;

    const LEN: u64 = 1 << 16;

    fn segment() -> Arc<Segment> {
        Arc::new(Segment::create(LEN).unwrap())
    }

    fn dup(segment: &Segment) -> OwnedFd {
        segment.fd().try_clone_to_owned().unwrap()
    }

    #[test]
    fn a_view_shows_what_the_owner_wrote() {
        let segment = segment();
        segment.writing(4096, 5).unwrap().bytes_mut().copy_from_slice(b"hello");
        let view = SegmentView::map(dup(&segment), LEN).unwrap();
        assert_eq!(view.bytes(&(4096..4101)), Some(&b"hello"[..]));
        drop(segment);
        assert_eq!(view.bytes(&(4096..4101)), Some(&b"hello"[..]));
    }

    #[test]
    fn a_view_does_not_reach_outside() {
        let view = SegmentView::map(dup(&segment()), LEN).unwrap();
        assert_eq!(view.range(LEN - 1, 2), None);
        assert_eq!(view.range(u64::MAX, 2), None);
        assert_eq!(view.bytes(&(0..65_537)), None);
        assert_eq!(view.range(LEN, 0), Some(65_536..65_536));
        assert_eq!(view.bytes(&(65_536..65_536)), Some(&[][..]));
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
    fn a_view_cannot_be_made_writable() {
        let segment = segment();
        let view = SegmentView::map(dup(&segment), LEN).unwrap();
        let base = view.mapping.base.as_ptr().cast();
        // SAFETY: the call is expected to fail; if it did not, nothing would write here.
        let changed = unsafe { mm::mprotect(base, 4096, mm::MprotectFlags::WRITE) };
        assert_eq!(changed, Err(Errno::ACCESS));
    }

    #[test]
    fn only_sealed_memory_of_the_right_length_is_mapped() {
        let unsealed = fs::memfd_create("test", MemfdFlags::ALLOW_SEALING).unwrap();
        fs::ftruncate(&unsealed, LEN).unwrap();
        assert_eq!(
            SegmentView::map(unsealed.try_clone().unwrap(), LEN).unwrap_err(),
            SegmentError::NotSealed
        );
        fs::fcntl_add_seals(&unsealed, SealFlags::SHRINK).unwrap();
        assert_eq!(
            SegmentView::map(unsealed.try_clone().unwrap(), LEN).unwrap_err(),
            SegmentError::NotSealed
        );

        let null = OwnedFd::from(std::fs::OpenOptions::new().read(true).open("/dev/null").unwrap());
        assert_eq!(SegmentView::map(null, LEN).unwrap_err(), SegmentError::NotSealed);

        let too_short = SegmentError::TooShort { announced: LEN + 1, actual: LEN };
        assert_eq!(SegmentView::map(dup(&segment()), LEN + 1).unwrap_err(), too_short);
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
        let first = segment.writing(0, 64).unwrap();
        assert!(segment.writing(32, 64).is_none());
        assert!(segment.reading(0, 64).is_none());
        assert!(segment.writing(LEN, 1).is_none());
        let second = segment.writing(64, 64).unwrap();
        drop((first, second));
        let readers = [(); 2].map(|()| segment.reading(0, 64).unwrap());
        assert!(segment.writing(0, 64).is_none());
        drop(readers);
        assert!(segment.writing(0, 64).is_some());
    }

    #[test]
    fn every_page_of_a_new_segment_is_present() {
        let segment = Segment::create(4 << 20).unwrap();
        let blocks = fs::fstat(segment.fd()).unwrap().st_blocks;
        assert_eq!(u64::try_from(blocks).unwrap() * 512, segment.len());
    }

    #[test]
    fn what_is_written_to_a_twin_is_nowhere_else_until_it_is_given_up() {
        let segment = segment();
        segment.writing(0, LEN).unwrap().bytes_mut().fill(7);
        let view = SegmentView::map(dup(&segment), LEN).unwrap();
        let twin = Twin::of(&view).unwrap();
        let read = |at| {
            // SAFETY: the byte lies in the twin, and the test has one thread.
            unsafe { twin.at(at).read_volatile() }
        };
        let pages = Twin::pages_of(&(4_100..20_001));
        assert_eq!((pages.start, read(4_100), twin.written(&pages)), (4_096, 7, 0));
        // SAFETY: as above; nobody has a slice of it.
        unsafe { twin.at(4_100).write_volatile(8) };
        assert_eq!((read(4_100), twin.written(&pages)), (8, 1));
        assert_eq!(view.bytes(&(4_100..4_101)), Some(&[7][..]));
        segment.writing(0, LEN).unwrap().bytes_mut().fill(9);
        assert_eq!((read(4_100), read(4_101), read(20_000)), (8, 7, 9));
        assert!(twin.discard(&pages));
        assert_eq!((read(4_100), read(4_101), twin.written(&pages)), (9, 9, 0));
        // Pages that are taken do not change any more with the segment, and others do.
        assert!(twin.take(&pages));
        assert_eq!(twin.written(&pages), pages.len() / rustix::param::page_size());
        segment.writing(0, LEN).unwrap().bytes_mut().fill(10);
        assert_eq!((read(pages.end - 1), read(pages.end)), (9, 10));
    }

    #[test]
    fn bytes_are_marked_as_long_as_somebody_has_the_passage() {
        let segment = segment();
        let passage = Passage::to(segment.fd()).unwrap();
        assert!(passage.mark(4096, 64));
        assert!(is_marked(segment.fd(), 4159, 1));
        assert!(!is_marked(segment.fd(), 4160, 64));
        assert!(!is_marked(passage.fd(), 4096, 64));
        let sent = passage.fd().try_clone_to_owned().unwrap();
        drop(passage);
        assert!(is_marked(segment.fd(), 4096, 64));
        drop(sent);
        assert!(!is_marked(segment.fd(), 4096, 64));
    }

    #[test]
    fn a_passage_is_as_good_as_the_segment_and_no_better() {
        let segment = segment();
        let passage = Passage::to(segment.fd()).unwrap();
        segment.writing(0, 5).unwrap().bytes_mut().copy_from_slice(b"hello");
        let fd = passage.fd().try_clone_to_owned().unwrap();
        assert_eq!(rustix::io::write(&fd, b"x"), Err(Errno::BADF));
        let view = SegmentView::map(fd, LEN).unwrap();
        assert_eq!(view.bytes(&(0..5)), Some(&b"hello"[..]));
    }
}
