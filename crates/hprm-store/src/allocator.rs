//! An allocator in the memory of a store, for values that are not published yet: by address, on any thread.
//!
//! A library that allocates by address, as NumPy does, knows neither loans nor the thread of the loop. So
//! the loans are kept here until their memory is freed, or taken to be sealed. A value may never be
//! published, so all that are not get no more than a share of the store. The caller decides which
//! allocations come here, and makes sure that no reference is left to memory that it takes.
//!
//! A request never waits for the store: while the loop has it locked, no memory is given. And `free` needs
//! the store only later. So a thread that allocates or frees never waits for a thread that waits for it.
//! What happens when the process forks is in `fork`.

#![forbid(unsafe_code)]
#![allow(
    clippy::disallowed_types,
    reason = "memory is freed on any thread; no thread waits while it holds these locks"
)]

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError, TryLockError, Weak};

use hprm_core::ObjectRef;

use crate::at_fork::is_forked;
use crate::forks::Forks;
use crate::shm::{ForkLock, Segment};
use crate::store::Drops;
use crate::{CowObject, Object, Store, WritableLoan};

mod fork;

/// The share of the capacity that unpublished values may take: one part in this many.
const UNPUBLISHED_SHARE: u64 = 2;
/// The share that one of them may take. A program that asks for more is likely to use little of it,
/// and all pages of a store are present from the start.
const LARGEST_SHARE: u64 = 8;

/// A store that several threads use, and an allocator in its memory.
#[derive(Debug)]
pub struct StoreAllocator {
    store: Mutex<Store>,
    /// What has been dropped, which the store need not be locked for.
    drops: Drops,
    /// Whether a thread has locked the store since releases were last drained: it may have more to settle.
    was_locked: AtomicBool,
    capacity: u64,
    unpublished: Mutex<Unpublished>,
    /// Bounds of all addresses that were ever given: most look-ups end here.
    lowest: AtomicUsize,
    highest: AtomicUsize,
    /// Requests that were refused because the share was used up.
    refused: AtomicU64,
    /// Received objects that this process may write to.
    cow_objects: Mutex<Vec<Weak<CowObject>>>,
    forks: Arc<Forks>,
    /// In a forked process, which does not own the memory: its copies.
    inherited: OnceLock<InheritedMemory>,
}

/// Values that are not published yet.
#[derive(Debug, Default)]
struct Unpublished {
    loans: BTreeMap<usize, WritableLoan>,
    bytes: u64,
    /// The segments in which they are, or were, by their first address.
    segments: BTreeMap<usize, Weak<Segment>>,
    /// How many forked processes do not have their copies yet. As long as there are any, no memory of
    /// theirs is used again.
    copying: usize,
    /// Blocks that were freed meanwhile.
    freed: Vec<WritableLoan>,
}

/// What the forked process needs to know. It is collected before the fork, because in the forked process
/// the locks of the allocator may be held for ever.
#[derive(Debug)]
struct ForkSnapshot {
    inherited: InheritedMemory,
    /// Received objects that may be written to.
    cow_objects: Vec<Arc<CowObject>>,
    lock: Option<ForkLock>,
}

/// The memory of which a forked process has copies; this record does not change.
#[derive(Debug)]
struct InheritedMemory {
    segments: Vec<Arc<Segment>>,
    /// The lengths of unpublished values, by their addresses.
    blocks: BTreeMap<usize, usize>,
}

impl StoreAllocator {
    /// An allocator in that store.
    #[must_use]
    pub fn new(store: Store) -> Self {
        Self {
            capacity: store.capacity(),
            forks: Arc::clone(store.forks()),
            drops: store.drops(),
            was_locked: AtomicBool::new(false),
            store: Mutex::new(store),
            unpublished: Mutex::default(),
            lowest: AtomicUsize::new(usize::MAX),
            highest: AtomicUsize::new(0),
            refused: AtomicU64::new(0),
            cow_objects: Mutex::default(),
            inherited: OnceLock::new(),
        }
    }

