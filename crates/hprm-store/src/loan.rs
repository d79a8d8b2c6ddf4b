//! A block on loan, as bytes to write.
//!
//! It lives on any thread, as long as it likes, and never needs the store: sealing takes it apart, and
//! a drop leaves the block where the store will find it.

#![forbid(unsafe_code)]

use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};
use std::sync::Arc;

use bytemuck::Pod;

use crate::Loan;
use crate::returns::Returns;
use crate::shm::{Segment, Writing};

/// Bytes of the store that only the holder of this value can see and write.
///
/// They are not zero at first: they hold what an earlier object left. Dropped without being sealed,
/// the loan gives its block back; the store takes notice at its next loan.
#[derive(Debug)]
#[must_use = "dropping a loan gives its block back"]
pub struct WritableLoan {
    // Dropped in this order: the block is free only when its bytes are not borrowed any more.
    bytes: Writing,
    ticket: Ticket,
}

impl WritableLoan {
    pub(crate) fn new(bytes: Writing, loan: Loan, abandoned: Arc<Returns<Loan>>) -> Self {
        Self { bytes, ticket: Ticket { loan: Some(loan), abandoned } }
    }

    /// Where the bytes are.
    pub(crate) fn segment(&self) -> &Arc<Segment> {
        self.bytes.segment()
    }

    /// Whether the loan, if it is dropped, goes back to whoever drains that queue.
    pub(crate) fn returns_to(&self, abandoned: &Arc<Returns<Loan>>) -> bool {
        Arc::ptr_eq(&self.ticket.abandoned, abandoned)
    }

    /// Gives up the bytes and keeps the entry in the books.
    pub(crate) fn into_loan(self) -> Loan {
        let Self { bytes, mut ticket } = self;
        drop(bytes);
        ticket.loan.take().expect("only this function takes it, and it consumes the ticket")
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
#[must_use = "dropping a loan gives its block back"]
pub struct LoanOf<T> {
    bytes: WritableLoan,
    values: PhantomData<T>,
}

impl<T: Pod> LoanOf<T> {
    /// The loan as values; none if the memory does not lie as they must.
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

/// The entry in the books, on its way back if it is still there.
#[derive(Debug)]
struct Ticket {
    loan: Option<Loan>,
    abandoned: Arc<Returns<Loan>>,
}

impl Drop for Ticket {
    fn drop(&mut self) {
        if let Some(loan) = self.loan.take() {
            self.abandoned.push(loan);
        }
    }
}
