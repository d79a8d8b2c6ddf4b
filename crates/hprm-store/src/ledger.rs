//! The record of a store: loans that are being written, and objects that readers hold.
//!
//! Plain data, and the only copy of it: the owner alone changes it, and readers send their releases as
//! messages. It touches no memory; when it needs a segment it returns an error that says so, and the
//! store maps one.

#![forbid(unsafe_code)]

use std::collections::BTreeMap;

use hprm_core::{FederateId, ObjectRef, WhenFull};

use crate::arena::{Arena, Block, PAGE};

/// Segments grow in steps of this many bytes, the size of a huge page.
const STEP: u64 = 2 << 20;

/// How much memory a store may use.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub struct StoreLimits {
    /// The most bytes that are mapped at a time.
    pub capacity_bytes: u64,
    /// The least bytes of a segment, unless the capacity leaves fewer.
    pub segment_min_bytes: u64,
    /// What happens to a value for which there is no room.
    pub when_full: WhenFull,
}

impl Default for StoreLimits {
    fn default() -> Self {
        Self { capacity_bytes: 2 << 30, segment_min_bytes: 16 << 20, when_full: WhenFull::Inline }
    }
}

/// What a store has done, and what it uses.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Default)]
pub struct StoreStats {
    /// Objects sealed since the start.
    pub objects_sealed: u64,
    /// Objects of other federates that were forwarded since the start.
    pub objects_passed_on: u64,
    /// Bytes copied into objects since the start; what is computed in place is not counted.
    pub bytes_copied: u64,
    /// Bytes of blocks that are loaned or held now.
    pub bytes_in_use: u64,
    /// Bytes of the segments now.
    pub bytes_mapped: u64,
    /// The number of segments now.
    pub segments: u32,
    /// Payloads that travelled inline because the store was full.
    pub inline_fallbacks: u64,
    /// Requests to the [`StoreAllocator`](crate::StoreAllocator) that were refused, because values that
    /// are not published use its share of the store. The allocator counts them, not the ledger.
    pub heap_fallbacks: u64,
    /// Holds that readers released.
    pub releases: u64,
}

/// Why there is no loan.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum LoanError {
    /// Map a segment of `len` bytes, call [`Ledger::add_segment`] and ask again.
    #[error("a segment of {len} bytes has to be mapped first")]
    NeedsSegment {
        /// Its length in bytes.
        len: u64,
    },
    /// The capacity is reached.
    #[error("{asked} bytes do not fit: {in_use} bytes of at most {capacity} are in use")]
    Full {
        /// The length that was asked for.
        asked: u64,
        /// The most bytes that may be mapped.
        capacity: u64,
        /// Bytes that are loaned or held.
        in_use: u64,
    },
}

/// Why a hold cannot be changed.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum HoldError {
    /// No reader holds such an object: all have released it, or it never existed.
    #[error("no federate holds object {serial} of this store")]
    UnknownObject {
        /// The number of the object.
        serial: u64,
    },
    /// The object is held, but not by that reader.
    #[error("federate {} does not hold object {serial}", reader.0)]
    NotHolding {
        /// The number of the object.
        serial: u64,
        /// The federate that should hold it.
        reader: FederateId,
    },
}

/// A block that is being written. It is sealed as an object, or abandoned; it cannot be cloned.
#[derive(PartialEq, Eq, Hash, Debug)]
#[must_use = "a loan keeps its block until it is sealed or abandoned"]
pub struct Loan {
    owner: FederateId,
    serial: u64,
    block: Block,
    len: u64,
}

impl Loan {
    /// The block; it may be longer than the loan.
    #[must_use]
    pub fn block(&self) -> Block {
        self.block
    }

    /// The length that was asked for, in bytes.
    #[must_use]
    pub fn len(&self) -> u64 {
        self.len
    }

    /// Whether no byte was asked for.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }
}

/// A sealed object and its holds.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
struct Sealed {
    block: Block,
    len: u64,
    /// Holds of each reader: one for each time that the object is sent to it.
    readers: BTreeMap<FederateId, u32>,
    /// Holds of the owner that have become views in its process.
    views: u32,
    /// Whether the bytes are another federate's, and this store forwards them.
    foreign: bool,
}

