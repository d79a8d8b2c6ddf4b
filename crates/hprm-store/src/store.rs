//! The store of one federate: its own segments, and its views of other federates' segments.
//!
//! It ties the ledger to memory and never blocks. The driver sends and receives frames and descriptors:
//! the store returns the segments that have to be announced to a reader and the releases that this
//! process owes, and the driver passes it those of its peers.

#![forbid(unsafe_code)]

use std::collections::BTreeMap;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::sync::Arc;

use bytemuck::Pod;
use hprm_core::{FederateId, ObjectRef, WhenFull};

use crate::announcements::Announcements;
use crate::drop_queue::{DropQueue, Wake};
use crate::forks::Forks;
use crate::forwarding::{Forwarding, SegmentAccess, locks_of_later_hops};
use crate::ledger::{HoldError, Ledger, Loan, LoanError, StoreLimits, StoreStats};
use crate::loan::{LoanOf, WritableLoan};
use crate::object::{Bytes, Object, ReleaseQueue};
use crate::shm::{Segment, SegmentView, is_locked};
use crate::{SegmentError, StoreError};

/// How many descriptors of other federates' segments a store keeps, to forward their objects. Objects in
/// further segments are copied: the number of descriptors of a process is limited.
const MAX_DESCRIPTORS: usize = 32;

/// A segment that a reader has to map: send its number, its length and its descriptor.
#[derive(Clone, Debug)]
pub struct Announcement {
    /// The segment.
    pub segment: u32,
    /// Its length in bytes.
    pub len: u64,
    memory: AnnouncedMemory,
}

#[derive(Clone, Debug)]
enum AnnouncedMemory {
    Own(Arc<Segment>),
    Forwarded(SegmentAccess),
}

impl AsFd for Announcement {
    /// The descriptor to send; the memory stays as long as this value.
    fn as_fd(&self) -> BorrowedFd<'_> {
        match &self.memory {
            AnnouncedMemory::Own(segment) => segment.fd(),
            AnnouncedMemory::Forwarded(access) => access.fd(),
        }
    }
}

/// What has been dropped, and the store does not know yet.
#[derive(Debug)]
pub(crate) struct Drops {
    owed: Arc<ReleaseQueue>,
    ended: Arc<ReleaseQueue>,
    abandoned: Arc<DropQueue<Loan>>,
}

impl Drops {
    /// Whether there may be any. Asking takes no lock.
    pub(crate) fn may_have_entries(&self) -> bool {
        self.abandoned.may_have_entries() || self.ended.may_be_due() || self.owed.may_be_due()
    }
}

