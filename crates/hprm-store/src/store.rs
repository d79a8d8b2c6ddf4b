//! The store of one federate: its own segments, and its views of other federates' segments.
//!
//! It ties the ledger to memory and never blocks. Frames, links and the passing of descriptors are
//! someone else's business: it says which segments a reader has to be told of, and which releases this
//! process owes, and is told the same by its peers.

#![forbid(unsafe_code)]

use std::collections::BTreeMap;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::sync::Arc;

use bytemuck::Pod;
use hprm_core::{FederateId, ObjectRef, WhenFull};

use crate::announce::Announcements;
use crate::forks::Forks;
use crate::ledger::{HoldError, Ledger, Loan, LoanError, StoreLimits, StoreStats};
use crate::loan::{LoanOf, WritableLoan};
use crate::object::{Bytes, Object, Releases};
use crate::passing::{Passing, Way, marks_behind};
use crate::returns::{Returns, Wake};
use crate::shm::{Segment, SegmentView, is_marked};
use crate::{SegmentError, StoreError};

/// How many descriptors of other federates' segments a store keeps, to pass their objects on. What
/// lies in further ones is copied: a process may have only so many descriptors.
const DESCRIPTORS: usize = 32;

/// A segment that a reader has to map: send its number, its length and its descriptor.
#[derive(Clone, Debug)]
pub struct Announcement {
    /// The segment.
    pub segment: u32,
    /// Its length in bytes.
    pub len: u64,
    memory: Announced,
}

#[derive(Clone, Debug)]
enum Announced {
    Own(Arc<Segment>),
    PassedOn(Way),
}

impl AsFd for Announcement {
    /// The descriptor to pass on; the memory stays as long as this value.
    fn as_fd(&self) -> BorrowedFd<'_> {
        match &self.memory {
            Announced::Own(segment) => segment.fd(),
            Announced::PassedOn(way) => way.fd(),
        }
    }
}

/// The object store of one federate.
///
/// As a sender: [`loan`](Self::loan), write, [`seal`](Self::seal) for the readers, tell each of them
/// of [`unannounced`](Self::unannounced) segments before the message that carries the reference, and
/// take their [`release`](Self::release)s. As a reader: [`attach`](Self::attach) what is announced,
/// [`open`](Self::open) each reference once for each time it arrives, drop the object, and send what
/// [`drain_releases`](Self::drain_releases) returns to the owners.
#[derive(Debug)]
pub struct Store {
    owner: FederateId,
    ledger: Ledger,
    announcements: Announcements,
    segments: BTreeMap<u32, Arc<Segment>>,
    attached: BTreeMap<(FederateId, u32), Arc<SegmentView>>,
    passing: Passing,
    /// Objects that a reader had when it was lost, and that others may have from it.
    lingering: Vec<ObjectRef>,
    /// Releases that other federates wait for.
    owed: Arc<Releases>,
    /// Views of own objects that have ended.
    ended: Arc<Releases>,
    /// Loans that were dropped.
    abandoned: Arc<Returns<Loan>>,
    /// The processes that this one has forked.
    forks: Arc<Forks>,
}

impl Store {
    /// The store of `owner`; it maps memory when the first loan needs it.
    #[must_use]
    pub fn new(owner: FederateId, limits: StoreLimits) -> Self {
        Self::build(owner, limits, None)
    }

    /// A store that calls `wake` when [`Self::drain_releases`] has something to return again.
    #[must_use]
    pub fn with_wake(owner: FederateId, limits: StoreLimits, wake: Wake) -> Self {
        Self::build(owner, limits, Some(wake))
    }

    fn build(owner: FederateId, limits: StoreLimits, wake: Option<Wake>) -> Self {
        let forks = Arc::new(Forks::default());
        Self {
            owner,
            ledger: Ledger::new(owner, limits),
            announcements: Announcements::default(),
            segments: BTreeMap::new(),
            attached: BTreeMap::new(),
            passing: Passing::default(),
            lingering: Vec::new(),
            owed: Arc::new(Releases::new(&forks, wake)),
            ended: Arc::new(Releases::new(&forks, None)),
            abandoned: Arc::new(Returns::new(None)),
            forks,
        }
    }

