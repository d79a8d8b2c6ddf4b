//! Memory of a store for values that are still being made: by address, on any thread.
//!
//! Whoever allocates by address, as NumPy does, knows neither loans nor the thread of the loop. So
//! the loans are kept here until their memory is freed, or taken to be sealed. What is made may
//! never be published; it gets no more than a share of the store. Which allocations come here, and
//! who may still reach what is taken, is decided elsewhere.
//!
//! A request never waits for the store: if the loop has it, there is no memory. And what ends here
//! needs the store only later. So nothing that happens within an allocation or a release can wait
//! for somebody who waits for it. What happens when the process forks is below, in `forking`.

#![forbid(unsafe_code)]
#![allow(
    clippy::disallowed_types,
    reason = "memory is freed on any thread; nothing waits under it"
)]

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError, TryLockError, Weak};

use crate::at_fork::is_forked;
use crate::forks::Forks;
use crate::shm::{Segment, Tether};
use crate::{Object, OwnObject, Store, WritableLoan};

mod forking;

/// The share of the capacity that values in the making may take: one part in this many.
const SHARE: u64 = 2;
/// The share that one of them may take. A program that asks for more is likely to use little of it,
/// and memory of a store is present from the start.
const LARGEST: u64 = 8;

/// A store that several threads reach, and what they make in its memory.
#[derive(Debug)]
pub struct Yard {
    store: Mutex<Store>,
    capacity: u64,
    making: Mutex<Making>,
    /// Bounds of all addresses that ever were ours: most questions end here.
    lowest: AtomicUsize,
    highest: AtomicUsize,
    /// Requests that were refused because the share was used up.
    refused: AtomicU64,
    /// What this process has received and may write to.
    owned: Mutex<Vec<Weak<OwnObject>>>,
    forks: Arc<Forks>,
    /// In a forked process, to which the memory does not belong: what it has of it.
    inherited: OnceLock<Inherited>,
}

/// What is being made.
#[derive(Debug, Default)]
struct Making {
    loans: BTreeMap<usize, WritableLoan>,
    bytes: u64,
    /// The segments in which it is, or was, by their first address.
    segments: BTreeMap<usize, Weak<Segment>>,
    /// How many new processes do not have their copies yet. So long no memory changes that they have.
    forking: usize,
    /// What was freed meanwhile.
    freed: Vec<WritableLoan>,
}

/// What this process has to know when it is about to fork, and the new one after that: there, the locks
/// of this one may be taken for ever.
#[derive(Debug)]
struct Estate {
    inherited: Inherited,
    /// What was received and may be written to.
    owned: Vec<Arc<OwnObject>>,
    tether: Option<Tether>,
}

/// What a forked process has of the memory; it does not change.
#[derive(Debug)]
struct Inherited {
    segments: Vec<Arc<Segment>>,
    /// What was being made: its length, by its address.
    blocks: BTreeMap<usize, usize>,
}

impl Yard {
    /// A yard of that store.
    #[must_use]
    pub fn new(store: Store) -> Self {
        Self {
            capacity: store.capacity(),
            forks: Arc::clone(store.forks()),
            store: Mutex::new(store),
            making: Mutex::default(),
            lowest: AtomicUsize::new(usize::MAX),
            highest: AtomicUsize::new(0),
            refused: AtomicU64::new(0),
            owned: Mutex::default(),
            inherited: OnceLock::new(),
        }
    }

