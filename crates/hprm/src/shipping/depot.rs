//! The memory of one federation on this machine: what has come for its federates, and which of them read it.

use std::collections::{BTreeMap, VecDeque};

use hprm_core::{FederateId, PhysicalTime, Shipment, StoreOptions};
use hprm_store::{Announcement, Object, Store, StoreError, WritableLoan};

use super::SERVICE;
use crate::store_limits;

/// How many shipments are remembered: one that is sent again, because its receipt was lost, is not delivered again.
const REMEMBERED: usize = 4096;

/// See the module.
#[derive(Debug)]
pub(super) struct Depot {
    store: Store,
    /// The processes that read here, by the number that each has as a reader: of a federate there may be two.
    readers: BTreeMap<FederateId, FederateId>,
    remembered: VecDeque<(u64, u64)>,
    /// When it was last used.
    pub(super) used_at: PhysicalTime,
}

/// What a reader gets of a shipment.
#[derive(Debug)]
pub(super) struct Delivery {
    pub(super) reader: FederateId,
    pub(super) uses: u32,
    /// Segments that it has to map before.
    pub(super) mapped: Vec<Announcement>,
    /// Segments that it may unmap.
    pub(super) retired: Vec<u32>,
}

impl Depot {
    pub(super) fn new(now: PhysicalTime) -> Self {
        let store = Store::new(SERVICE, store_limits(StoreOptions::default()));
        Self { store, readers: BTreeMap::new(), remembered: VecDeque::new(), used_at: now }
    }

    /// Adds a process of a federate. Returns its number as a reader; none if there are too many.
    pub(super) fn add_reader(&mut self, federate: FederateId) -> Option<FederateId> {
        let reader = (0..SERVICE.0).map(FederateId).find(|it| !self.readers.contains_key(it))?;
        self.readers.insert(reader, federate);
        Some(reader)
    }

    /// A reader is gone, and holds nothing any more.
    pub(super) fn remove_reader(&mut self, reader: FederateId) {
        self.readers.remove(&reader);
        self.store.reader_lost(reader);
    }

    /// How many bytes are held here.
    pub(super) fn bytes_in_use(&mut self) -> u64 {
        self.store.stats().bytes_in_use
    }

    /// Whether no process reads here.
    pub(super) fn is_unread(&self) -> bool {
        self.readers.is_empty()
    }

    /// Whether a shipment has been delivered already.
    pub(super) fn remembers(&self, shipment: Shipment) -> bool {
        self.remembered.contains(&shipment.key())
    }

    /// Memory for a shipment.
    ///
    /// # Errors
    ///
    /// If there is none.
    pub(super) fn loan(&mut self, len: u64) -> Result<WritableLoan, StoreError> {
        self.store.loan(usize::try_from(len).unwrap_or(usize::MAX))
    }

    /// A shipment is complete: `receivers` hold it from now on, and the service as long as it keeps the object that this
    /// returns.
    pub(super) fn deliver(
        &mut self,
        shipment: Shipment,
        loan: WritableLoan,
        receivers: &[(FederateId, u32)],
    ) -> (Object, Vec<Delivery>) {
        self.remember(shipment);
        let object = self.store.publish(loan);
        let serial = object.object_ref().serial;
        let mut deliveries = Vec::new();
        for (reader, federate) in &self.readers {
            let named = receivers.iter().find(|(receiver, _)| receiver == federate);
            let Some(&(_, uses)) = named else { continue };
            for _ in 0..uses {
                let added = self.store.add_reader(serial, *reader);
                added.expect("the service holds what it has just published");
            }
            deliveries.push(Delivery {
                reader: *reader,
                uses,
                mapped: self.store.unannounced(*reader),
                retired: self.store.retired(*reader),
            });
        }
        (object, deliveries)
    }

    fn remember(&mut self, shipment: Shipment) {
        self.remembered.push_back(shipment.key());
        if self.remembered.len() > REMEMBERED {
            self.remembered.pop_front();
        }
    }

    /// A reader does not read these objects any more.
    pub(super) fn release(&mut self, reader: FederateId, serials: &[u64]) {
        for serial in serials {
            // A hold that the store does not know is an error of the reader, and harmless.
            let _ = self.store.release(*serial, reader);
        }
    }

    /// The readers that are processes of these federates.
    pub(super) fn readers_of(&self, receivers: &[(FederateId, u32)]) -> Vec<FederateId> {
        let is_meant = |federate: &FederateId| receivers.iter().any(|(it, _)| it == federate);
        let of = self.readers.iter().filter(|(_, federate)| is_meant(federate));
        of.map(|(reader, _)| *reader).collect()
    }
}
