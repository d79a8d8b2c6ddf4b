//! Copies of large values, the way that has been the quicker one in this process. Which one that is, `hprm_store::Ways`
//! decides; here are the clock, and what all threads know of it.

use std::sync::{Mutex, TryLockError};

use hprm_store::{STREAMED, Way, Ways};

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
    let way = ways(|ways| ways.next(to.len())).unwrap_or(Way::Cached);
    let began = Clock::local();
    hprm_store::copy(way, to, from);
    let took = u64::try_from(Clock::local().since(began)).unwrap_or(0);
    let _ = ways(|ways| ways.took(way, to.len(), took));
}

/// Nothing waits for the lock: in a forked process, a thread that has not come along may hold it for ever.
fn ways<T>(then: impl FnOnce(&mut Ways) -> T) -> Option<T> {
    match WAYS.try_lock() {
        Ok(mut ways) => Some(then(&mut ways)),
        Err(TryLockError::Poisoned(poisoned)) => Some(then(&mut poisoned.into_inner())),
        Err(TryLockError::WouldBlock) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_is_copied_whatever_the_size_and_whatever_holds_the_lock() {
        for len in [0, 1000, STREAMED + 3] {
            let from: Vec<u8> = (0..len).map(|at| (at % 251) as u8).collect();
            let mut to = vec![0; len];
            copy_value(&mut to, &from);
            assert!(to == from);
        }
        let _held = WAYS.lock();
        let from = vec![7; STREAMED];
        let mut to = vec![0; STREAMED];
        copy_value(&mut to, &from);
        assert!(to == from);
    }
}