impl Sealed {
    fn is_held(&self) -> bool {
        self.views > 0 || !self.readers.is_empty()
    }

    fn object(&self, owner: FederateId, serial: u64) -> ObjectRef {
        let Block { segment, offset, .. } = self.block;
        ObjectRef { owner, serial, segment, offset, len: self.len }
    }

    /// Ends one hold of `reader`; false if it has none.
    fn end_hold(&mut self, reader: FederateId) -> bool {
        let Some(holds) = self.readers.get_mut(&reader) else { return false };
        *holds -= 1;
        if *holds == 0 {
            self.readers.remove(&reader);
        }
        true
    }
}

/// The record of all loans, objects and holds of one federate's store.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub struct Ledger {
    owner: FederateId,
    limits: StoreLimits,
    arena: Arena,
    loaned: BTreeMap<u64, Block>,
    sealed: BTreeMap<u64, Sealed>,
    next_serial: u64,
    retired: Vec<u32>,
    /// Foreign objects that no reader holds any more.
    returned: Vec<u64>,
    stats: StoreStats,
}

impl Ledger {
    /// The ledger of `owner`'s store, without segments.
    #[must_use]
    pub fn new(owner: FederateId, limits: StoreLimits) -> Self {
        Self {
            owner,
            limits,
            arena: Arena::new(),
            loaned: BTreeMap::new(),
            sealed: BTreeMap::new(),
            next_serial: 0,
            retired: Vec::new(),
            returned: Vec::new(),
            stats: StoreStats::default(),
        }
    }

    /// How much memory the store may use.
    #[must_use]
    pub fn limits(&self) -> StoreLimits {
        self.limits
    }

    /// What the store has done, and what it uses.
    #[must_use]
    pub fn stats(&self) -> StoreStats {
        self.stats
    }

    /// The most bytes that may be mapped.
    #[must_use]
    pub fn capacity(&self) -> u64 {
        self.limits.capacity_bytes
    }

    /// Bytes copied into objects since the start.
    pub(crate) fn bytes_copied(&self) -> u64 {
        self.stats.bytes_copied
    }

    /// Counts bytes that were copied into a loan.
    pub fn count_copy(&mut self, bytes: u64) {
        self.stats.bytes_copied += bytes;
    }

    /// Counts a payload that travelled inline because the store was full.
    pub fn count_inline_fallback(&mut self) {
        self.stats.inline_fallbacks += 1;
    }

    /// A block of `len` bytes to write.
    ///
    /// # Errors
    ///
    /// [`LoanError::NeedsSegment`] if more memory has to be mapped, which may retire segments (see
    /// [`Self::take_retired`]); [`LoanError::Full`] if that would exceed the capacity.
    pub fn loan(&mut self, len: u64) -> Result<Loan, LoanError> {
        let Some(block) = self.arena.alloc(len) else { return Err(self.make_room(len)) };
        let serial = self.next_serial;
        self.next_serial += 1;
        self.loaned.insert(serial, block);
        self.stats.bytes_in_use += block.len;
        Ok(Loan { owner: self.owner, serial, block, len })
    }

    /// Adds a segment that the store has mapped, and returns its number.
    pub fn add_segment(&mut self, len: u64) -> u32 {
        self.stats.segments += 1;
        self.stats.bytes_mapped += len;
        self.arena.add_segment(len)
    }

    /// The segments that were retired since the last call, to make room for others. Nothing in them is
    /// loaned or held, and their numbers are never used again.
    pub fn take_retired(&mut self) -> Vec<u32> {
        std::mem::take(&mut self.retired)
    }

