//! Objects of other federates that this one passes on, without touching their bytes.
//!
//! To its readers they are objects of its own: they map a segment under its number, and release to it.
//! It holds what it was given until all of them have; only then it releases to whom it has it from. So
//! nobody needs to know, or to reach, anybody else than who has sent him something.
//!
//! If it ends before its readers, they go on reading. Nobody would tell the owner of the memory, so
//! each of them has a [`Passage`] on which its objects are marked, and an owner that loses a
//! reader looks for marks before it writes there again. A mark tells how many hands an object has gone
//! through: whoever looks wants to know of those behind the lost reader, not of those before him, who
//! wait for him in turn. Counting holds is the ledger's business.

#![forbid(unsafe_code)]

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::ops::Range;
use std::os::fd::BorrowedFd;
use std::sync::Arc;

use hprm_core::{FederateId, ObjectRef};

use crate::Object;
use crate::shm::{Passage, SegmentView};

/// A segment's number begins with how often it was passed on, in as many bits as are left.
const COUNTER_BITS: u32 = 26;

/// How often an object may be passed on without a copy: there is a byte for each mark, in the smallest
/// block that an owner uses.
const MOST_HANDS: u32 = 62;

/// Through how many hands a segment has gone on its way from its owner to the one who calls it so.
fn hands(segment: u32) -> u32 {
    segment >> COUNTER_BITS
}

/// Where the readers of an object behind those who have it from here mark it: from which byte on, and
/// how many bytes.
pub(crate) fn marks_behind(object: &ObjectRef) -> (u64, u64) {
    let next = u64::from(hands(object.segment)) + 1;
    (object.offset + next, u64::from(MOST_HANDS) + 1 - next.min(u64::from(MOST_HANDS)))
}

/// The byte that is marked for a reader of an object that is passed on.
fn mark_of(object: &ObjectRef) -> u64 {
    object.offset + u64::from(hands(object.segment))
}

/// What is passed on, and under which names.
#[derive(Debug, Default)]
pub(crate) struct Passing {
    /// By the address of the view, which stays where it is as long as it is in here.
    segments: BTreeMap<usize, Exported>,
    /// The objects as they came, by the number that they have here.
    objects: BTreeMap<u64, Passed>,
    /// The numbers here of objects, by where their bytes are. One that comes again, perhaps by another
    /// way, is passed on under the number that it has: if it had two, and came back from a reader of
    /// the first one, each could wait for the other to end.
    numbers: BTreeMap<Place, u64>,
    /// The ways of readers to segments, by their numbers here.
    passages: BTreeMap<(FederateId, u32), Arc<Passage>>,
    /// How many numbers of segments are in use or were.
    exported: u32,
}

#[derive(Debug)]
struct Exported {
    number: u32,
    view: Arc<SegmentView>,
    objects: usize,
}

#[derive(Debug)]
struct Passed {
    came: Object,
    view: Arc<SegmentView>,
    range: Range<usize>,
}

/// A segment, and a range of bytes in it.
type Place = ((u64, u64), usize, usize);

fn place(view: &SegmentView, range: &Range<usize>) -> Place {
    (view.identity(), range.start, range.end)
}

impl Passing {
    /// The number that some bytes have here, if they are being passed on already.
    pub(crate) fn number_of(&self, view: &SegmentView, range: &Range<usize>) -> Option<u64> {
        self.numbers.get(&place(view, range)).copied()
    }

    /// The number of the segment of a view, which came as `segment`; none if its readers could not be
    /// protected.
    pub(crate) fn export(&mut self, view: &Arc<SegmentView>, segment: u32) -> Option<u32> {
        let key = Arc::as_ptr(view) as usize;
        if let Some(exported) = self.segments.get(&key) {
            return Some(exported.number);
        }
        // Here rather than later, when it is too late for a copy.
        if !Passage::to(view.fd()?).is_ok_and(|passage| passage.mark(0, 1)) {
            return None;
        }
        let hands = hands(segment) + 1;
        if hands > MOST_HANDS || self.exported >> COUNTER_BITS != 0 {
            return None;
        }
        let number = hands << COUNTER_BITS | self.exported;
        self.exported += 1;
        self.segments.insert(key, Exported { number, view: Arc::clone(view), objects: 0 });
        Some(number)
    }