/// The object store of one federate.
///
/// As a sender: [`loan`](Self::loan), write, [`seal`](Self::seal) for the readers, send each of them
/// the [`unannounced`](Self::unannounced) segments before the message that carries the reference, and
/// enter their [`release`](Self::release)s. As a reader: [`attach`](Self::attach) what is announced,
/// [`open`](Self::open) each reference once for each time it arrives, drop the object, and send what
/// [`drain_releases`](Self::drain_releases) returns to the owners.
#[derive(Debug)]
pub struct Store {
    owner: FederateId,
    ledger: Ledger,
    announcements: Announcements,
    segments: BTreeMap<u32, Arc<Segment>>,
    attached: BTreeMap<(FederateId, u32), Arc<SegmentView>>,
    forwarding: Forwarding,
    /// Objects that a lost reader held and may have forwarded to other federates.
    lingering: Vec<ObjectRef>,
    /// Releases that this process owes to other federates.
    owed: Arc<ReleaseQueue>,
    /// Views of own objects that have ended.
    ended: Arc<ReleaseQueue>,
    /// Loans that were dropped.
    abandoned: Arc<DropQueue<Loan>>,
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
            forwarding: Forwarding::default(),
            lingering: Vec::new(),
            owed: Arc::new(ReleaseQueue::new(&forks, wake)),
            ended: Arc::new(ReleaseQueue::new(&forks, None)),
            abandoned: Arc::new(DropQueue::new(None)),
            forks,
        }
    }

    /// `len` bytes to write, with arbitrary content at first. A program that loans and drops at its start
    /// has the memory for later loans of that size mapped then.
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
            .borrow_mut(loan.block().offset, loan.len())
            .expect("the ledger loans no block that is borrowed in this process");
        Ok(WritableLoan::new(bytes, loan, Arc::clone(&self.abandoned)))
    }

    /// `count` values to write, of a type of which any bytes are a value, with arbitrary content at
    /// first.
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
        // A length that is too large for an address space is refused as too large for the store.
        let loan = self.loan(count.saturating_mul(size_of::<T>()))?;
        LoanOf::new(loan).ok_or(StoreError::Alignment { align: align_of::<T>() })
    }

    /// Whether the loan is of this store.
    #[must_use]
    pub fn owns_loan(&self, loan: &WritableLoan) -> bool {
        loan.is_dropped_to(&self.abandoned)
    }

    /// The most bytes that the store maps at a time.
    #[must_use]
    pub fn capacity(&self) -> u64 {
        self.ledger.capacity()
    }

    /// Ends a loan: the bytes cannot be written any more, and each of `readers` holds them. A reader that
    /// gets the object twice is listed twice, and the owner is listed if it keeps a view.
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

    /// Ends a loan, and returns its object with a hold of this federate. Readers are added when it is sent.
    ///
    /// # Panics
    ///
    /// If the loan is of another store.
    pub fn publish(&mut self, loan: impl Into<WritableLoan>) -> Object {
        let object = self.seal(loan, &[self.owner]);
        self.open(object).expect("this federate holds what it has just sealed")
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

    /// Decides what happens after a loan was refused. If it returns no error, the bytes travel inside the
    /// message, which is counted. The first time, it returns the error in `Ok`, to be reported once.
    ///
    /// # Errors
    ///
    /// `error`, if the limits say so, or if its cause is not a lack of memory.
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

    /// The segments that must be announced to `reader` before its next message; from now on they count as
    /// announced.
    pub fn unannounced(&mut self, reader: FederateId) -> Vec<Announcement> {
        let due = self.announcements.take_due(reader).into_iter();
        due.map(|segment| {
            if let Some(memory) = self.segments.get(&segment) {
                let memory = Arc::clone(memory);
                return Announcement {
                    segment,
                    len: memory.len(),
                    memory: AnnouncedMemory::Own(memory),
                };
            }
            let access = self.forwarding.access(reader, segment);
            let access = access.expect("what is announced is a segment that exists");
            let len = access.view.len();
            Announcement { segment, len, memory: AnnouncedMemory::Forwarded(access) }
        })
        .collect()
    }

    /// The segments that were announced to `reader` and retired since the last call; it should
    /// [`detach`](Self::detach) them, otherwise their memory is not freed.
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
        if self.attached.values().filter(|view| view.fd().is_some()).count() >= MAX_DESCRIPTORS {
            view.close();
        }
        self.attached.insert((owner, segment), Arc::new(view));
        Ok(())
    }

    /// Forgets a segment that its owner has retired; objects that are open keep it mapped.
    pub fn detach(&mut self, owner: FederateId, segment: u32) {
        self.attached.remove(&(owner, segment));
        self.retire_forwarded();
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
        if let Some((view, range)) = self.forwarding.bytes(object.serial) {
            return Ok(Object::new(object, Bytes::Foreign(view, range), Arc::clone(&self.ended)));
        }
        let segment = &self.segments[&object.segment];
        let borrow = segment
            .borrow(object.offset, object.len)
            .expect("an object that is held is not borrowed for writing");
        Ok(Object::new(object, Bytes::Own(borrow), Arc::clone(&self.ended)))
    }

    /// Releases an object that was received and will not be opened.
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

    /// The object as one of this store, to which readers can be added. Its bytes stay where they are, and
    /// it is released to its owner when all readers here have released it. None if the system does not
    /// allow that; then copy.
    #[must_use]
    pub fn forward(&mut self, received: &Object) -> Option<Object> {
        self.settle();
        let of = received.object_ref();
        if of.owner == self.owner {
            return Some(received.clone());
        }
        let (view, range) = received.foreign()?;
        if let Some(serial) = self.forwarding.serial_of(view, range) {
            self.ledger.add_view(serial).ok()?;
            let (view, range) = self.forwarding.bytes(serial)?;
            let segment = self.forwarding.segment_of(serial)?;
            let object = ObjectRef { owner: self.owner, serial, segment, ..of };
            let bytes = Bytes::Foreign(view, range);
            return Some(Object::new(object, bytes, Arc::clone(&self.ended)));
        }
        let segment = self.forwarding.add_segment(view, of.segment)?;
        let object = self.ledger.forward(segment, of.offset, of.len);
        self.forwarding.add_object(object.serial, received.clone(), view, range.clone());
        let bytes = Bytes::Foreign(Arc::clone(view), range.clone());
        Some(Object::new(object, bytes, Arc::clone(&self.ended)))
    }

    /// Adds a hold of `reader` to an own object that is held, because it is sent to that reader too.
    ///
    /// # Errors
    ///
    /// If the object is not held any more.
    pub fn add_reader(&mut self, serial: u64, reader: FederateId) -> Result<(), HoldError> {
        let object = self.ledger.add_reader(serial, reader)?;
        if reader != self.owner {
            self.announcements.need(reader, object.segment);
            self.forwarding.lock(&object, reader);
        }
        Ok(())
    }

    /// Enters a release that `reader` sent.
    ///
    /// # Errors
    ///
    /// If the reader holds no such object; nothing has changed then.
    pub fn release(&mut self, serial: u64, reader: FederateId) -> Result<(), HoldError> {
        let held = self.ledger.held(serial, reader);
        self.ledger.release(serial, reader)?;
        if let Some(object) = held.filter(|_| self.ledger.held(serial, reader).is_none()) {
            self.forwarding.unlock(&object, reader);
        }
        self.return_forwarded();
        Ok(())
    }

    /// Ends all holds of a reader whose link has closed, and forgets which segments it knows. Objects that
    /// it has forwarded stay until the federates behind it have dropped them.
    pub fn reader_lost(&mut self, reader: FederateId) {
        self.forwarding.reader_lost(reader);
        let held: Vec<ObjectRef> = self.ledger.held_by(reader).collect();
        for object in held {
            if self.is_locked(&object) && self.ledger.add_view(object.serial).is_ok() {
                self.lingering.push(object);
            }
        }
        self.ledger.reader_lost(reader);
        self.announcements.forget(reader);
        self.return_forwarded();
    }

    /// Forgets all segments of an owner whose link has closed; objects that are open stay readable.
    pub fn owner_lost(&mut self, owner: FederateId) {
        self.attached.retain(|(of, _), _| *of != owner);
        self.retire_forwarded();
    }

    /// The releases that this process owes to other federates, each to its `owner`.
    pub fn drain_releases(&mut self) -> Vec<ObjectRef> {
        // Mostly nothing has changed, and the loop asks several times at each tag.
        if !self.has_changed() {
            return Vec::new();
        }
        self.settle();
        self.owed.drain()
    }

    /// The processes that this one has forked; it must be told before each further fork.
    pub(crate) fn forks(&self) -> &Arc<Forks> {
        &self.forks
    }

    /// What the store has done, and what it uses.
    pub fn stats(&mut self) -> StoreStats {
        self.settle();
        self.ledger.stats()
    }

    /// [`StoreStats::bytes_copied`], without what the rest of [`Self::stats`] costs.
    #[must_use]
    pub fn bytes_copied(&self) -> u64 {
        self.ledger.bytes_copied()
    }

    /// How many bytes each reader holds. An object that several hold counts for each of them.
    #[must_use]
    pub fn held(&self) -> BTreeMap<FederateId, u64> {
        self.ledger.held_bytes()
    }

    /// Whether anything was dropped since the last call of [`Self::settle`], or may have ended without a word.
    pub(crate) fn has_changed(&self) -> bool {
        self.abandoned.may_have_entries()
            || self.ended.may_be_due()
            || self.owed.may_be_due()
            || !self.lingering.is_empty()
            || self.ledger.has_returned()
    }

    /// Where drops are noted, which any thread may look at without the store.
    pub(crate) fn drops(&self) -> Drops {
        let Self { owed, ended, abandoned, .. } = self;
        Drops { owed: Arc::clone(owed), ended: Arc::clone(ended), abandoned: Arc::clone(abandoned) }
    }

    /// Enters into the ledger what was dropped since the last call.
    fn settle(&mut self) {
        for loan in self.abandoned.drain() {
            self.ledger.abandon(loan);
        }
        for object in self.ended.drain() {
            self.ledger.end_view(object.serial);
        }
        for object in std::mem::take(&mut self.lingering) {
            if self.is_locked(&object) {
                self.lingering.push(object);
            } else {
                self.ledger.end_view(object.serial);
            }
        }
        self.return_forwarded();
    }

    /// Whether a federate reads the object to which one of its readers has forwarded it.
    fn is_locked(&self, object: &ObjectRef) -> bool {
        let own = self.segments.get(&object.segment).map(|segment| segment.fd());
        let file = self.forwarding.file(object.serial).or(own);
        let (from, len) = locks_of_later_hops(object);
        file.is_some_and(|file| is_locked(file, from, len))
    }

    /// Releases forwarded objects that are not held here any more.
    fn return_forwarded(&mut self) {
        let returned = self.ledger.take_returned();
        if returned.is_empty() {
            return;
        }
        for serial in returned {
            drop(self.forwarding.remove_object(serial));
        }
        self.retire_forwarded();
    }

    fn retire_forwarded(&mut self) {
        let attached = &self.attached;
        let is_attached =
            |view: &Arc<SegmentView>| attached.values().any(|other| Arc::ptr_eq(view, other));
        for segment in self.forwarding.retire(is_attached) {
            self.announcements.retire(segment);
        }
    }

    /// Removes the segments that the ledger has retired, then maps `len` bytes more.
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