    /// The store. Nobody gets memory here meanwhile.
    pub fn store(&self) -> MutexGuard<'_, Store> {
        self.store.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The address of `len` bytes to write, which hold anything at first. They stay until somebody
    /// [`free`](Self::free)s or [`take`](Self::take)s them. None if the share of values in the
    /// making is used up, if the store is full, or if somebody has it just now.
    pub fn alloc(&self, len: usize) -> Option<*mut u8> {
        let asked = len as u64;
        if is_forked() || asked > self.capacity / LARGEST {
            return None;
        }
        if self.making().bytes.saturating_add(asked) > self.capacity / SHARE {
            self.refused.fetch_add(1, Ordering::Relaxed);
            return None;
        }
        let mut store = match self.store.try_lock() {
            Ok(store) => store,
            Err(TryLockError::Poisoned(poisoned)) => poisoned.into_inner(),
            Err(TryLockError::WouldBlock) => return None,
        };
        let mut loan = store.loan(len).ok()?;
        drop(store);
        let start = loan.as_mut_ptr();
        let address = start as usize;
        self.lowest.fetch_min(address, Ordering::Relaxed);
        self.highest.fetch_max(address, Ordering::Relaxed);
        let mut making = self.making();
        making.bytes += asked;
        let segment = loan.segment();
        if making.segments.insert(segment.address(), Arc::downgrade(segment)).is_none() {
            // Not those that the store has given up meanwhile.
            making.segments.retain(|_, segment| segment.strong_count() > 0);
        }
        making.loans.insert(address, loan);
        Some(start)
    }

    /// The length of what was allocated at that address, if it was here.
    pub fn len_at(&self, address: usize) -> Option<usize> {
        if !self.may_be_ours(address) {
            return None;
        }
        if is_forked() {
            return self.inherited.get()?.blocks.get(&address).copied();
        }
        self.making().loans.get(&address).map(|loan| loan.len())
    }

    /// Ends what was allocated at that address. False if it was elsewhere.
    pub fn free(&self, address: usize) -> bool {
        if !self.may_be_ours(address) {
            return false;
        }
        if is_forked() {
            // The block belongs to the process that has made it; only the copy ends.
            return self.inherited.get().is_some_and(|inherited| inherited.free(address));
        }
        let mut making = self.making();
        let Some(loan) = making.loans.remove(&address) else { return false };
        making.bytes -= loan.len() as u64;
        if making.forking > 0 {
            making.freed.push(loan);
            return true;
        }
        // Dropped when nothing is locked any more.
        drop(making);
        drop(loan);
        true
    }

    /// What was allocated at that address, to be sealed in `store`; it is not ours any more. None if
    /// it was elsewhere, is not of exactly that length, or is just being copied for a forked process.
    pub fn take(&self, address: usize, len: usize, store: &Store) -> Option<WritableLoan> {
        if is_forked() {
            return None;
        }
        let mut making = self.making();
        let loan = making.loans.get(&address)?;
        if loan.len() != len || !store.has_lent(loan) || making.forking > 0 {
            return None;
        }
        making.bytes -= len as u64;
        making.loans.remove(&address)
    }

    /// An object of another federate that this process may write to, without anybody else seeing it.
    /// Nothing is copied before that. None if the system does not do it, or if objects are written to
    /// so much that a copy costs less; then copy.
    pub fn own(&self, object: &Object) -> Option<Arc<OwnObject>> {
        if is_forked() {
            return None;
        }
        let own = Arc::new(OwnObject::of(object)?);
        let mut owned = self.owned();
        if owned.len() == owned.capacity() {
            // Before it grows, so that it is no longer than twice what there is at a time.
            owned.retain(|own| own.strong_count() > 0);
        }
        owned.push(Arc::downgrade(&own));
        Some(own)
    }

    /// How many requests were refused because the share of values in the making was used up.
    pub fn refused(&self) -> u64 {
        self.refused.load(Ordering::Relaxed)
    }

    /// The bytes of what is being made.
    pub fn bytes(&self) -> u64 {
        self.making().bytes
    }

    fn may_be_ours(&self, address: usize) -> bool {
        let bounds = self.lowest.load(Ordering::Relaxed)..=self.highest.load(Ordering::Relaxed);
        bounds.contains(&address)
    }

    fn making(&self) -> MutexGuard<'_, Making> {
        self.making.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn owned(&self) -> MutexGuard<'_, Vec<Weak<OwnObject>>> {
        self.owned.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use hprm_core::FederateId;

    use super::*;
    use crate::StoreLimits;

    const ME: FederateId = FederateId(0);
    const MB: usize = 1 << 20;

