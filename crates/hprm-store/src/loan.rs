//! A block on loan, as bytes to write.
//!
//! It may live on any thread and for any time, and never needs the store: the store takes it apart when
//! it seals it, and a drop adds its ledger entry to a queue that the store drains.

#![forbid(unsafe_code)]

use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};
use std::sync::Arc;

use bytemuck::Pod;

use crate::Loan;
use crate::drop_queue::DropQueue;
use crate::shm::{Segment, WriteBorrow};

/// Bytes of the store that only the holder of this value can see and write.
///
/// They are not zero at first, but have the content of an earlier object. A loan that is dropped without
/// being sealed releases its block; the store processes that at its next loan.
#[derive(Debug)]
#[must_use = "dropping a loan releases its block"]
pub struct WritableLoan {
    // Dropped in this order: the block is free only when its bytes are not borrowed any more.
    bytes: WriteBorrow,
    entry: LedgerEntry,
}

impl WritableLoan {
    pub(crate) fn new(bytes: WriteBorrow, loan: Loan, abandoned: Arc<DropQueue<Loan>>) -> Self {
        Self { bytes, entry: LedgerEntry { loan: Some(loan), abandoned } }
    }

    /// The segment in which the bytes are.
    pub(crate) fn segment(&self) -> &Arc<Segment> {
        self.bytes.segment()
    }

    /// Whether a drop of the loan adds its entry to that queue.
    pub(crate) fn is_dropped_to(&self, abandoned: &Arc<DropQueue<Loan>>) -> bool {
        Arc::ptr_eq(&self.entry.abandoned, abandoned)
    }

    /// Ends the borrow of the bytes and returns the loan as the ledger knows it.
    pub(crate) fn into_loan(self) -> Loan {
        let Self { bytes, mut entry } = self;
        drop(bytes);
        entry.loan.take().expect("only this function takes it, and it consumes the entry")
    }
}

impl Deref for WritableLoan {
    type Target = [u8];
    fn deref(&self) -> &[u8] {
        self.bytes.bytes()
    }
}

impl DerefMut for WritableLoan {
    fn deref_mut(&mut self) -> &mut [u8] {
        self.bytes.bytes_mut()
    }
}

/// A loan of values rather than of bytes.
///
/// They are of a type of which any bytes are a value, so what they are at first is arbitrary and
/// harmless. See [`Store::loan_of`](crate::Store::loan_of).
#[derive(Debug)]
#[must_use = "dropping a loan releases its block"]
pub struct LoanOf<T> {
    bytes: WritableLoan,
    values: PhantomData<T>,
}

impl<T: Pod> LoanOf<T> {
    /// The loan as values; none if the memory does not have their alignment.
    pub(crate) fn new(bytes: WritableLoan) -> Option<Self> {
        bytemuck::try_cast_slice::<u8, T>(&bytes).ok()?;
        Some(Self { bytes, values: PhantomData })
    }
}

impl<T: Pod> Deref for LoanOf<T> {
    type Target = [T];
    fn deref(&self) -> &[T] {
        bytemuck::cast_slice(&self.bytes)
    }
}

impl<T: Pod> DerefMut for LoanOf<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        bytemuck::cast_slice_mut(&mut self.bytes)
    }
}

impl<T> From<LoanOf<T>> for WritableLoan {
    fn from(loan: LoanOf<T>) -> Self {
        loan.bytes
    }
}

/// The loan as the ledger knows it. If it was not taken, a drop adds it to the queue of abandoned loans.
#[derive(Debug)]
struct LedgerEntry {
    loan: Option<Loan>,
    abandoned: Arc<DropQueue<Loan>>,
}

impl Drop for LedgerEntry {
    fn drop(&mut self) {
        if let Some(loan) = self.loan.take() {
            self.abandoned.push(loan);
        }
    }
}