    /// `len` bytes to write; what they hold at first is arbitrary. A loan that is dropped at once
    /// maps the memory for the next of its size, which a program can so pay for at its start.
    ///
    /// # Errors
    ///
    /// [`StoreError::Full`] if the capacity is reached, [`StoreError::Segment`] if the system has no
    /// memory; then [`Self::fall_back`] says what to do.
    pub fn loan(&mut self, len: usize) -> Result<WritableLoan, StoreError> {
        self.settle();
        let asked = len as u64;
        let mut loan = self.ledger.loan(asked);
        if let Err(LoanError::NeedsSegment { len }) = loan {
            self.map_segment(len)?;
            loan = self.ledger.loan(asked);
        }
        let loan = loan.map_err(|error| match error {
            LoanError::Full { asked, capacity, in_use } => {
                StoreError::Full { owner: self.owner, asked, capacity, in_use }
            }
            LoanError::NeedsSegment { .. } => unreachable!("the loan fits the segment made for it"),
        })?;
        let segment = &self.segments[&loan.block().segment];
        let bytes = segment
            .writing(loan.block().offset, loan.len())
            .expect("the ledger loans no block that anyone in this process holds");
        Ok(WritableLoan::new(bytes, loan, Arc::clone(&self.abandoned)))
    }

    /// `count` values to write, of a type of which any bytes are a value; what they are at first is
    /// arbitrary.
    ///
    /// ```
    /// # use hprm_core::FederateId;
    /// # use hprm_store::{Store, StoreError, StoreLimits};
    /// # fn main() -> Result<(), StoreError> {
    /// let (me, reader) = (FederateId(0), FederateId(1));
    /// let mut store = Store::new(me, StoreLimits::default());
    /// let mut image = store.loan_of::<f32>(1_000_000)?;
    /// image.fill(0.5);
    /// // Published where it was computed: no byte is copied.
    /// let object = store.seal(image, &[reader]);
    /// assert_eq!((object.len, store.stats().bytes_copied), (4_000_000, 0));
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    ///
    /// As for [`Self::loan`]; and [`StoreError::Alignment`] if the values need more than 64 bytes.
    pub fn loan_of<T: Pod>(&mut self, count: usize) -> Result<LoanOf<T>, StoreError> {
        // More bytes than there are addresses fit in no store.
        let loan = self.loan(count.saturating_mul(size_of::<T>()))?;
        LoanOf::new(loan).ok_or(StoreError::Alignment { align: align_of::<T>() })
    }

    /// Whether the loan is of this store.
    #[must_use]
    pub fn has_lent(&self, loan: &WritableLoan) -> bool {
        loan.returns_to(&self.abandoned)
    }

    /// The most bytes that the store maps at a time.
    #[must_use]
    pub fn capacity(&self) -> u64 {
        self.ledger.capacity()
    }

    /// Ends a loan: nobody can write the bytes any more, and each of `readers` holds them; one that
    /// gets the object twice stands there twice. Put the owner among them if it keeps a view.
    ///
    /// # Panics
    ///
    /// If the loan is of another store.
    pub fn seal(&mut self, loan: impl Into<WritableLoan>, readers: &[FederateId]) -> ObjectRef {
        let object = self.ledger.seal(loan.into().into_loan(), readers);
        for reader in readers.iter().filter(|reader| **reader != self.owner) {
            self.announcements.need(*reader, object.segment);
        }
        object
    }

    /// Copies `bytes` into an object for `readers`: the only copy, however many they are.
    ///
    /// # Errors
    ///
    /// As for [`Self::loan`].
    pub fn put(&mut self, bytes: &[u8], readers: &[FederateId]) -> Result<ObjectRef, StoreError> {
        let mut loan = self.loan(bytes.len())?;
        loan.copy_from_slice(bytes);
        self.count_copy(bytes.len());
        Ok(self.seal(loan, readers))
    }

    /// Counts bytes that were copied into a loan, not computed in it.
    pub fn count_copy(&mut self, bytes: usize) {
        self.ledger.count_copy(bytes as u64);
    }

    /// What to do about a loan that was refused. To go on is to send the bytes inside the message, and
    /// is counted; the error comes back when that happens for the first time, to be told once.
    ///
    /// # Errors
    ///
    /// The one that was given, if the limits say so, or if it does not speak of a lack of memory.
    pub fn fall_back(&mut self, error: StoreError) -> Result<Option<StoreError>, StoreError> {
        let lack = matches!(
            error,
            StoreError::Full { .. } | StoreError::Segment(SegmentError::Create { .. })
        );
        if !lack || self.ledger.limits().when_full == WhenFull::Error {
            return Err(error);
        }
        let first = self.ledger.stats().inline_fallbacks == 0;
        self.ledger.count_inline_fallback();
        Ok(first.then_some(error))
    }

