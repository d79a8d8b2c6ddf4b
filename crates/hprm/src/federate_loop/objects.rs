//! The objects of a federate: those that it shares, and those that it has received.
//!
//! The store manages memory; this file decides which descriptor travels with which frame.

use std::collections::BTreeMap;
use std::os::fd::{AsFd, OwnedFd};
use std::sync::{Arc, MutexGuard};

use hprm_core::{FederateId, Part, Payload, copy_of};
use hprm_federated::Frame;
use hprm_store::{Announcement, Object, Store, StoreAllocator};

use super::links::no_memory;
use crate::Failure;

/// The store, and the descriptors of its segments that are about to leave.
pub(super) struct Objects {
    allocator: Arc<StoreAllocator>,
    leaving: BTreeMap<(FederateId, u32), Announcement>,
}

/// What a reader must be told of before a message.
#[derive(Default)]
pub(super) struct Changes {
    /// Segments that it has to map: number and length.
    pub(super) mapped: Vec<(u32, u64)>,
    /// Segments that it may unmap.
    pub(super) retired: Vec<u32>,
}

impl Objects {
    pub(super) fn new(store: Store) -> Self {
        Self { allocator: Arc::new(StoreAllocator::new(store)), leaving: BTreeMap::new() }
    }

    /// The store, and memory in it for values that the program is making.
    pub(super) fn allocator(&self) -> &Arc<StoreAllocator> {
        &self.allocator
    }

    pub(super) fn store(&self) -> MutexGuard<'_, Store> {
        self.allocator.store()
    }

    /// Makes `reader` a holder of the payload's objects.
    pub(super) fn share(
        &mut self,
        payload: &Payload,
        reader: FederateId,
    ) -> Result<Changes, Failure> {
        if payload.objects().next().is_none() {
            return Ok(Changes::default());
        }
        let mut store = self.allocator.store();
        for object in payload.objects() {
            store.add_reader(object.serial, reader).map_err(|error| Failure::store(&error))?;
        }
        let mut mapped = Vec::new();
        for announcement in store.unannounced(reader) {
            mapped.push((announcement.segment, announcement.len));
            self.leaving.insert((reader, announcement.segment), announcement);
        }
        Ok(Changes { mapped, retired: store.retired(reader) })
    }

    /// The payload with the bytes themselves in place of references.
    pub(super) fn inline(&self, mut payload: Payload) -> Result<Payload, Failure> {
        if payload.objects().next().is_none() {
            return Ok(payload);
        }
        let mut store = self.store();
        for part in &mut payload.parts {
            if let Part::Object(object) = part {
                // It needs a hold of its own, because opening an object ends one.
                let owner = object.owner;
                store.add_reader(object.serial, owner).map_err(|error| Failure::store(&error))?;
                let bytes = store.open(*object).map_err(|error| Failure::store(&error))?;
                let copy = copy_of(bytes.as_bytes()).map_err(|error| no_memory(&error))?;
                *part = Part::Inline(copy);
            }
        }
        Ok(payload)
    }

    /// The descriptor that travels with a frame.
    pub(super) fn descriptor_for(&mut self, frame: &Frame) -> Result<Option<OwnedFd>, Failure> {
        let Frame::Segment { reader, segment, .. } = frame else { return Ok(None) };
        self.leaving
            .remove(&(*reader, *segment))
            .map(|announcement| announcement.as_fd().try_clone_to_owned())
            .transpose()
            .map_err(|error| Failure::store(&error))
    }

    pub(super) fn attach(
        &self,
        owner: FederateId,
        segment: u32,
        len: u64,
        descriptor: Option<OwnedFd>,
    ) -> Result<(), Failure> {
        let descriptor =
            descriptor.ok_or_else(|| Failure::store(&"a segment came without its descriptor"))?;
        self.store().attach(owner, segment, len, descriptor).map_err(|error| Failure::store(&error))
    }

    /// Views of the objects that a payload refers to. Most have none, and then nothing locks the store.
    #[inline]
    pub(super) fn open(&self, payload: &Payload) -> Result<Vec<Object>, Failure> {
        match payload.parts.is_empty() {
            true => Ok(Vec::new()),
            false => self.open_parts(payload),
        }
    }

    fn open_parts(&self, payload: &Payload) -> Result<Vec<Object>, Failure> {
        let mut store = self.store();
        payload
            .objects()
            .map(|object| store.open(object).map_err(|error| Failure::store(&error)))
            .collect()
    }

    /// Unmaps segments that an owner does not use any more, once no object of them is open here.
    pub(super) fn retired(&self, owner: FederateId, segments: &[u32]) {
        for segment in segments {
            self.store().detach(owner, *segment);
        }
    }

    /// Ends holds of a reader. A hold that the store does not know is an error of the reader, and harmless.
    pub(super) fn released(&self, reader: FederateId, serials: &[u64]) {
        for serial in serials {
            let _ = self.store().release(*serial, reader);
        }
    }

    /// Whether this federate may have stopped to use objects of other ones.
    #[inline]
    pub(super) fn may_have_dropped(&self) -> bool {
        self.allocator.may_have_releases()
    }

    /// The objects of other federates that this one does not use any more, by owner.
    pub(super) fn dropped(&self) -> BTreeMap<FederateId, Vec<u64>> {
        let mut serials: BTreeMap<_, Vec<u64>> = BTreeMap::new();
        for object in self.allocator.drain_releases() {
            serials.entry(object.owner).or_default().push(object.serial);
        }
        serials
    }
}
