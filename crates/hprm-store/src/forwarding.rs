//! Objects of other federates that this one forwards, without touching their bytes.
//!
//! To its readers they are objects of this federate: they map a segment under a number of this
//! federate, and release to it. This federate holds the received object until all its readers have
//! released theirs; only then it releases it to the federate that sent it. So a federate needs to know, and
//! to reach, only the federates that have sent it something.
//!
//! If a federate that forwards ends before its readers, they go on reading, and no federate would tell
//! the owner of the memory. So each reader gets an open file description of its own ([`FileDescription`]),
//! on which its objects are locked, and an owner that loses a reader looks for locks before it writes
//! there again. Each hop locks another byte of the object: the owner must find the locks of readers behind
//! the lost reader, not those of the hops before it, which themselves wait for this owner. The ledger counts
//! holds.

#![forbid(unsafe_code)]

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::ops::Range;
use std::os::fd::BorrowedFd;
use std::sync::Arc;

use hprm_core::{FederateId, ObjectRef};

use crate::Object;
use crate::shm::{FileDescription, SegmentView};

/// A segment's number has its hops in the upper bits, above a counter of this many bits.
const COUNTER_BITS: u32 = 26;

/// How often an object may be forwarded without a copy: each hop locks one byte, and the smallest block
/// of an owner has enough bytes for that.
const MAX_HOPS: u32 = 62;

/// How many federates have forwarded a segment, up to the one that gave it this number.
fn hops(segment: u32) -> u32 {
    segment >> COUNTER_BITS
}

/// The bytes of an object that are locked for federates to which its readers have forwarded it: the first
/// byte, and how many.
pub(crate) fn locks_of_later_hops(object: &ObjectRef) -> (u64, u64) {
    let next = u64::from(hops(object.segment)) + 1;
    (object.offset + next, u64::from(MAX_HOPS) + 1 - next.min(u64::from(MAX_HOPS)))
}

/// The byte that is locked for a reader of a forwarded object.
fn lock_of(object: &ObjectRef) -> u64 {
    object.offset + u64::from(hops(object.segment))
}

/// The segments and objects that this federate forwards, and their numbers here.
#[derive(Debug, Default)]
pub(crate) struct Forwarding {
    /// By the address of the view, which does not move as long as this map has it.
    segments: BTreeMap<usize, ForwardedSegment>,
    /// The objects as they were received, by their serial numbers here.
    objects: BTreeMap<u64, ForwardedObject>,
    /// The serial numbers here, by the bytes of the objects. An object that is received again, perhaps
    /// along another path, is forwarded under the number that it has. If it had two numbers, and came
    /// back from a reader of the first one, each could wait for the other to end.
    serials: BTreeMap<ByteRange, u64>,
    /// The open file descriptions of readers, by the numbers of the segments here.
    descriptions: BTreeMap<(FederateId, u32), Arc<FileDescription>>,
    /// How many segment numbers are in use or were.
    numbers: u32,
}

#[derive(Debug)]
struct ForwardedSegment {
    number: u32,
    view: Arc<SegmentView>,
    objects: usize,
}

#[derive(Debug)]
struct ForwardedObject {
    received: Object,
    view: Arc<SegmentView>,
    range: Range<usize>,
}

/// The identity of a segment, and a range of bytes in it.
type ByteRange = ((u64, u64), usize, usize);

fn byte_range(view: &SegmentView, range: &Range<usize>) -> ByteRange {
    (view.identity(), range.start, range.end)
}

impl Forwarding {
    /// The serial number that some bytes have here, if they are being forwarded already.
    pub(crate) fn serial_of(&self, view: &SegmentView, range: &Range<usize>) -> Option<u64> {
        self.serials.get(&byte_range(view, range)).copied()
    }

    /// The number here of the segment of a view, which was received as `segment`; none if the kernel
    /// gives no locks for its readers.
    pub(crate) fn add_segment(&mut self, view: &Arc<SegmentView>, segment: u32) -> Option<u32> {
        let key = Arc::as_ptr(view) as usize;
        if let Some(forwarded) = self.segments.get(&key) {
            return Some(forwarded.number);
        }
        // Tried here: later it is too late for a copy.
        if !FileDescription::reopen(view.fd()?).is_ok_and(|description| description.lock(0, 1)) {
            return None;
        }
        let hops = hops(segment) + 1;
        if hops > MAX_HOPS || self.numbers >> COUNTER_BITS != 0 {
            return None;
        }
        let number = hops << COUNTER_BITS | self.numbers;
        self.numbers += 1;
        let view = Arc::clone(view);
        self.segments.insert(key, ForwardedSegment { number, view, objects: 0 });
        Some(number)
    }

