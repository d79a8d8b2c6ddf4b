//! Objects of other federates that this one passes on, without touching their bytes.
//!
//! To its readers they are objects of its own: they map a segment under its number, and release to it.
//! It holds what it was given until all of them have; only then it releases to whom it has it from. So
//! nobody needs to know, or to reach, anybody else than who has sent him something.
//!
//! If it ends before its readers, they go on reading. Nobody would tell the owner of the memory, so
//! each of them has a [`Passage`] on which its objects are marked, and an owner that loses a
//! reader looks for marks before it writes there again. Counting holds is the ledger's business.

#![forbid(unsafe_code)]

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::ops::Range;
use std::os::fd::BorrowedFd;
use std::sync::Arc;

use hprm_core::{FederateId, ObjectRef};

use crate::Object;
use crate::shm::{Passage, SegmentView};

/// What is passed on, and under which names.
#[derive(Debug, Default)]
pub(crate) struct Passing {
    /// By the address of the view, which stays where it is as long as it is in here.
    segments: BTreeMap<usize, Exported>,
    /// The objects as they came, by the number that they have here.
    objects: BTreeMap<u64, Passed>,
    /// The numbers here of objects that came.
    numbers: BTreeMap<(FederateId, u64), u64>,
    /// The ways of readers to segments, by their numbers here.
    passages: BTreeMap<(FederateId, u32), Arc<Passage>>,
    /// How many numbers of segments are in use or were; they are given from the last one down, because
    /// those of segments of its own are given from the first one up.
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

impl Passing {
    /// The number that an object which came has here, if it is being passed on already.
    pub(crate) fn number_of(&self, came: &ObjectRef, view: &Arc<SegmentView>) -> Option<u64> {
        let number = self.numbers.get(&(came.owner, came.serial))?;
        // Its owner may have come back, and count anew.
        let same = |it: &&Passed| Arc::ptr_eq(&it.view, view) && it.came.object_ref() == *came;
        self.objects.get(number).filter(same).map(|_| *number)
    }

    /// The number of the segment of a view; none if its readers could not be protected.
    pub(crate) fn export(&mut self, view: &Arc<SegmentView>) -> Option<u32> {
        let key = Arc::as_ptr(view) as usize;
        if let Some(exported) = self.segments.get(&key) {
            return Some(exported.number);
        }
        // Here rather than later, when it is too late for a copy.
        if !Passage::to(view.fd()?).is_ok_and(|passage| passage.mark(0, 1)) {
            return None;
        }
        let number = u32::MAX - self.exported;
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
        let of = came.object_ref();
        self.numbers.insert((of.owner, of.serial), serial);
        self.objects.insert(serial, Passed { came, view: Arc::clone(view), range });
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
        passage.mark(object.offset, object.len);
    }

    /// Takes the mark away: `reader` has released the object.
    pub(crate) fn unmark(&self, object: &ObjectRef, reader: FederateId) {
        if let Some(passage) = self.passages.get(&(reader, object.segment)) {
            passage.unmark(object.offset, object.len);
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
        let Passed { came, view, .. } = self.objects.remove(&serial)?;
        let of = came.object_ref();
        if self.numbers.get(&(of.owner, of.serial)) == Some(&serial) {
            self.numbers.remove(&(of.owner, of.serial));
        }
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
