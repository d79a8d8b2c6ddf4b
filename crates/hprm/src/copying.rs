//! Copies of large values, the way that has been the quicker one in this process. Which one that is, `hprm_store::Ways`
//! decides; here are the clock, and what all threads know of it.

use std::sync::{Mutex, PoisonError};

use hprm_store::{STREAMED, Ways};

use crate::Clock;

static WAYS: Mutex<Ways> = Mutex::new(Ways::new());

/// Copies the bytes of a value to where it is sent from, or to where it is read.
///
/// # Panics
///
/// If the lengths differ.
pub fn copy_value(to: &mut [u8], from: &[u8]) {
    if to.len() < STREAMED {
        return to.copy_from_slice(from);
    }
    let way = ways(|ways| ways.next(to.len()));
    let began = Clock::local();
    hprm_store::copy(way, to, from);
    let took = u64::try_from(Clock::local().since(began)).unwrap_or(0);
    ways(|ways| ways.took(way, to.len(), took));
}

fn ways<T>(then: impl FnOnce(&mut Ways) -> T) -> T {
    then(&mut WAYS.lock().unwrap_or_else(PoisonError::into_inner))
}