    /// Keeps a received object that is forwarded as `serial`.
    pub(crate) fn add_object(
        &mut self,
        serial: u64,
        received: Object,
        view: &Arc<SegmentView>,
        range: Range<usize>,
    ) {
        let segment = self.segments.get_mut(&(Arc::as_ptr(view) as usize));
        segment.expect("its segment was added before").objects += 1;
        self.serials.insert(byte_range(view, &range), serial);
        self.objects.insert(serial, ForwardedObject { received, view: Arc::clone(view), range });
    }

    /// The number of the segment of a forwarded object.
    pub(crate) fn segment_of(&self, serial: u64) -> Option<u32> {
        let object = self.objects.get(&serial)?;
        Some(self.segments.get(&(Arc::as_ptr(&object.view) as usize))?.number)
    }

    /// The bytes of a forwarded object.
    pub(crate) fn bytes(&self, serial: u64) -> Option<(Arc<SegmentView>, Range<usize>)> {
        let object = self.objects.get(&serial)?;
        Some((Arc::clone(&object.view), object.range.clone()))
    }

    /// Locks an object for `reader`, if it is a forwarded one.
    pub(crate) fn lock(&mut self, object: &ObjectRef, reader: FederateId) {
        let Some(forwarded) = self.objects.get(&object.serial) else { return };
        let Some(file) = forwarded.view.fd() else { return };
        let key = (reader, object.segment);
        let description = match self.descriptions.entry(key) {
            Entry::Occupied(entry) => entry.into_mut(),
            // Without one, the reader gets the descriptor by which the segment was received.
            Entry::Vacant(entry) => match FileDescription::reopen(file) {
                Ok(description) => entry.insert(Arc::new(description)),
                Err(_) => return,
            },
        };
        description.lock(lock_of(object), 1);
    }

    /// Ends the lock: `reader` has released the object.
    pub(crate) fn unlock(&self, object: &ObjectRef, reader: FederateId) {
        if let Some(description) = self.descriptions.get(&(reader, object.segment)) {
            description.unlock(lock_of(object), 1);
        }
    }

    /// What `reader` needs to map a forwarded segment.
    pub(crate) fn access(&self, reader: FederateId, number: u32) -> Option<SegmentAccess> {
        let segment = self.segments.values().find(|it| it.number == number)?;
        let description = self.descriptions.get(&(reader, number)).cloned();
        Some(SegmentAccess { view: Arc::clone(&segment.view), description })
    }

    /// The file on which the readers of a forwarded object lock its bytes.
    pub(crate) fn file(&self, serial: u64) -> Option<BorrowedFd<'_>> {
        self.objects.get(&serial).and_then(|object| object.view.fd())
    }

    /// Removes an object that no reader holds any more, and returns what was received.
    #[must_use = "a release is owed when it is dropped"]
    pub(crate) fn remove_object(&mut self, serial: u64) -> Option<Object> {
        let ForwardedObject { received, view, range } = self.objects.remove(&serial)?;
        self.serials.remove(&byte_range(&view, &range));
        if let Some(segment) = self.segments.get_mut(&(Arc::as_ptr(&view) as usize)) {
            segment.objects -= 1;
        }
        Some(received)
    }

    /// Forgets a reader whose link has closed.
    pub(crate) fn reader_lost(&mut self, reader: FederateId) {
        self.descriptions.retain(|(of, _), _| *of != reader);
    }

    /// Removes the segments from which no object is forwarded and that are not attached any more.
    /// Returns their numbers.
    pub(crate) fn retire(&mut self, is_attached: impl Fn(&Arc<SegmentView>) -> bool) -> Vec<u32> {
        let unused = |it: &ForwardedSegment| it.objects == 0 && !is_attached(&it.view);
        let retired: Vec<u32> =
            self.segments.values().filter(|it| unused(it)).map(|it| it.number).collect();
        self.segments.retain(|_, it| !retired.contains(&it.number));
        self.descriptions.retain(|(_, number), _| !retired.contains(number));
        retired
    }
}

/// What a reader needs to map a forwarded segment.
#[derive(Clone, Debug)]
pub(crate) struct SegmentAccess {
    pub(crate) view: Arc<SegmentView>,
    description: Option<Arc<FileDescription>>,
}

impl SegmentAccess {
    pub(crate) fn fd(&self) -> BorrowedFd<'_> {
        let description = self.description.as_ref().map(|description| description.fd());
        description.or(self.view.fd()).expect("a segment without a descriptor is not forwarded")
    }
}
