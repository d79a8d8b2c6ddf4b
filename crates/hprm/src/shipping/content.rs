//! The bytes of a shipment: all of them, or those that have come, while others are still on their way.
//!
//! A router sends on what it has of a shipment. So what comes in is shared between the link that brings it and those that
//! take it on. One thread has all of them; the lock lets the service move to that thread.

use std::io::{self, Read};
use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use hprm_federated::relay::Bytes;
use hprm_store::{Object, WritableLoan};

use super::blocks;

/// See the module.
#[derive(Clone, Debug)]
pub(super) struct Content(Arc<Mutex<State>>);

#[derive(Debug)]
enum State {
    /// The first bytes are there. If the link has ended that brought them, no more will come.
    Comes {
        loan: WritableLoan,
        filled: usize,
        is_broken: bool,
    },
    Whole(Object),
    /// While an object is made of it.
    Gone,
}

impl Content {
    /// One of which nothing has come.
    pub(super) fn new(loan: WritableLoan) -> Self {
        Self::with(State::Comes { loan, filled: 0, is_broken: false })
    }

    /// One that is there, and no object yet.
    pub(super) fn full(loan: WritableLoan) -> Self {
        let filled = loan.len();
        Self::with(State::Comes { loan, filled, is_broken: false })
    }

    /// One that is there.
    pub(super) fn whole(object: Object) -> Self {
        Self::with(State::Whole(object))
    }

    fn with(state: State) -> Self {
        Self(Arc::new(Mutex::new(state)))
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// How many bytes are there.
    pub(super) fn there(&self) -> usize {
        match &*self.state() {
            State::Comes { filled, .. } => *filled,
            State::Whole(object) => object.as_bytes().len(),
            State::Gone => 0,
        }
    }

    /// Calls a function with the bytes that are there.
    pub(super) fn look<T>(&self, look: impl FnOnce(&[u8]) -> T) -> T {
        match &*self.state() {
            State::Comes { loan, filled, .. } => look(&loan[..*filled]),
            State::Whole(object) => look(object.as_bytes()),
            State::Gone => look(&[]),
        }
    }

    /// Some of the bytes that are there, for as long as they are needed. Those of an object stay where they are; what is still
    /// coming is copied, because the rest of that memory is being written.
    pub(super) fn piece(&self, range: Range<usize>) -> Bytes {
        match &*self.state() {
            State::Comes { loan, filled, .. } => loan[..*filled][range].to_vec().into(),
            State::Whole(object) => Bytes::of(object.clone()).part(range),
            State::Gone => Vec::new().into(),
        }
    }

    /// Whether no more bytes will come, and some are missing.
    pub(super) fn is_broken(&self) -> bool {
        matches!(*self.state(), State::Comes { is_broken: true, .. })
    }

    /// No more bytes will come. Pieces that have left stay as long as they are needed.
    pub(super) fn break_off(&self) {
        if let State::Comes { is_broken, .. } = &mut *self.state() {
            *is_broken = true;
        }
    }

    /// Reads at most so many further bytes.
    pub(super) fn read_from(&self, stream: &mut impl Read, most: usize) -> io::Result<usize> {
        match &mut *self.state() {
            State::Comes { loan, filled, .. } => {
                let end = loan.len().min(*filled + most);
                let count = stream.read(&mut loan[*filled..end])?;
                *filled += count;
                Ok(count)
            }
            State::Whole(_) | State::Gone => Err(io::ErrorKind::InvalidData.into()),
        }
    }

    /// So many further bytes have come as a compressed piece.
    ///
    /// # Errors
    ///
    /// If it is no such piece.
    pub(super) fn unpack(&self, piece: &[u8], len: usize) -> io::Result<()> {
        match &mut *self.state() {
            State::Comes { loan, filled, .. } if len <= loan.len() - *filled => {
                blocks::unpack(piece, &mut loan[*filled..*filled + len])?;
                *filled += len;
                Ok(())
            }
            _ => Err(io::ErrorKind::InvalidData.into()),
        }
    }

    /// Makes an object of it, once all bytes have come; none if that is not so.
    pub(super) fn complete(&self, publish: impl FnOnce(WritableLoan) -> Object) -> Option<Object> {
        let mut state = self.state();
        match std::mem::replace(&mut *state, State::Gone) {
            State::Comes { loan, filled, .. } if filled == loan.len() => {
                let object = publish(loan);
                *state = State::Whole(object.clone());
                Some(object)
            }
            other => {
                *state = other;
                None
            }
        }
    }
}