    /// Locks the store. The allocator gives no memory meanwhile.
    pub fn store(&self) -> MutexGuard<'_, Store> {
        let store = self.store.lock().unwrap_or_else(PoisonError::into_inner);
        self.was_locked.store(true, Ordering::Release);
        store
    }

    /// Whether [`Self::drain_releases`] may find any, without a lock.
    #[inline]
    pub fn may_have_releases(&self) -> bool {
        self.was_locked.load(Ordering::Acquire) || self.drops.may_have_entries()
    }

    /// As [`Store::drain_releases`]; it locks the store only if something may have changed there.
    pub fn drain_releases(&self) -> Vec<ObjectRef> {
        if !self.may_have_releases() {
            return Vec::new();
        }
        let mut store = self.store();
        let releases = store.drain_releases();
        // Under the lock: a thread that locks the store from here on has the next call look.
        self.was_locked.store(store.has_changed(), Ordering::Release);
        releases
    }

    /// The address of `len` bytes to write, with arbitrary content at first. They stay until a caller
    /// [`free`](Self::free)s or [`take`](Self::take)s them. None if the share of unpublished values is
    /// used up, if the store is full, or if another thread has locked it.
    pub fn alloc(&self, len: usize) -> Option<*mut u8> {
        let asked = len as u64;
        if is_forked() || asked > self.capacity / LARGEST_SHARE {
            return None;
        }
        if self.unpublished().bytes.saturating_add(asked) > self.capacity / UNPUBLISHED_SHARE {
            self.refused.fetch_add(1, Ordering::Relaxed);
            return None;
        }
        let mut store = match self.store.try_lock() {
            Ok(store) => store,
            Err(TryLockError::Poisoned(poisoned)) => poisoned.into_inner(),
            Err(TryLockError::WouldBlock) => return None,
        };
        self.was_locked.store(true, Ordering::Release);
        let mut loan = store.loan(len).ok()?;
        drop(store);
        let start = loan.as_mut_ptr();
        let address = start as usize;
        self.lowest.fetch_min(address, Ordering::Relaxed);
        self.highest.fetch_max(address, Ordering::Relaxed);
        let mut unpublished = self.unpublished();
        unpublished.bytes += asked;
        let segment = loan.segment();
        if unpublished.segments.insert(segment.address(), Arc::downgrade(segment)).is_none() {
            // Without those that the store has removed meanwhile.
            unpublished.segments.retain(|_, segment| segment.strong_count() > 0);
        }
        unpublished.loans.insert(address, loan);
        Some(start)
    }

    /// The length of the block at that address, if it is one of this allocator.
    pub fn len_at(&self, address: usize) -> Option<usize> {
        if !self.is_within_bounds(address) {
            return None;
        }
        if is_forked() {
            return self.inherited.get()?.blocks.get(&address).copied();
        }
        self.unpublished().loans.get(&address).map(|loan| loan.len())
    }

    /// Frees the block at that address. False if it is not one of this allocator.
    pub fn free(&self, address: usize) -> bool {
        if !self.is_within_bounds(address) {
            return false;
        }
        if is_forked() {
            // The block belongs to the process that has allocated it; only the copy is freed.
            return self.inherited.get().is_some_and(|inherited| inherited.free(address));
        }
        let mut unpublished = self.unpublished();
        let Some(loan) = unpublished.loans.remove(&address) else { return false };
        unpublished.bytes -= loan.len() as u64;
        if unpublished.copying > 0 {
            unpublished.freed.push(loan);
            return true;
        }
        // Dropped without holding the lock.
        drop(unpublished);
        drop(loan);
        true
    }

    /// Removes the block at that address, to be sealed in `store`. None if it is not one of this
    /// allocator, has another length, or is just being copied for a forked process.
    pub fn take(&self, address: usize, len: usize, store: &Store) -> Option<WritableLoan> {
        if is_forked() {
            return None;
        }
        let mut unpublished = self.unpublished();
        let loan = unpublished.loans.get(&address)?;
        if loan.len() != len || !store.owns_loan(loan) || unpublished.copying > 0 {
            return None;
        }
        unpublished.bytes -= len as u64;
        unpublished.loans.remove(&address)
    }

    /// Maps an object of another federate copy-on-write: this process may write to it, and no other
    /// process sees that. None if the system does not do it, or if objects are written to so much that
    /// one large copy costs less; then copy.
    pub fn map_copy_on_write(&self, object: &Object) -> Option<Arc<CowObject>> {
        if is_forked() {
            return None;
        }
        let cow = Arc::new(CowObject::of(object)?);
        let mut cow_objects = self.cow_objects();
        if cow_objects.len() == cow_objects.capacity() {
            // Before the list grows, so that at most half of its entries are dead.
            cow_objects.retain(|cow| cow.strong_count() > 0);
        }
        cow_objects.push(Arc::downgrade(&cow));
        Some(cow)
    }

    /// How many requests were refused because the share of unpublished values was used up.
    pub fn refused(&self) -> u64 {
        self.refused.load(Ordering::Relaxed)
    }

    /// The bytes of unpublished values.
    pub fn bytes(&self) -> u64 {
        self.unpublished().bytes
    }

    fn is_within_bounds(&self, address: usize) -> bool {
        let bounds = self.lowest.load(Ordering::Relaxed)..=self.highest.load(Ordering::Relaxed);
        bounds.contains(&address)
    }

    fn unpublished(&self) -> MutexGuard<'_, Unpublished> {
        self.unpublished.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn cow_objects(&self) -> MutexGuard<'_, Vec<Weak<CowObject>>> {
        self.cow_objects.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use hprm_core::FederateId;

    use super::*;
    use crate::StoreLimits;

    const ME: FederateId = FederateId(0);
    const MB: usize = 1 << 20;

    fn allocator() -> StoreAllocator {
        let limits = StoreLimits {
            capacity_bytes: 32 << 20,
            segment_min_bytes: 1 << 20,
            ..StoreLimits::default()
        };
        StoreAllocator::new(Store::new(ME, limits))
    }

    fn alloc(allocator: &StoreAllocator, len: usize) -> Option<usize> {
        allocator.alloc(len).map(|start| start as usize)
    }

    #[test]
    fn what_is_freed_is_used_again() {
        let allocator = allocator();
        let first = alloc(&allocator, MB).unwrap();
        assert_eq!((allocator.len_at(first), allocator.bytes()), (Some(MB), MB as u64));
        assert!(allocator.free(first));
        assert_eq!((allocator.len_at(first), allocator.bytes()), (None, 0));
        assert_eq!(alloc(&allocator, MB), Some(first));
    }

    #[test]
    fn other_addresses_are_refused() {
        let allocator = allocator();
        let elsewhere = Box::new(7_u8);
        assert!(!allocator.free(&raw const *elsewhere as usize));
        let block = alloc(&allocator, MB).unwrap();
        assert!(!allocator.free(block + 1));
        assert_eq!(allocator.len_at(block + 1), None);
        assert!(allocator.free(block));
        assert!(!allocator.free(block));
    }

    #[test]
    fn what_is_taken_is_published_where_it_lies() {
        let allocator = allocator();
        let address = alloc(&allocator, MB).unwrap();
        let other = Store::new(ME, StoreLimits::default());
        assert!(allocator.take(address, MB, &other).is_none());
        let mut store = allocator.store();
        assert!(allocator.take(address, MB - 1, &store).is_none());
        let loan = allocator.take(address, MB, &store).unwrap();
        let object = store.seal(loan, &[ME]);
        let opened = store.open(object).unwrap();
        assert_eq!(opened.as_bytes().as_ptr() as usize, address);
        assert!(!allocator.free(address));
        assert_eq!((store.stats().bytes_copied, allocator.bytes()), (0, 0));
    }

    #[test]
    fn what_is_never_published_leaves_half_of_the_store() {
        let allocator = allocator();
        let largest = 4 * MB;
        assert_eq!(alloc(&allocator, largest + 1), None);
        let kept: Vec<_> = (0..4).map(|_| alloc(&allocator, largest).unwrap()).collect();
        assert_eq!((alloc(&allocator, 1), allocator.refused()), (None, 1));
        assert!(allocator.store().loan(12 * MB).is_ok());
        assert!(allocator.free(kept[0]));
        assert!(alloc(&allocator, MB).is_some());
    }

    #[test]
    fn neither_alloc_nor_free_waits_for_the_store() {
        let allocator = allocator();
        let address = alloc(&allocator, MB).unwrap();
        let store = allocator.store();
        assert_eq!(alloc(&allocator, MB), None);
        assert!(allocator.free(address));
        drop(store);
        assert_eq!(alloc(&allocator, MB), Some(address));
    }

    #[test]
    fn memory_that_a_forked_process_still_copies_is_not_used_again() {
        let allocator = allocator();
        let (kept, freed) = (alloc(&allocator, MB).unwrap(), alloc(&allocator, MB).unwrap());
        let first = allocator.begin_fork();
        let second = allocator.begin_fork();
        assert_eq!(first.inherited.blocks.keys().copied().collect::<Vec<_>>(), [kept, freed]);
        assert!(allocator.free(freed));
        assert_eq!(allocator.len_at(freed), None);
        assert_ne!(alloc(&allocator, MB), Some(freed));
        assert!(allocator.take(kept, MB, &allocator.store()).is_none());
        allocator.end_fork(first);
        assert_ne!(alloc(&allocator, MB), Some(freed));
        allocator.end_fork(second);
        assert_eq!(alloc(&allocator, MB), Some(freed));
        assert!(allocator.take(kept, MB, &allocator.store()).is_some());
    }

    #[test]
    fn releases_are_drained_whichever_thread_has_changed_the_store() {
        let (sender, reader) = (FederateId(1), allocator());
        let mut owner = Store::new(sender, StoreLimits::default());
        for round in 0..3 {
            assert_eq!(reader.drain_releases(), []);
            let object = owner.put(&[7; 100], &[ME]).unwrap();
            for segment in owner.unannounced(ME) {
                let fd = std::os::fd::AsFd::as_fd(&segment).try_clone_to_owned().unwrap();
                reader.store().attach(sender, segment.segment, segment.len, fd).unwrap();
            }
            let opened = reader.store().open(object).unwrap();
            assert_eq!(reader.drain_releases(), []);
            let clone = opened.clone();
            drop(opened);
            assert_eq!(reader.drain_releases(), []);
            drop(clone);
            assert_eq!(reader.drain_releases(), [object], "in round {round}");
        }
        // What was never published comes back, too, without a release.
        let block = alloc(&reader, MB).unwrap();
        assert!(reader.free(block));
        assert_eq!(reader.drain_releases(), []);
        assert_eq!(reader.store().stats().bytes_in_use, 0);
    }

    #[test]
    #[allow(clippy::disallowed_methods, reason = "the threads are the program's")]
    fn threads_share_it() {
        let allocator = allocator();
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for round in 1..200 {
                        if let Some(address) = alloc(&allocator, round * 1000) {
                            assert!(allocator.free(address));
                        }
                    }
                });
            }
        });
        assert_eq!((allocator.bytes(), allocator.store().stats().bytes_in_use), (0, 0));
    }
}
