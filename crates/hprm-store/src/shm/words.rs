//! Words of memory that two processes write: what a pair of [rings](crate::ring) lies in.
//!
//! Unlike a segment, this memory has no owner: both sides may write all of it at any time. So there is
//! no slice of plain bytes here, only of atomic words. The ring checks what it reads from them.

#![allow(unsafe_code)]

use std::ops::Range;
use std::os::fd::OwnedFd;
use std::slice;
use std::sync::atomic::AtomicU64;

use rustix::fs::{self, MemfdFlags, SealFlags};
use rustix::io::Errno;
use rustix::mm::{MapFlags, ProtFlags};

use super::mapping::Mapping;
use crate::SegmentError;

/// Against which changes the file is sealed: of its length, and of its seals.
const SEALS: SealFlags = SealFlags::SHRINK.union(SealFlags::GROW).union(SealFlags::SEAL);

/// Memory that this process shares with another one. It has no name, and is freed when the last of them
/// unmaps it or ends.
#[derive(Debug)]
pub(crate) struct SharedWords {
    mapping: Mapping,
    count: usize,
}

impl SharedWords {
    /// Creates `count` words, all of them zero, and the descriptor by which the other side maps them. Those of the ranges
    /// `soon` are present; the system gives memory to others when they are written.
    pub(crate) fn create(
        count: usize,
        soon: &[Range<usize>],
    ) -> Result<(Self, OwnedFd), SegmentError> {
        let (size, len) = size_of(count);
        let error = |step| move |cause| SegmentError::Create { len, step, cause };
        let flags = MemfdFlags::CLOEXEC | MemfdFlags::ALLOW_SEALING;
        let file = fs::memfd_create("hprm-ring", flags).map_err(error("memfd_create"))?;
        fs::ftruncate(&file, len).map_err(error("ftruncate"))?;
        let mapping = mapped(&file, size, soon).map_err(error("mmap"))?;
        fs::fcntl_add_seals(&file, SEALS).map_err(error("seal"))?;
        Ok((Self { mapping, count }, file))
    }

    /// Maps what the other side has created, if it can do no harm, with the ranges `soon` present.
    pub(crate) fn map(
        file: &OwnedFd,
        count: usize,
        soon: &[Range<usize>],
    ) -> Result<Self, SegmentError> {
        let (size, len) = size_of(count);
        let error = |step| move |cause| SegmentError::Map { len, step, cause };
        match fs::fcntl_get_seals(file) {
            Ok(seals) if seals.contains(SealFlags::SHRINK) => {}
            // Not a memfd, or one that cannot be sealed.
            Ok(_) | Err(Errno::INVAL) => return Err(SegmentError::NotSealed),
            Err(cause) => return Err(error("get seals")(cause)),
        }
        let status = fs::fstat(file).map_err(error("fstat"))?;
        let actual = u64::try_from(status.st_size).unwrap_or(0);
        if actual < len {
            return Err(SegmentError::TooShort { announced: len, actual });
        }
        let mapping = mapped(file, size, soon).map_err(error("mmap"))?;
        Ok(Self { mapping, count })
    }
}

/// Maps a file, and makes ranges of its words present. Kernels before 5.14 cannot; there all are when they are used.
fn mapped(file: &OwnedFd, size: usize, soon: &[Range<usize>]) -> Result<Mapping, Errno> {
    let prot = ProtFlags::READ | ProtFlags::WRITE;
    let mapping = Mapping::new(file, size, prot, MapFlags::empty())?;
    for range in soon {
        match mapping.populate(size_of(range.start).0..size_of(range.end).0) {
            Ok(()) | Err(Errno::INVAL) => {}
            Err(cause) => return Err(cause),
        }
    }
    Ok(mapping)
}

impl AsRef<[AtomicU64]> for SharedWords {
    fn as_ref(&self) -> &[AtomicU64] {
        let start = self.mapping.at(0).cast::<AtomicU64>();
        // SAFETY: the mapping has `count` words, begins at a page and is there as long as `self`; its
        // file cannot shrink. All access to it, here and in the other process, is by atomic words, for
        // which any bits are valid; no other reference to it is ever made.
        unsafe { slice::from_raw_parts(start, self.count) }
    }
}

/// Has the processor fetch a word into its cache, if it can be told to.
#[inline]
pub(crate) fn fetch(word: &AtomicU64) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: the hint changes nothing that a program sees, whatever the address; this one is of a word.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(word.as_ptr().cast()) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = word;
}

/// Has the processor fetch a word into its cache and away from those of others, if it can be told to.
#[inline]
pub(crate) fn fetch_to_store(word: &AtomicU64) {
    #[cfg(target_arch = "x86_64")]
    {
        // SAFETY: the hint changes nothing that a program sees, whatever the address; a processor that does not know it
        // does nothing.
        unsafe {
            std::arch::asm!("prefetchw [{}]", in(reg) word.as_ptr(), options(nostack, preserves_flags, readonly));
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = word;
}

/// How many bytes `count` words have.
fn size_of(count: usize) -> (usize, u64) {
    let size = count * std::mem::size_of::<AtomicU64>();
    (size, size as u64)
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::Ordering;

    use super::*;

    const SOON: [Range<usize>; 2] = [0..8, 1000..1020];

    #[test]
    fn both_sides_see_what_either_writes() {
        let (here, file) = SharedWords::create(1024, &SOON).unwrap();
        let there = SharedWords::map(&file, 1024, &SOON).unwrap();
        here.as_ref()[7].store(1, Ordering::Release);
        there.as_ref()[1023].store(2, Ordering::Release);
        assert_eq!(there.as_ref()[7].load(Ordering::Acquire), 1);
        assert_eq!(here.as_ref()[1023].load(Ordering::Acquire), 2);
    }

    #[test]
    fn what_could_shrink_or_is_short_is_not_mapped() {
        let open = fs::memfd_create("test", MemfdFlags::ALLOW_SEALING).unwrap();
        fs::ftruncate(&open, 8192).unwrap();
        assert_eq!(SharedWords::map(&open, 1024, &[]).unwrap_err(), SegmentError::NotSealed);
        let (_, file) = SharedWords::create(1024, &SOON).unwrap();
        let short = SegmentError::TooShort { announced: 8200, actual: 8192 };
        assert_eq!(SharedWords::map(&file, 1025, &[]).unwrap_err(), short);
        assert_eq!(fs::ftruncate(&file, 0), Err(Errno::PERM));
    }
}
