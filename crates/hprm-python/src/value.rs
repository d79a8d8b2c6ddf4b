//! What ports and actions hold: a Python object, an encoded one, or both.
//!
//! An object that stays within the process is shared as it is. One that was received is decoded at the
//! first read; one that is sent is encoded once for all receivers. To another federate of the process, a
//! [`Parcel`] is sent.

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use hprm::trace::Described;
use hprm_core::{FederateId, Payload, PhysicalTime};
use hprm_store::{Object, StoreAllocator};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;

use crate::backlog::Share;
use crate::buffer::ReceivedPart;
use crate::codec::Codec;
use crate::failure::no_memory;
use crate::parcel::Parcel;
use crate::serialize::{Encoded, Trust};

/// A value of the program. Clones share it.
#[derive(Clone)]
pub(crate) struct Value(Arc<Shared>);

struct Shared {
    origin: Origin,
    /// Not read: as long as it lives, the value waits among those that threads have scheduled.
    _share: Option<Share>,
    /// The encodings that were made, each with the codec that made it.
    encodings: Mutex<Vec<(Arc<Codec>, Arc<Encoded>)>>,
    /// The parcels that were made, likewise.
    parcels: Mutex<Vec<(Arc<Codec>, Arc<Parcel>)>>,
    /// What the logical trace says of it, if that cannot change any more.
    described: OnceLock<Box<Described>>,
}

/// Where a value comes from.
enum Origin {
    /// This federate has made it: the object.
    Created(Py<PyAny>),
    /// Another federate has sent it.
    Received(Arrival),
    /// Another federate of the process has sent it, and the receiver has not taken it yet.
    InTransit(Arc<Parcel>),
}

/// A value as another federate has sent it.
struct Arrival {
    at: PhysicalTime,
    codec: Arc<Codec>,
    content: Content,
    /// How far its sender is trusted.
    trust: Trust,
    /// The object, as soon as it has been decoded.
    object: PyOnceLock<Py<PyAny>>,
}

enum Content {
    /// From another process.
    Bytes { head: Vec<u8>, parts: Vec<ReceivedPart> },
    /// From another thread.
    Parcel(Arc<Parcel>),
}

impl Value {
    /// A value of this process.
    pub(crate) fn new(object: &Bound<'_, PyAny>) -> Self {
        Self::of(Origin::Created(object.clone().unbind()))
    }

    /// A value of this process that a thread schedules.
    pub(crate) fn scheduled(object: &Bound<'_, PyAny>, share: Share) -> Self {
        Self::with(Origin::Created(object.clone().unbind()), Some(share))
    }

    /// A value that arrived at `at`; `objects` are those of the payload, in its order.
    pub(crate) fn arrived(
        (codec, trust): (Arc<Codec>, Trust),
        payload: Payload,
        objects: Vec<Object>,
        at: PhysicalTime,
    ) -> Self {
        let mut objects = objects.into_iter();
        let parts = payload.parts.into_iter().filter_map(|part| match part {
            hprm_core::Part::Inline(bytes) => Some(ReceivedPart::Inline(Arc::new(bytes))),
            hprm_core::Part::Object(_) => objects.next().map(ReceivedPart::Object),
            hprm_core::Part::Shipped(_) => None,
        });
        let content = Content::Bytes { head: payload.head, parts: parts.collect() };
        Self::received(at, codec, content, trust)
    }

    /// The value as it is sent to another federate of this process, encoded by `codec` if it has to be, and its bytes.
    ///
    /// # Errors
    ///
    /// If it cannot be encoded and must be.
    pub(crate) fn sent_in_process(
        &self,
        py: Python<'_>,
        codec: &Arc<Codec>,
        trust: Trust,
    ) -> PyResult<(Self, u64)> {
        let known = find(&self.0.parcels, codec).or_else(|| self.received_parcel(py, codec));
        let parcel = match known {
            Some(parcel) => parcel,
            None => {
                let parcel = Arc::new(Parcel::pack(&self.object(py)?, codec, trust)?);
                let mut parcels = self.0.parcels.lock().unwrap_or_else(PoisonError::into_inner);
                parcels.push((Arc::clone(codec), Arc::clone(&parcel)));
                parcel
            }
        };
        let bytes = parcel.bytes();
        Ok((Self::of(Origin::InTransit(parcel)), bytes))
    }

    /// The value as the receiving federate has it, of what [`Self::sent_in_process`] has returned to the sender.
    /// It arrived at `at`.
    pub(crate) fn received_in_process(
        self,
        codec: Arc<Codec>,
        trust: Trust,
        at: PhysicalTime,
    ) -> Self {
        let Origin::InTransit(parcel) = &self.0.origin else { return self };
        let content = Content::Parcel(Arc::clone(parcel));
        Self::received(at, codec, content, trust)
    }

    fn received(at: PhysicalTime, codec: Arc<Codec>, content: Content, trust: Trust) -> Self {
        let object = PyOnceLock::new();
        Self::of(Origin::Received(Arrival { at, codec, content, trust, object }))
    }

