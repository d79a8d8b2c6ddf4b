//! A federation in one process: its federates are threads, and values change hands as they are.
//!
//! The machines and the loops are those of a federation of processes. What differs is here: frames
//! go through queues, and a message carries a number under which its value lies in the room.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use hprm_core::{FederateId, Payload};

use crate::wire::{Hub, Network};
use crate::{Failure, Rti, RtiOptions};

/// What the threads of a federation share. Clones are the same room.
#[derive(Debug)]
pub struct Room<V> {
    hub: Arc<Hub>,
    shelves: Arc<Shelves<V>>,
}

/// Values on their way, by receiver and number. None for a receiver that has left.
#[derive(Debug)]
struct Shelves<V> {
    next: AtomicU64,
    values: Mutex<BTreeMap<FederateId, Option<BTreeMap<u64, V>>>>,
}

impl<V> Clone for Room<V> {
    fn clone(&self) -> Self {
        Self { hub: Arc::clone(&self.hub), shelves: Arc::clone(&self.shelves) }
    }
}

impl<V> Default for Room<V> {
    fn default() -> Self {
        let shelves = Shelves { next: AtomicU64::new(0), values: Mutex::default() };
        Self { hub: Arc::default(), shelves: Arc::new(shelves) }
    }
}

impl<V> Room<V> {
    /// An empty room.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// The RTI of a federation in this room. Its address is a name, which means nothing outside.
    ///
    /// # Errors
    ///
    /// If the name is taken, or the process has no descriptor left.
    pub fn rti(&self, options: &RtiOptions) -> Result<Rti, Failure> {
        Rti::bind_on(options, &self.network())
    }

    pub(crate) fn network(&self) -> Network {
        Network::Process(Arc::clone(&self.hub))
    }

    /// Leaves a value for a federate. What is returned takes its place in a message.
    pub(crate) fn leave(&self, to: FederateId, value: V) -> Payload {
        let number = self.shelves.next.fetch_add(1, Ordering::Relaxed);
        if let Some(shelf) = self.values().entry(to).or_insert_with(|| Some(BTreeMap::new())) {
            shelf.insert(number, value);
        }
        Payload { head: number.to_le_bytes().to_vec(), ..Payload::default() }
    }

    /// Takes the value of a message to `me`. Each message has its own.
    pub(crate) fn take(&self, me: FederateId, payload: &Payload) -> Option<V> {
        let number = u64::from_le_bytes(payload.head.as_slice().try_into().ok()?);
        self.values().get_mut(&me)?.as_mut()?.remove(&number)
    }

    /// Drops what was left for a federate that has ended, and what will be.
    pub(crate) fn clear(&self, me: FederateId) {
        let shelf = self.values().insert(me, None);
        // Not under the lock: what a value does when it is dropped is its own business.
        drop(shelf);
    }

    fn values(&self) -> MutexGuard<'_, BTreeMap<FederateId, Option<BTreeMap<u64, V>>>> {
        self.shelves.values.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use hprm_core::FederateId;

    use super::Room;

    #[test]
    fn each_message_has_its_own_value() {
        let room = Room::new();
        let [a, b] = [FederateId(0), FederateId(1)];
        let value = Arc::new("value");
        let (first, second) = (room.leave(b, Arc::clone(&value)), room.leave(b, Arc::new("next")));
        assert_eq!(room.take(b, &second).as_deref(), Some(&"next"));
        assert!(room.take(a, &first).is_none(), "it is for somebody else");
        assert!(Arc::ptr_eq(&room.take(b, &first).unwrap(), &value));
        assert!(room.take(b, &first).is_none());
    }

    #[test]
    fn nothing_is_kept_for_who_has_left() {
        let room = Room::new();
        let (me, value) = (FederateId(3), Arc::new(()));
        room.leave(me, Arc::clone(&value));
        room.clear(me);
        let late = room.leave(me, Arc::clone(&value));
        assert_eq!(Arc::strong_count(&value), 1);
        assert!(room.take(me, &late).is_none());
    }
}
