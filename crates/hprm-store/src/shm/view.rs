//! Shared memory of another federate, mapped for reading.

#![allow(unsafe_code)]

use std::ops::Range;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::slice;
use std::sync::OnceLock;

use rustix::fs::{self, SealFlags};
use rustix::io::Errno;
use rustix::mm::{MapFlags, ProtFlags};

use super::cow::CowMapping;
use super::cow_pages::CowPages;
use super::mapping::Mapping;
use crate::SegmentError;

/// A segment of another federate, mapped for reading.
#[derive(Debug)]
pub(crate) struct SegmentView {
    /// Device and inode of the file: the same for all descriptors of one segment.
    identity: (u64, u64),
    mapping: Mapping,
    file: Option<OwnedFd>,
    /// The copy-on-write mapping of the same segment; none if the system does not make one.
    cow: OnceLock<Option<CowPages>>,
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
        Ok(Self { identity, mapping, file: Some(file), cow: OnceLock::new() })
    }

    /// The length in bytes.
    pub(crate) fn len(&self) -> u64 {
        self.mapping.len() as u64
    }

    /// Equal for views of one segment, whichever federates forwarded it.
    pub(crate) fn identity(&self) -> (u64, u64) {
        self.identity
    }

    /// The descriptor that came from the owner, or from the federate that forwarded the segment; none
    /// if it was [closed](Self::close).
    pub(crate) fn fd(&self) -> Option<BorrowedFd<'_>> {
        self.file.as_ref().map(AsFd::as_fd)
    }

    /// The copy-on-write mapping of the segment; none if the system does not make one.
    pub(crate) fn cow(&self) -> Option<&CowPages> {
        let map = || {
            let mapping = CowMapping::new(self.fd()?, self.mapping.len()).ok()?;
            Some(CowPages::new(mapping))
        };
        self.cow.get_or_init(map).as_ref()
    }

    /// Closes the descriptor: the mapping stays, but the segment cannot be forwarded.
    pub(crate) fn close(&mut self) {
        self.file = None;
    }

    /// The range of `len` bytes from `offset`, if there is one.
    pub(crate) fn range(&self, offset: u64, len: u64) -> Option<Range<usize>> {
        self.mapping.range(offset, len)
    }

    /// The bytes of a range; `None` if it lies outside. They are stable only until the owner receives
    /// the release of the object in them.
    pub(crate) fn bytes(&self, range: &Range<usize>) -> Option<&[u8]> {
        if range.start > range.end || range.end > self.mapping.len() {
            return None;
        }
        let start = self.mapping.at(range.start);
        // SAFETY: the range lies in the mapping, which `self` keeps, and whose file cannot shrink;
        // this process cannot write it, and its owner does not while the object is held.
        Some(unsafe { slice::from_raw_parts(start, range.len()) })
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use rustix::fs::MemfdFlags;
    use rustix::mm;

    use super::super::Segment;
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
        segment.borrow_mut(4096, 5).unwrap().bytes_mut().copy_from_slice(b"hello");
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
    fn a_view_cannot_be_made_writable() {
        let segment = segment();
        let view = SegmentView::map(dup(&segment), LEN).unwrap();
        let base = view.mapping.at(0).cast();
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
}