    fn yard() -> Yard {
        let limits = StoreLimits {
            capacity_bytes: 32 << 20,
            segment_min_bytes: 1 << 20,
            ..StoreLimits::default()
        };
        Yard::new(Store::new(ME, limits))
    }

    fn alloc(yard: &Yard, len: usize) -> Option<usize> {
        yard.alloc(len).map(|start| start as usize)
    }

    #[test]
    fn what_is_freed_is_used_again() {
        let yard = yard();
        let first = alloc(&yard, MB).unwrap();
        assert_eq!((yard.len_at(first), yard.bytes()), (Some(MB), MB as u64));
        assert!(yard.free(first));
        assert_eq!((yard.len_at(first), yard.bytes()), (None, 0));
        assert_eq!(alloc(&yard, MB), Some(first));
    }

    #[test]
    fn other_addresses_are_not_its_business() {
        let yard = yard();
        let elsewhere = Box::new(7_u8);
        assert!(!yard.free(&raw const *elsewhere as usize));
        let ours = alloc(&yard, MB).unwrap();
        assert!(!yard.free(ours + 1));
        assert_eq!(yard.len_at(ours + 1), None);
        assert!(yard.free(ours));
        assert!(!yard.free(ours));
    }

    #[test]
    fn what_is_taken_is_published_where_it_lies() {
        let yard = yard();
        let address = alloc(&yard, MB).unwrap();
        let other = Store::new(ME, StoreLimits::default());
        assert!(yard.take(address, MB, &other).is_none());
        let mut store = yard.store();
        assert!(yard.take(address, MB - 1, &store).is_none());
        let loan = yard.take(address, MB, &store).unwrap();
        let object = store.seal(loan, &[ME]);
        let opened = store.open(object).unwrap();
        assert_eq!(opened.as_bytes().as_ptr() as usize, address);
        assert!(!yard.free(address));
        assert_eq!((store.stats().bytes_copied, yard.bytes()), (0, 0));
    }

    #[test]
    fn what_is_never_published_leaves_half_of_the_store() {
        let yard = yard();
        let largest = 4 * MB;
        assert_eq!(alloc(&yard, largest + 1), None);
        let kept: Vec<_> = (0..4).map(|_| alloc(&yard, largest).unwrap()).collect();
        assert_eq!((alloc(&yard, 1), yard.refused()), (None, 1));
        assert!(yard.store().loan(12 * MB).is_ok());
        assert!(yard.free(kept[0]));
        assert!(alloc(&yard, MB).is_some());
    }

    #[test]
    fn nobody_waits_for_the_store() {
        let yard = yard();
        let address = alloc(&yard, MB).unwrap();
        let store = yard.store();
        assert_eq!(alloc(&yard, MB), None);
        assert!(yard.free(address));
        drop(store);
        assert_eq!(alloc(&yard, MB), Some(address));
    }

    #[test]
    fn what_a_new_process_still_copies_does_not_change() {
        let yard = yard();
        let (kept, freed) = (alloc(&yard, MB).unwrap(), alloc(&yard, MB).unwrap());
        let first = yard.begin_fork();
        let second = yard.begin_fork();
        assert_eq!(first.inherited.blocks.keys().copied().collect::<Vec<_>>(), [kept, freed]);
        assert!(yard.free(freed));
        assert_eq!(yard.len_at(freed), None);
        assert_ne!(alloc(&yard, MB), Some(freed));
        assert!(yard.take(kept, MB, &yard.store()).is_none());
        yard.end_fork(first);
        assert_ne!(alloc(&yard, MB), Some(freed));
        yard.end_fork(second);
        assert_eq!(alloc(&yard, MB), Some(freed));
        assert!(yard.take(kept, MB, &yard.store()).is_some());
    }

    #[test]
    #[allow(clippy::disallowed_methods, reason = "the threads are the program's")]
    fn threads_share_it() {
        let yard = yard();
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for round in 1..200 {
                        if let Some(address) = alloc(&yard, round * 1000) {
                            assert!(yard.free(address));
                        }
                    }
                });
            }
        });
        assert_eq!((yard.bytes(), yard.store().stats().bytes_in_use), (0, 0));
    }
}
