//! A process of a federate, as the shipping service of its machine sees it: the connection, and what it reads and waits
//! for.

use std::collections::BTreeMap;
use std::os::fd::{AsFd, OwnedFd};

use hprm_core::{FederateId, Nanos, PhysicalTime, Shipment};
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
    /// Whether it takes nothing any more. What it has sent before may still be there to be read, so only a read tells that
    /// it has ended.
    is_deaf: bool,
    /// What its messages wait for.
    expects: BTreeMap<(u64, u64), Expected>,
}

/// A shipment for which a message waits.
#[derive(Clone, Debug)]
struct Expected {
    shipment: Shipment,
    /// The machine from which it comes.
    from: String,
    /// Since when there is no link from there.
    since: PhysicalTime,
    /// Whether the link has ended on which the message came.
    link_ended: bool,
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
            is_deaf: false,
            expects: BTreeMap::new(),
        }
    }

    /// Tells the federate something; none if too much waits for it.
    pub(super) fn tell(&mut self, told: &Told, with: Option<OwnedFd>) -> Option<()> {
        if self.is_deaf {
            return Some(());
        }
        self.is_deaf = self.queue.push(records::encode(told), with).is_err();
        (self.queue.waiting() <= MOST_WAITING).then_some(())
    }

    /// Whether something waits for room in the connection.
    pub(super) fn has_waiting(&self) -> bool {
        !self.is_deaf && self.queue.waiting() > 0
    }

    /// Hands over a shipment; none if that cannot be.
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
        self.expects.remove(&shipment.key());
        self.tell(&Told::Arrived { shipment, object: object.object_ref(), uses }, None)
    }

    /// A message waits for a shipment from a machine.
    pub(super) fn expect(
        &mut self,
        shipment: Shipment,
        (from, link_ended): (String, bool),
        now: PhysicalTime,
    ) {
        let expected = Expected { shipment, from, since: now, link_ended };
        self.expects.insert(shipment.key(), expected);
    }

    /// There is no link from a machine any more. The next one brings what is missing, if that machine is there.
    pub(super) fn gone(&mut self, machine: &str, now: PhysicalTime) {
        let mut lost = Vec::new();
        for expected in self.expects.values_mut().filter(|it| it.from == machine) {
            expected.since = now;
            lost.extend(expected.link_ended.then_some(expected.shipment));
        }
        for shipment in lost {
            self.lose(shipment, &format!("the link from the agent of {machine} has ended"));
        }
    }

    /// Some machines are reached now; from the others, nothing may come for that long.
    pub(super) fn look(
        &mut self,
        now: PhysicalTime,
        patience: Nanos,
        is_reached: impl Fn(&str) -> bool,
    ) {
        let mut lost = Vec::new();
        for expected in self.expects.values_mut() {
            if is_reached(&expected.from) {
                expected.since = now;
            } else if now.since(expected.since) > patience {
                lost.push(expected.clone());
            }
        }
        for Expected { shipment, from, .. } in lost {
            self.lose(shipment, &format!("nothing comes from the agent of {from}"));
        }
    }

    /// A shipment will not come.
    pub(super) fn lose(&mut self, shipment: Shipment, why: &str) {
        self.expects.remove(&shipment.key());
        // A federate for which too much waits is noticed when it is settled.
        let _ = self.tell(&Told::Lost { shipment, why: why.to_owned() }, None);
    }

    /// Tells the federate which of its objects are not read any more, and writes what waits; none if that is too much.
    pub(super) fn settle(&mut self) -> Option<()> {
        let released = self.store.drain_releases();
        if !released.is_empty() {
            let serials = released.into_iter().map(|object| object.serial).collect();
            self.tell(&Told::Released { serials }, None)?;
        }
        self.is_deaf |= self.queue.settle().is_err();
        Some(())
    }
}
