//! Words of memory that one process writes and others read: what a [board](crate::board) lies in.
//!
//! The owner's mapping is the only one that can be written. All access is by atomic words, for which any
//! bits are valid; the board checks what it reads.

#![allow(unsafe_code)]

use std::os::fd::OwnedFd;
#[cfg(test)]
use std::os::fd::{AsRawFd, RawFd};
use std::slice;
use std::sync::atomic::{AtomicU64, Ordering};

use rustix::fs::{self, MemfdFlags, SealFlags};
use rustix::io::Errno;
use rustix::mm::{MapFlags, ProtFlags};

use super::mapping::Mapping;
use crate::SegmentError;

/// Against which changes the file is sealed: of its length, of its seals, and by other processes.
const SEALS: SealFlags =
    SealFlags::SHRINK.union(SealFlags::GROW).union(SealFlags::FUTURE_WRITE).union(SealFlags::SEAL);

const WORD: usize = size_of::<AtomicU64>();

/// The owner's side.
#[derive(Debug)]
pub(crate) struct PublishedWords {
    mapping: Mapping,
    count: usize,
    /// Open as long as this lives: readers find the memory by the descriptors of its owner.
    file: OwnedFd,
}

impl PublishedWords {
    /// Creates `count` words, all of them zero and present, in a memfd of this name.
    pub(crate) fn create(name: &str, count: usize) -> Result<Self, SegmentError> {
        let size = count * WORD;
        let len = size as u64;
        let error = |step| move |cause| SegmentError::Create { len, step, cause };
        let flags = MemfdFlags::CLOEXEC | MemfdFlags::ALLOW_SEALING;
        let file = fs::memfd_create(name, flags).map_err(error("memfd_create"))?;
        fs::ftruncate(&file, len).map_err(error("ftruncate"))?;
        let mapping = Mapping::present(&file, size).map_err(error("mmap"))?;
        // Only now: the seal spares the writable mapping that exists, and forbids all later ones.
        fs::fcntl_add_seals(&file, SEALS).map_err(error("seal"))?;
        Ok(Self { mapping, count, file })
    }

    /// Another descriptor of the memory.
    pub(crate) fn descriptor(&self) -> std::io::Result<OwnedFd> {
        self.file.try_clone()
    }

    pub(crate) fn words(&self) -> &[AtomicU64] {
        let start = self.mapping.at(0).cast::<AtomicU64>();
        // SAFETY: the mapping has `count` words, begins at a page and is there as long as `self`; its
        // file cannot shrink. All access to it, here and in other processes, is by atomic words, for
        // which any bits are valid; no other reference to it is ever made.
        unsafe { slice::from_raw_parts(start, self.count) }
    }
}

#[cfg(test)]
impl AsRawFd for PublishedWords {
    fn as_raw_fd(&self) -> RawFd {
        self.file.as_raw_fd()
    }
}

/// A reader's side.
#[derive(Debug)]
pub(crate) struct WordsView {
    mapping: Mapping,
    count: usize,
}

impl WordsView {
    /// Maps all whole words of a file, if it can do no harm. The descriptor is not needed afterwards.
    pub(crate) fn map(file: &OwnedFd) -> Result<Self, SegmentError> {
        let unmapped = |step| move |cause| SegmentError::Map { len: 0, step, cause };
        match fs::fcntl_get_seals(file) {
            Ok(seals) if seals.contains(SealFlags::SHRINK | SealFlags::FUTURE_WRITE) => {}
            // Not a memfd, or one that is not sealed.
            Ok(_) | Err(Errno::INVAL) => return Err(SegmentError::NotSealed),
            Err(cause) => return Err(unmapped("get seals")(cause)),
        }
        let status = fs::fstat(file).map_err(unmapped("fstat"))?;
        let count = usize::try_from(status.st_size).unwrap_or(0) / WORD;
        if count == 0 {
            return Err(SegmentError::TooShort { announced: WORD as u64, actual: 0 });
        }
        let len = (count * WORD) as u64;
        let error = |step| move |cause| SegmentError::Map { len, step, cause };
        let mapping = Mapping::new(file, count * WORD, ProtFlags::READ, MapFlags::empty());
        Ok(Self { mapping: mapping.map_err(error("mmap"))?, count })
    }

    /// How many words there are.
    pub(crate) fn count(&self) -> usize {
        self.count
    }

    /// Loads a word. Only [`Ordering::Relaxed`] loads are sure to work on memory that cannot be written; the
    /// caller has fences for the rest.
    pub(crate) fn load(&self, at: usize) -> u64 {
        assert!(at < self.count, "the board has checked every position");
        let word = self.mapping.at(at * WORD).cast::<AtomicU64>();
        // SAFETY: the word lies in the mapping, is aligned because the mapping begins at a page, and is there as
        // long as `self`, because the file cannot shrink. All access to it, here and in the owner, is atomic.
        unsafe { &*word }.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reopened(words: &PublishedWords) -> OwnedFd {
        let path = format!("/proc/self/fd/{}", words.as_raw_fd());
        std::fs::OpenOptions::new().read(true).open(path).unwrap().into()
    }

    #[test]
    fn a_reader_sees_what_the_owner_writes_and_cannot_write() {
        let words = PublishedWords::create("test", 1024).unwrap();
        let file = reopened(&words);
        let view = WordsView::map(&file).unwrap();
        words.words()[1023].store(7, Ordering::Relaxed);
        assert_eq!((view.count(), view.load(1023), view.load(0)), (1024, 7, 0));
        let prot = ProtFlags::READ | ProtFlags::WRITE;
        let path = format!("/proc/self/fd/{}", words.as_raw_fd());
        let writable = std::fs::OpenOptions::new().read(true).write(true).open(path).unwrap();
        let mapped = Mapping::new(&writable.into(), 4096, prot, MapFlags::empty());
        assert_eq!(mapped.map(|_| ()), Err(Errno::PERM));
        assert_eq!(fs::ftruncate(&words.file, 0), Err(Errno::PERM));
    }

    #[test]
    fn what_is_not_sealed_or_empty_is_not_mapped() {
        let open = fs::memfd_create("test", MemfdFlags::ALLOW_SEALING).unwrap();
        fs::ftruncate(&open, 8192).unwrap();
        assert_eq!(WordsView::map(&open).unwrap_err(), SegmentError::NotSealed);
        let empty = fs::memfd_create("test", MemfdFlags::ALLOW_SEALING).unwrap();
        fs::fcntl_add_seals(&empty, SEALS).unwrap();
        let short = SegmentError::TooShort { announced: 8, actual: 0 };
        assert_eq!(WordsView::map(&empty).unwrap_err(), short);
    }
}