    /// Keeps an object that is passed on as `serial`.
    pub(crate) fn keep(
        &mut self,
        serial: u64,
        came: Object,
        view: &Arc<SegmentView>,
        range: Range<usize>,
    ) {
        let exported = self.segments.get_mut(&(Arc::as_ptr(view) as usize));
        exported.expect("its segment was exported before").objects += 1;
        self.numbers.insert(place(view, &range), serial);
        self.objects.insert(serial, Passed { came, view: Arc::clone(view), range });
    }

    /// The segment of an object that is passed on.
    pub(crate) fn segment_of(&self, serial: u64) -> Option<u32> {
        let passed = self.objects.get(&serial)?;
        Some(self.segments.get(&(Arc::as_ptr(&passed.view) as usize))?.number)
    }

    /// Where the bytes of an object are that is passed on.
    pub(crate) fn bytes(&self, serial: u64) -> Option<(Arc<SegmentView>, Range<usize>)> {
        let passed = self.objects.get(&serial)?;
        Some((Arc::clone(&passed.view), passed.range.clone()))
    }

    /// Marks an object as in use by `reader`, if it is one that is passed on.
    pub(crate) fn mark(&mut self, object: &ObjectRef, reader: FederateId) {
        let Some(passed) = self.objects.get(&object.serial) else { return };
        let Some(file) = passed.view.fd() else { return };
        let key = (reader, object.segment);
        let passage = match self.passages.entry(key) {
            Entry::Occupied(entry) => entry.into_mut(),
            // Without one, the reader gets the way by which the segment came.
            Entry::Vacant(entry) => match Passage::to(file) {
                Ok(passage) => entry.insert(Arc::new(passage)),
                Err(_) => return,
            },
        };
        passage.mark(mark_of(object), 1);
    }

    /// Takes the mark away: `reader` has released the object.
    pub(crate) fn unmark(&self, object: &ObjectRef, reader: FederateId) {
        if let Some(passage) = self.passages.get(&(reader, object.segment)) {
            passage.unmark(mark_of(object), 1);
        }
    }

    /// What `reader` needs to map a segment that is passed on.
    pub(crate) fn way(&self, reader: FederateId, number: u32) -> Option<Way> {
        let exported = self.segments.values().find(|it| it.number == number)?;
        let passage = self.passages.get(&(reader, number)).cloned();
        Some(Way { view: Arc::clone(&exported.view), passage })
    }

    /// Where to look for marks on the memory of an object that is passed on.
    pub(crate) fn file(&self, serial: u64) -> Option<BorrowedFd<'_>> {
        self.objects.get(&serial).and_then(|passed| passed.view.fd())
    }

    /// Ends the passing on of an object that no reader holds any more.
    #[must_use = "dropping it owes its release"]
    pub(crate) fn end(&mut self, serial: u64) -> Option<Object> {
        let Passed { came, view, range } = self.objects.remove(&serial)?;
        self.numbers.remove(&place(&view, &range));
        if let Some(exported) = self.segments.get_mut(&(Arc::as_ptr(&view) as usize)) {
            exported.objects -= 1;
        }
        Some(came)
    }

    /// Forgets a reader that is gone.
    pub(crate) fn reader_lost(&mut self, reader: FederateId) {
        self.passages.retain(|(of, _), _| *of != reader);
    }

    /// Forgets the segments from which nothing is passed on, and of which `is_attached` says that
    /// nothing more will come. Returns their numbers.
    pub(crate) fn retire(&mut self, is_attached: impl Fn(&Arc<SegmentView>) -> bool) -> Vec<u32> {
        let over = |it: &Exported| it.objects == 0 && !is_attached(&it.view);
        let retired: Vec<u32> =
            self.segments.values().filter(|it| over(it)).map(|it| it.number).collect();
        self.segments.retain(|_, it| !retired.contains(&it.number));
        self.passages.retain(|(_, number), _| !retired.contains(number));
        retired
    }
}

/// A reader's way to a segment that is passed on.
#[derive(Clone, Debug)]
pub(crate) struct Way {
    pub(crate) view: Arc<SegmentView>,
    passage: Option<Arc<Passage>>,
}

impl Way {
    pub(crate) fn fd(&self) -> BorrowedFd<'_> {
        let passage = self.passage.as_ref().map(|passage| passage.fd());
        passage.or(self.view.fd()).expect("a segment without a descriptor is not exported")
    }
}
