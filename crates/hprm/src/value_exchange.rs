//! A federation in one process: its federates are threads, which exchange values as they are.
//!
//! The machines and the loops are those of a federation of processes. What differs is here: frames
//! go through queues, and a message carries the number of its value in the exchange.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use hprm_core::{FederateId, Payload};

use crate::link::{Hub, Network};
use crate::{Failure, Rti, RtiOptions};

/// What the threads of a federation share. Clones share one exchange.
#[derive(Debug)]
pub struct ValueExchange<V> {
    hub: Arc<Hub>,
    in_transit: Arc<InTransit<V>>,
}

/// Values that were sent and not received yet, by receiver and number. None for a receiver that has left.
#[derive(Debug)]
struct InTransit<V> {
    next: AtomicU64,
    values: Mutex<BTreeMap<FederateId, Option<BTreeMap<u64, V>>>>,
}

impl<V> Clone for ValueExchange<V> {
    fn clone(&self) -> Self {
        Self { hub: Arc::clone(&self.hub), in_transit: Arc::clone(&self.in_transit) }
    }
}

impl<V> Default for ValueExchange<V> {
    fn default() -> Self {
        let in_transit = InTransit { next: AtomicU64::new(0), values: Mutex::default() };
        Self { hub: Arc::default(), in_transit: Arc::new(in_transit) }
    }
}

impl<V> ValueExchange<V> {
    /// An empty exchange.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// The RTI of a federation with this exchange. Its address is a name, which means nothing outside.
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

    /// Puts a value of so many bytes for a federate into the exchange. Returns the payload that stands for it in a message.
    pub(crate) fn put(&self, to: FederateId, (value, bytes): (V, u64)) -> Payload {
        let number = self.in_transit.next.fetch_add(1, Ordering::Relaxed);
        if let Some(values) = self.values().entry(to).or_insert_with(|| Some(BTreeMap::new())) {
            values.insert(number, value);
        }
        Payload::reference(number, bytes)
    }

    /// Takes the value of a message to `me`. Each message has its own.
    pub(crate) fn take(&self, me: FederateId, payload: &Payload) -> Option<V> {
        let (number, _) = payload.referred()?;
        self.values().get_mut(&me)?.as_mut()?.remove(&number)
    }

    /// Drops the values for a federate that has ended, and from now on all further ones.
    pub(crate) fn clear(&self, me: FederateId) {
        let values = self.values().insert(me, None);
        // Without holding the lock: dropping a value may run any code.
        drop(values);
    }

    fn values(&self) -> MutexGuard<'_, BTreeMap<FederateId, Option<BTreeMap<u64, V>>>> {
        self.in_transit.values.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use hprm_core::FederateId;

    use super::ValueExchange;

    #[test]
    fn each_message_has_its_own_value() {
        let exchange = ValueExchange::new();
        let [a, b] = [FederateId(0), FederateId(1)];
        let value = Arc::new("value");
        let (first, second) =
            (exchange.put(b, (Arc::clone(&value), 0)), exchange.put(b, (Arc::new("next"), 0)));
        assert_eq!(exchange.take(b, &second).as_deref(), Some(&"next"));
        assert!(exchange.take(a, &first).is_none(), "it is for another federate");
        assert!(Arc::ptr_eq(&exchange.take(b, &first).unwrap(), &value));
        assert!(exchange.take(b, &first).is_none());
    }

    #[test]
    fn nothing_is_kept_for_a_federate_that_has_left() {
        let exchange = ValueExchange::new();
        let (me, value) = (FederateId(3), Arc::new(()));
        exchange.put(me, (Arc::clone(&value), 0));
        exchange.clear(me);
        let late = exchange.put(me, (Arc::clone(&value), 0));
        assert_eq!(Arc::strong_count(&value), 1);
        assert!(exchange.take(me, &late).is_none());
    }
}