    /// The segments that `reader` must be told of before its next message; it counts as told.
    pub fn unannounced(&mut self, reader: FederateId) -> Vec<Announcement> {
        let due = self.announcements.take_due(reader).into_iter();
        due.map(|segment| {
            if let Some(memory) = self.segments.get(&segment) {
                let memory = Arc::clone(memory);
                return Announcement { segment, len: memory.len(), memory: Announced::Own(memory) };
            }
            let way = self.passing.way(reader, segment);
            let way = way.expect("what is announced is a segment that exists");
            Announcement { segment, len: way.view.len(), memory: Announced::PassedOn(way) }
        })
        .collect()
    }

    /// The segments that `reader` was told of and that are given up since the last call; it should
    /// [`detach`](Self::detach) them, else their memory is not free.
    pub fn retired(&mut self, reader: FederateId) -> Vec<u32> {
        self.announcements.take_retired(reader)
    }

    /// Maps a segment that another federate announced.
    ///
    /// # Errors
    ///
    /// [`StoreError::KnownSegment`] if the number is in use, [`StoreError::Segment`] if the memory
    /// cannot be mapped or is not safe to read.
    pub fn attach(
        &mut self,
        owner: FederateId,
        segment: u32,
        len: u64,
        fd: OwnedFd,
    ) -> Result<(), StoreError> {
        if owner == self.owner || self.attached.contains_key(&(owner, segment)) {
            return Err(StoreError::KnownSegment { owner, segment });
        }
        let mut view = SegmentView::map(fd, len)?;
        if self.attached.values().filter(|view| view.fd().is_some()).count() >= DESCRIPTORS {
            view.close();
        }
        self.attached.insert((owner, segment), Arc::new(view));
        Ok(())
    }

    /// Forgets a segment that its owner has given up; objects that are open keep it mapped.
    pub fn detach(&mut self, owner: FederateId, segment: u32) {
        self.attached.remove(&(owner, segment));
        self.retire_passed_on();
    }

    /// Opens an object that was sealed for this federate, its own included. Each call stands for one
    /// hold, which ends with the last clone of the object.
    ///
    /// # Errors
    ///
    /// If the reference lies in no known segment or outside of it, or, for an own object, if this
    /// federate has no hold on it that is not open yet.
    pub fn open(&mut self, object: ObjectRef) -> Result<Object, StoreError> {
        self.settle();
        if object.owner == self.owner {
            return self.open_own(object);
        }
        let view = self.attached.get(&(object.owner, object.segment));
        let view = view.ok_or(StoreError::UnknownSegment { object })?;
        let range = view.range(object.offset, object.len);
        let range = range.ok_or(StoreError::OutOfBounds { object })?;
        Ok(Object::new(object, Bytes::Foreign(Arc::clone(view), range), Arc::clone(&self.owed)))
    }

    fn open_own(&mut self, object: ObjectRef) -> Result<Object, StoreError> {
        self.ledger.view(&object)?;
        if let Some((view, range)) = self.passing.bytes(object.serial) {
            return Ok(Object::new(object, Bytes::Foreign(view, range), Arc::clone(&self.ended)));
        }
        let segment = &self.segments[&object.segment];
        let reading = segment
            .reading(object.offset, object.len)
            .expect("nobody in this process writes an object that is held");
        Ok(Object::new(object, Bytes::Own(reading), Arc::clone(&self.ended)))
    }

    /// Owes back a hold on an object that arrived and will not be opened.
    ///
    /// # Errors
    ///
    /// For an own object, if this federate has no hold on it that is not open.
    pub fn decline(&mut self, object: ObjectRef) -> Result<(), StoreError> {
        if object.owner == self.owner {
            return Ok(self.release(object.serial, self.owner)?);
        }
        self.owed.push(object);
        Ok(())
    }

    /// The object as one of this store, for readers to be added, whoever's it is: its bytes stay where
    /// they are, and its owner is owed nothing until all readers here have released it. None if the
    /// system does not allow that; then copy.
    #[must_use]
    pub fn pass_on(&mut self, came: &Object) -> Option<Object> {
        self.settle();
        if came.object_ref().owner == self.owner {
            return Some(came.clone());
        }
        let (view, range) = came.foreign()?;
        let of = came.object_ref();
        if let Some(serial) = self.passing.number_of(view, range) {
            self.ledger.add_view(serial).ok()?;
            let (view, range) = self.passing.bytes(serial)?;
            let segment = self.passing.segment_of(serial)?;
            let object = ObjectRef { owner: self.owner, serial, segment, ..of };
            let bytes = Bytes::Foreign(view, range);
            return Some(Object::new(object, bytes, Arc::clone(&self.ended)));
        }
        let segment = self.passing.export(view, of.segment)?;
        let object = self.ledger.pass_on(segment, of.offset, of.len);
        self.passing.keep(object.serial, came.clone(), view, range.clone());
        let bytes = Bytes::Foreign(Arc::clone(view), range.clone());
        Some(Object::new(object, bytes, Arc::clone(&self.ended)))
    }