    /// Ends a loan: from now on the bytes do not change until every reader has released them. A
    /// federate that appears twice among `readers` has to release twice; the owner may be one of
    /// them. Without readers the block is free at once.
    ///
    /// # Panics
    ///
    /// If the loan is of another ledger.
    pub fn seal(&mut self, loan: Loan, readers: &[FederateId]) -> ObjectRef {
        let Loan { serial, len, .. } = loan;
        let block = self.end_loan(loan);
        let mut sealed = Sealed { block, len, readers: BTreeMap::new(), views: 0, foreign: false };
        for reader in readers {
            *sealed.readers.entry(*reader).or_default() += 1;
        }
        let object = sealed.object(self.owner, serial);
        self.sealed.insert(serial, sealed);
        self.stats.objects_sealed += 1;
        self.free_if_unheld(serial);
        object
    }

    /// Ends a loan without an object.
    ///
    /// # Panics
    ///
    /// If the loan is of another ledger.
    pub fn abandon(&mut self, loan: Loan) {
        let block = self.end_loan(loan);
        self.free(block);
    }

    /// Enters an object whose bytes are another federate's, in a segment that has the number `segment`
    /// here, with one view of this federate. When no reader holds it any more,
    /// [`Self::take_returned`] returns it.
    pub fn forward(&mut self, segment: u32, offset: u64, len: u64) -> ObjectRef {
        let serial = self.next_serial;
        self.next_serial += 1;
        let block = Block { segment, offset, len };
        let sealed = Sealed { block, len, readers: BTreeMap::new(), views: 1, foreign: true };
        let object = sealed.object(self.owner, serial);
        self.sealed.insert(serial, sealed);
        self.stats.objects_passed_on += 1;
        object
    }

    /// Whether [`Self::take_returned`] would return any.
    pub(crate) fn has_returned(&self) -> bool {
        !self.returned.is_empty()
    }

    /// The foreign objects whose last hold has ended since the last call.
    pub fn take_returned(&mut self) -> Vec<u64> {
        std::mem::take(&mut self.returned)
    }

    /// Adds a view of the owner to an object that is held.
    ///
    /// # Errors
    ///
    /// [`HoldError::UnknownObject`] if it is not held any more.
    pub fn add_view(&mut self, serial: u64) -> Result<(), HoldError> {
        let sealed = self.sealed.get_mut(&serial).ok_or(HoldError::UnknownObject { serial })?;
        sealed.views += 1;
        Ok(())
    }

    /// The object of that number, if `reader` holds it.
    #[must_use]
    pub fn held(&self, serial: u64, reader: FederateId) -> Option<ObjectRef> {
        let sealed = self.sealed.get(&serial).filter(|it| it.readers.contains_key(&reader))?;
        Some(sealed.object(self.owner, serial))
    }

    /// The objects that `reader` holds.
    pub fn held_by(&self, reader: FederateId) -> impl Iterator<Item = ObjectRef> {
        let held = self.sealed.iter().filter(move |(_, it)| it.readers.contains_key(&reader));
        held.map(|(serial, sealed)| sealed.object(self.owner, *serial))
    }

    /// How many bytes each reader holds. An object that several hold counts for each of them.
    #[must_use]
    pub fn held_bytes(&self) -> BTreeMap<FederateId, u64> {
        let mut held = BTreeMap::new();
        for sealed in self.sealed.values() {
            for reader in sealed.readers.keys() {
                *held.entry(*reader).or_default() += sealed.len;
            }
        }
        held
    }

    /// Adds a hold of `reader` to an object that is held, and returns its reference.
    ///
    /// # Errors
    ///
    /// [`HoldError::UnknownObject`] if it is not held any more.
    pub fn add_reader(&mut self, serial: u64, reader: FederateId) -> Result<ObjectRef, HoldError> {
        let sealed = self.sealed.get_mut(&serial).ok_or(HoldError::UnknownObject { serial })?;
        *sealed.readers.entry(reader).or_default() += 1;
        Ok(sealed.object(self.owner, serial))
    }

    /// Ends one hold of `reader`. A view of the owner ends by [`Self::end_view`] instead.
    ///
    /// # Errors
    ///
    /// If the object is not held, or not by `reader`; nothing has changed then.
    pub fn release(&mut self, serial: u64, reader: FederateId) -> Result<(), HoldError> {
        let sealed = self.sealed.get_mut(&serial).ok_or(HoldError::UnknownObject { serial })?;
        if !sealed.end_hold(reader) {
            return Err(HoldError::NotHolding { serial, reader });
        }
        self.stats.releases += 1;
        self.free_if_unheld(serial);
        Ok(())
    }