    fn of(origin: Origin) -> Self {
        Self::with(origin, None)
    }

    fn with(origin: Origin, share: Option<Share>) -> Self {
        let (encodings, parcels) = (Mutex::default(), Mutex::default());
        let described = OnceLock::new();
        Self(Arc::new(Shared { origin, _share: share, encodings, parcels, described }))
    }

    /// The object, decoded if it has not been.
    ///
    /// # Errors
    ///
    /// If what arrived cannot be decoded.
    pub(crate) fn object<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let object = match &self.0.origin {
            Origin::Created(object) => object,
            Origin::Received(arrival) => arrival.object(py)?,
            Origin::InTransit(_) => {
                unreachable!("the receiver makes a received value of it before it is read")
            }
        };
        Ok(object.bind(py).clone())
    }

    /// The description of the value for the logical trace, as it is now. Code that has the object may
    /// change it at any time, so this is computed again unless the value cannot be changed.
    pub(crate) fn described(&self, py: Python<'_>) -> Described {
        if let Some(described) = self.0.described.get() {
            return Described::clone(described);
        }
        let Ok(object) = self.object(py) else {
            return Described::opaque("a value that cannot be decoded");
        };
        let (described, fixed) = crate::digest::describe(&object);
        if fixed {
            // Another thread that was quicker has the same result.
            let _ = self.0.described.set(Box::new(described.clone()));
        }
        described
    }

    /// The physical time at which the value arrived, if it came from another federate.
    pub(crate) fn arrival(&self) -> Option<PhysicalTime> {
        self.arrived_as().map(|arrival| arrival.at)
    }

    /// The value as `codec` writes it for a receiver with that trust. Its objects stay in `store` as long as
    /// a clone of the value.
    ///
    /// # Errors
    ///
    /// If it cannot be encoded.
    pub(crate) fn encoded(
        &self,
        py: Python<'_>,
        codec: &Arc<Codec>,
        store: &StoreAllocator,
        owner: FederateId,
        trust: Trust,
    ) -> PyResult<Payload> {
        let known = find(&self.0.encodings, codec);
        if let Some(encoded) = known.filter(|known| trust.permits_pickle() || !known.pickled) {
            return encoded.payload.try_clone().map_err(no_memory);
        }
        let encoded = match self.received_payload(py, codec, store, trust) {
            Some(encoded) => encoded,
            None => codec.encode(&self.object(py)?, store, owner, trust)?,
        };
        let encoded = Arc::new(encoded);
        let mut encodings = self.0.encodings.lock().unwrap_or_else(PoisonError::into_inner);
        encodings.push((Arc::clone(codec), Arc::clone(&encoded)));
        encoded.payload.try_clone().map_err(no_memory)
    }

    fn arrived_as(&self) -> Option<&Arrival> {
        match &self.0.origin {
            Origin::Received(arrival) => Some(arrival),
            Origin::Created(_) | Origin::InTransit(_) => None,
        }
    }

    /// The parcel in which the value was received, if it can be forwarded as it is.
    fn received_parcel(&self, py: Python<'_>, codec: &Arc<Codec>) -> Option<Arc<Parcel>> {
        let arrival = self.arrived_as()?;
        // Objects may have been changed since.
        let untouched = Arc::ptr_eq(&arrival.codec, codec) && arrival.object.get(py).is_none();
        match &arrival.content {
            Content::Parcel(parcel) if untouched => Some(Arc::clone(parcel)),
            _ => None,
        }
    }

    /// The payload in which the value was received, if it can be forwarded as it is.
    fn received_payload(
        &self,
        py: Python<'_>,
        codec: &Arc<Codec>,
        store: &StoreAllocator,
        trust: Trust,
    ) -> Option<Encoded> {
        let arrival = self.arrived_as()?;
        // Decoded values may have been changed since.
        let untouched = Arc::ptr_eq(&arrival.codec, codec) && arrival.object.get(py).is_none();
        let Content::Bytes { head, parts } = &arrival.content else { return None };
        let pickled = codec.is_pickled(head, parts);
        if !untouched || pickled && !trust.permits_pickle() {
            return None;
        }
        Encoded::forwarded(head, parts, pickled, store)
    }
}

impl Arrival {
    /// The object, decoded if it has not been.
    fn object(&self, py: Python<'_>) -> PyResult<&Py<PyAny>> {
        self.object.get_or_try_init(py, || match &self.content {
            Content::Bytes { head, parts } => self.codec.decode(py, head, parts, self.trust),
            Content::Parcel(parcel) => parcel.open(py, &self.codec, self.trust),
        })
    }
}

/// What was made for a codec.
fn find<T>(made: &Mutex<Vec<(Arc<Codec>, Arc<T>)>>, codec: &Arc<Codec>) -> Option<Arc<T>> {
    let made = made.lock().unwrap_or_else(PoisonError::into_inner);
    made.iter().find(|(with, _)| Arc::ptr_eq(with, codec)).map(|(_, what)| Arc::clone(what))
}
