//! A process of a federate, as the shipping service of its machine sees it: the connection, and what it reads and waits
//! for.

use std::collections::BTreeMap;
use std::os::fd::{AsFd, OwnedFd};

use hprm_core::{FederateId, PhysicalTime, Shipment};
use hprm_federated::FederationId;
use hprm_store::{Object, Store, StoreLimits};

use super::SERVICE;
use super::depot::Delivery;
use super::records::Told;
use crate::records::{self, RecordQueue, RecordSocket};

/// The most records that wait for one federate.
const MOST_WAITING: usize = 1 << 16;

/// A process of a federate on this machine.
#[derive(Debug)]
pub(super) struct Customer {
    pub(super) queue: RecordQueue,
    pub(super) joined: Option<Joined>,
    /// Its segments.
    pub(super) store: Store,
    /// What its messages wait for: which machine it comes from, and since when there is no link from there.
    pub(super) expects: BTreeMap<(u64, u64), (Shipment, String, PhysicalTime)>,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Joined {
    pub(super) federation: FederationId,
    pub(super) federate: FederateId,
    /// Its number in the depot.
    pub(super) reader: FederateId,
}

impl Customer {
    pub(super) fn new(socket: RecordSocket) -> Self {
        Self {
            queue: RecordQueue::new(socket),
            joined: None,
            store: Store::new(SERVICE, StoreLimits::default()),
            expects: BTreeMap::new(),
        }
    }

    pub(super) fn tell(&mut self, told: &Told, with: Option<OwnedFd>) -> Option<()> {
        self.queue.push(records::encode(told), with).ok()?;
        (self.queue.waiting() <= MOST_WAITING).then_some(())
    }

    /// Hands over a shipment.
    pub(super) fn hand(
        &mut self,
        shipment: Shipment,
        object: &Object,
        delivery: Delivery,
    ) -> Option<()> {
        let Delivery { uses, mapped, retired, .. } = delivery;
        for announcement in mapped {
            let descriptor = announcement.as_fd().try_clone_to_owned().ok()?;
            let (segment, len) = (announcement.segment, announcement.len);
            self.tell(&Told::Segment { segment, len }, Some(descriptor))?;
        }
        if !retired.is_empty() {
            self.tell(&Told::Retired { segments: retired }, None)?;
        }
        self.expects.remove(&(shipment.stream, shipment.number));
        self.tell(&Told::Arrived { shipment, object: object.object_ref(), uses }, None)
    }

    pub(super) fn lose(&mut self, shipment: Shipment, why: &str) {
        self.expects.remove(&(shipment.stream, shipment.number));
        // A federate that is gone is noticed when it is read.
        let _ = self.tell(&Told::Lost { shipment, why: why.to_owned() }, None);
    }

    pub(super) fn settle(&mut self) -> Option<()> {
        let released = self.store.drain_releases();
        if !released.is_empty() {
            let serials = released.into_iter().map(|object| object.serial).collect();
            self.tell(&Told::Released { serials }, None)?;
        }
        self.queue.settle().ok()
    }
}