    /// Gives `reader` a hold on an own object that someone holds: it was passed on to it.
    ///
    /// # Errors
    ///
    /// If nobody holds the object any more.
    pub fn add_reader(&mut self, serial: u64, reader: FederateId) -> Result<(), HoldError> {
        let object = self.ledger.add_reader(serial, reader)?;
        if reader != self.owner {
            self.announcements.need(reader, object.segment);
            self.passing.mark(&object, reader);
        }
        Ok(())
    }

    /// Takes the release that `reader` sent.
    ///
    /// # Errors
    ///
    /// If it holds no such object; nothing has changed then.
    pub fn release(&mut self, serial: u64, reader: FederateId) -> Result<(), HoldError> {
        let held = self.ledger.held(serial, reader);
        self.ledger.release(serial, reader)?;
        if let Some(object) = held.filter(|_| self.ledger.held(serial, reader).is_none()) {
            self.passing.unmark(&object, reader);
        }
        self.return_passed_on();
        Ok(())
    }

    /// Drops all holds of a reader whose link has closed, and what it was told. What it has passed on
    /// to others stays until they have given it up.
    pub fn reader_lost(&mut self, reader: FederateId) {
        self.passing.reader_lost(reader);
        let held: Vec<ObjectRef> = self.ledger.held_by(reader).collect();
        for object in held {
            if self.is_marked(&object) && self.ledger.add_view(object.serial).is_ok() {
                self.lingering.push(object);
            }
        }
        self.ledger.reader_lost(reader);
        self.announcements.forget(reader);
        self.return_passed_on();
    }

    /// Forgets all segments of an owner whose link has closed; objects that are open stay readable.
    pub fn owner_lost(&mut self, owner: FederateId) {
        self.attached.retain(|(of, _), _| *of != owner);
        self.retire_passed_on();
    }

    /// The releases that this process owes to other federates, each to its `owner`.
    pub fn drain_releases(&mut self) -> Vec<ObjectRef> {
        self.settle();
        self.owed.drain()
    }

    /// The processes that this one has forked: tell it before there is one more.
    pub(crate) fn forks(&self) -> &Arc<Forks> {
        &self.forks
    }

    /// What the store has done, and what it uses.
    pub fn stats(&mut self) -> StoreStats {
        self.settle();
        self.ledger.stats()
    }

    /// Enters into the books what was dropped since the last time.
    fn settle(&mut self) {
        for loan in self.abandoned.drain() {
            self.ledger.abandon(loan);
        }
        for object in self.ended.drain() {
            self.ledger.end_view(object.serial);
        }
        for object in std::mem::take(&mut self.lingering) {
            if self.is_marked(&object) {
                self.lingering.push(object);
            } else {
                self.ledger.end_view(object.serial);
            }
        }
        self.return_passed_on();
    }

    /// Whether somebody reads an object who has it from one of its readers.
    fn is_marked(&self, object: &ObjectRef) -> bool {
        let own = self.segments.get(&object.segment).map(|segment| segment.fd());
        let file = self.passing.file(object.serial).or(own);
        let (from, len) = marks_behind(object);
        file.is_some_and(|file| is_marked(file, from, len))
    }

    /// Owes back what was passed on and is not held any more.
    fn return_passed_on(&mut self) {
        let returned = self.ledger.take_returned();
        if returned.is_empty() {
            return;
        }
        for serial in returned {
            drop(self.passing.end(serial));
        }
        self.retire_passed_on();
    }

    fn retire_passed_on(&mut self) {
        let attached = &self.attached;
        let is_attached =
            |view: &Arc<SegmentView>| attached.values().any(|other| Arc::ptr_eq(view, other));
        for segment in self.passing.retire(is_attached) {
            self.announcements.retire(segment);
        }
    }

    /// Gives up what the ledger has retired, then maps `len` bytes more.
    fn map_segment(&mut self, len: u64) -> Result<(), SegmentError> {
        for segment in self.ledger.take_retired() {
            self.segments.remove(&segment);
            self.announcements.retire(segment);
        }
        let memory = Arc::new(Segment::create(len)?);
        let segment = self.ledger.add_segment(len);
        self.segments.insert(segment, memory);
        Ok(())
    }
}

#[cfg(test)]
mod tests;
