//! A block on loan, as bytes to write.
//!
//! It lives on any thread, as long as it likes, and never needs the store: sealing takes it apart, and
//! a drop leaves the block where the store will find it.

#![forbid(unsafe_code)]

use std::ops::{Deref, DerefMut};
use std::sync::Arc;

use crate::Loan;
use crate::returns::Returns;
use crate::shm::Writing;

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