    /// Turns one hold of the owner into a view in its own process.
    ///
    /// # Errors
    ///
    /// If no object that is held has this reference, or the owner has no hold left; nothing has changed
    /// then.
    pub fn view(&mut self, object: &ObjectRef) -> Result<(), HoldError> {
        let (owner, serial) = (self.owner, object.serial);
        let sealed = self.sealed.get_mut(&serial);
        let sealed = sealed.filter(|sealed| sealed.object(owner, serial) == *object);
        let sealed = sealed.ok_or(HoldError::UnknownObject { serial })?;
        if !sealed.end_hold(owner) {
            return Err(HoldError::NotHolding { serial, reader: owner });
        }
        sealed.views += 1;
        Ok(())
    }

    /// Ends a view of the owner.
    ///
    /// # Panics
    ///
    /// If there is no such view.
    pub fn end_view(&mut self, serial: u64) {
        let sealed = self.sealed.get_mut(&serial).expect("a viewed object is held");
        sealed.views = sealed.views.checked_sub(1).expect("a view ends once");
        self.stats.releases += 1;
        self.free_if_unheld(serial);
    }

    /// Ends all holds of a reader whose link has closed.
    pub fn reader_lost(&mut self, reader: FederateId) {
        let held = |(serial, sealed): (&u64, &mut Sealed)| {
            sealed.readers.remove(&reader).is_some().then_some(*serial)
        };
        let serials: Vec<u64> = self.sealed.iter_mut().filter_map(held).collect();
        for serial in serials {
            self.free_if_unheld(serial);
        }
    }

    /// What has to happen before `len` bytes can be loaned. Segments without any block in use are retired
    /// if that makes enough room: otherwise a program whose arrays grow would fill its capacity with
    /// free blocks that are all too short.
    fn make_room(&mut self, len: u64) -> LoanError {
        let capacity = self.limits.capacity_bytes;
        let full = LoanError::Full { asked: len, capacity, in_use: self.stats.bytes_in_use };
        let Some(needed) = len.max(1).checked_next_multiple_of(PAGE) else { return full };
        let idle: u64 = self.arena.free_segments().map(|(_, len)| len).sum();
        if (self.stats.bytes_mapped - idle).saturating_add(needed) > capacity {
            return full;
        }
        let idle: Vec<(u32, u64)> = self.arena.free_segments().collect();
        for (segment, segment_len) in idle {
            if self.stats.bytes_mapped.saturating_add(needed) <= capacity {
                break;
            }
            self.arena.remove_segment(segment);
            self.retired.push(segment);
            self.stats.bytes_mapped -= segment_len;
            self.stats.segments -= 1;
        }
        let room = (capacity - self.stats.bytes_mapped) / PAGE * PAGE;
        // Room for the next object of this size as well, because readers still hold this one when the
        // next one is made: memory that is mapped now, at the first message, need not be mapped in the
        // middle of a run.
        let spare = needed.saturating_mul(2).max(self.limits.segment_min_bytes);
        let wanted = spare.checked_next_multiple_of(STEP);
        LoanError::NeedsSegment { len: wanted.unwrap_or(room).min(room) }
    }

    fn end_loan(&mut self, loan: Loan) -> Block {
        assert_eq!(loan.owner, self.owner, "a loan ends in the ledger that made it");
        let block = self.loaned.remove(&loan.serial);
        block.expect("a loan ends in the ledger that made it, once")
    }

    fn free_if_unheld(&mut self, serial: u64) {
        if self.sealed.get(&serial).is_some_and(|sealed| !sealed.is_held()) {
            let sealed = self.sealed.remove(&serial).expect("it was there a line ago");
            if sealed.foreign {
                self.returned.push(serial);
            } else {
                self.free(sealed.block);
            }
        }
    }

    fn free(&mut self, block: Block) {
        self.stats.bytes_in_use -= block.len;
        self.arena.free(block);
    }
}

#[cfg(test)]
mod tests;
