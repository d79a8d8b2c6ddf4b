//! Record locks of open file descriptions, by which processes show which bytes they still use.
//!
//! The kernel keeps such a lock until the last process that has the open file description closes it or
//! ends, for whatever reason. So a lock tells what a process uses even after that process was killed.
//! What the locked bytes stand for is decided by the callers.

#![allow(unsafe_code)]

use std::os::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd};

use rustix::fs::{self, MemfdFlags};
use rustix::io::Errno;
use rustix::mm::{MapFlags, ProtFlags};

use super::mapping::Mapping;

/// An open file description of its own, for a file that is open already. It carries record locks.
///
/// Made for each reader of a segment that is forwarded: its locks tell the owner of the memory what a
/// reader uses of which the owner was never told.
#[derive(Debug)]
pub(crate) struct FileDescription(OwnedFd);

impl FileDescription {
    /// Opens the file once more, for reading.
    pub(crate) fn reopen(file: BorrowedFd<'_>) -> Result<Self, Errno> {
        let path = format!("/proc/self/fd/{}", file.as_raw_fd());
        let flags = fs::OFlags::RDONLY | fs::OFlags::CLOEXEC;
        Ok(Self(fs::open(path, flags, fs::Mode::empty())?))
    }

    pub(crate) fn fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }

    /// Locks bytes for reading. Returns whether the kernel does that.
    pub(crate) fn lock(&self, offset: u64, len: u64) -> bool {
        record_lock(self.fd(), libc::F_OFD_SETLK, libc::F_RDLCK, offset, len).is_some()
    }

    /// Ends the lock.
    pub(crate) fn unlock(&self, offset: u64, len: u64) {
        // A range that was locked can be unlocked.
        let _ = record_lock(self.fd(), libc::F_OFD_SETLK, libc::F_UNLCK, offset, len);
    }
}

/// A file of which bytes can be locked; it is empty, so it needs no memory.
pub(crate) fn lock_file() -> Result<OwnedFd, Errno> {
    fs::memfd_create("forks-hprm", MemfdFlags::CLOEXEC)
}

/// A lock on a byte of a file, kept by a mapping. This process has it until it is dropped. A process
/// that is forked meanwhile has it until it ends or starts another program, whichever descriptors it
/// closes.
#[derive(Debug)]
pub(crate) struct ForkLock {
    /// Shows nothing, and is never read.
    _mapping: Mapping,
}

impl ForkLock {
    /// Locks a byte of the file.
    pub(crate) fn new(file: BorrowedFd<'_>, byte: u64) -> Result<Self, Errno> {
        let description = FileDescription::reopen(file)?;
        if !description.lock(byte, 1) {
            return Err(Errno::NOLCK);
        }
        // The mapping keeps the open file description, and that keeps the lock.
        let (page, prot) = (rustix::param::page_size(), ProtFlags::empty());
        let mapping = Mapping::with(description.fd(), page, prot, MapFlags::SHARED)?;
        Ok(Self { _mapping: mapping })
    }
}

/// Whether some of the bytes are locked by another open file description than this one.
pub(crate) fn is_locked(file: BorrowedFd<'_>, offset: u64, len: u64) -> bool {
    let found = record_lock(file, libc::F_OFD_GETLK, libc::F_WRLCK, offset, len);
    // If the kernel does not tell, no process could lock anything either.
    found.is_some_and(|kind| kind != libc::F_UNLCK)
}

/// Calls `fcntl` for a lock on bytes of a file. Returns the kind of lock that the kernel answers, or
/// none if it refuses.
fn record_lock(
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
    use std::sync::Arc;

    use super::super::{Segment, SegmentView};
    use super::*;

    const LEN: u64 = 1 << 16;

    #[test]
    fn bytes_are_locked_as_long_as_a_process_has_the_file_description() {
        let segment = Segment::create(LEN).unwrap();
        let description = FileDescription::reopen(segment.fd()).unwrap();
        assert!(description.lock(4096, 64));
        assert!(is_locked(segment.fd(), 4159, 1));
        assert!(!is_locked(segment.fd(), 4160, 64));
        assert!(!is_locked(description.fd(), 4096, 64));
        let sent = description.fd().try_clone_to_owned().unwrap();
        drop(description);
        assert!(is_locked(segment.fd(), 4096, 64));
        drop(sent);
        assert!(!is_locked(segment.fd(), 4096, 64));
    }

    #[test]
    fn a_second_file_description_reads_the_segment_and_cannot_write_it() {
        let segment = Arc::new(Segment::create(LEN).unwrap());
        let description = FileDescription::reopen(segment.fd()).unwrap();
        segment.borrow_mut(0, 5).unwrap().bytes_mut().copy_from_slice(b"hello");
        let fd = description.fd().try_clone_to_owned().unwrap();
        assert_eq!(rustix::io::write(&fd, b"x"), Err(Errno::BADF));
        let view = SegmentView::map(fd, LEN).unwrap();
        assert_eq!(view.bytes(&(0..5)), Some(&b"hello"[..]));
    }
}
