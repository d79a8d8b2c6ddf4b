//! A federate's side of the object store: what it shares, and what it has been given.
//!
//! The store knows memory; this knows which descriptor goes with which frame.

use std::collections::BTreeMap;
use std::os::fd::{AsFd, OwnedFd};

use hprm_core::{FederateId, Part, Payload};
use hprm_federated::Frame;
use hprm_store::{Announcement, Object, Store};

use crate::Failure;

/// The store, and the descriptors of its segments that are about to leave.
pub(super) struct Objects {
    store: Store,
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
        Self { store, leaving: BTreeMap::new() }
    }

    pub(super) fn store(&mut self) -> &mut Store {
        &mut self.store
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
        for object in payload.objects() {
            self.store.add_reader(object.serial, reader).map_err(|error| failure(&error))?;
        }
        let mut mapped = Vec::new();
        for announcement in self.store.unannounced(reader) {
            mapped.push((announcement.segment, announcement.len));
            self.leaving.insert((reader, announcement.segment), announcement);
        }
        Ok(Changes { mapped, retired: self.store.retired(reader) })
    }

    /// The payload with the bytes themselves in place of references.
    pub(super) fn inline(&mut self, mut payload: Payload) -> Result<Payload, Failure> {
        for part in &mut payload.parts {
            if let Part::Object(object) = part {
                // A hold of its own, for opening ends one.
                let owner = object.owner;
                self.store.add_reader(object.serial, owner).map_err(|error| failure(&error))?;
                let bytes = self.store.open(*object).map_err(|error| failure(&error))?;
                *part = Part::Inline(bytes.as_bytes().to_vec());
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
            .map_err(|error| failure(&error))
    }

    pub(super) fn attach(
        &mut self,
        owner: FederateId,
        segment: u32,
        len: u64,
        descriptor: Option<OwnedFd>,
    ) -> Result<(), Failure> {
        let descriptor = descriptor.ok_or_else(|| {
            Failure::new("error: a segment of the object store came without its descriptor")
        })?;
        self.store.attach(owner, segment, len, descriptor).map_err(|error| failure(&error))
    }

    /// Views of the objects that a payload refers to.
    pub(super) fn open(&mut self, payload: &Payload) -> Result<Vec<Object>, Failure> {
        payload
            .objects()
            .map(|object| self.store.open(object).map_err(|error| failure(&error)))
            .collect()
    }

    /// Unmaps what an owner does not use any more, once nobody here views it.
    pub(super) fn retired(&mut self, owner: FederateId, segments: &[u32]) {
        for segment in segments {
            self.store.detach(owner, *segment);
        }
    }

    /// Takes back holds. One that is not known is a reader's error, and no harm is done.
    pub(super) fn released(&mut self, reader: FederateId, serials: &[u64]) {
        for serial in serials {
            let _ = self.store.release(*serial, reader);
        }
    }

    /// The objects of others that nothing here refers to any more, by owner.
    pub(super) fn dropped(&mut self) -> BTreeMap<FederateId, Vec<u64>> {
        let mut serials: BTreeMap<_, Vec<u64>> = BTreeMap::new();
        for object in self.store.drain_releases() {
            serials.entry(object.owner).or_default().push(object.serial);
        }
        serials
    }
}

fn failure(error: &dyn std::fmt::Display) -> Failure {
    Failure::new(format!("error: the object store: {error}"))
}
