//! What ports and actions hold: a Python object, an encoded one, or both.
//!
//! An object that stays within the process is passed on as it is. One that arrived is decoded when
//! somebody reads it; one that leaves is encoded once, however many take it.

use std::sync::{Arc, Mutex, PoisonError};

use hprm_core::{FederateId, Payload, PhysicalTime};
use hprm_store::{Object, Store};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;

use crate::buffer::Part;
use crate::codec::Codec;
use crate::serialize::Encoded;

/// A value of the program. Clones share it.
#[derive(Clone)]
pub(crate) struct Value(Arc<Shared>);

struct Shared {
    object: PyOnceLock<Py<PyAny>>,
    arrival: Option<Arrival>,
    /// The encodings that were made, each with the codec that made it.
    encodings: Mutex<Vec<(Arc<Codec>, Arc<Encoded>)>>,
}

/// A value as it came from another federate.
struct Arrival {
    at: PhysicalTime,
    codec: Arc<Codec>,
    head: Vec<u8>,
    parts: Vec<Part>,
}

impl Value {
    /// A value of this process.
    pub(crate) fn new(object: &Bound<'_, PyAny>) -> Self {
        let cell = PyOnceLock::new();
        // A new cell is empty, so this cannot fail.
        let _ = cell.set(object.py(), object.clone().unbind());
        Self(Arc::new(Shared { object: cell, arrival: None, encodings: Mutex::default() }))
    }

    /// A value that arrived at `at`; `objects` are those of the payload, in its order.
    pub(crate) fn arrived(
        codec: Arc<Codec>,
        payload: Payload,
        objects: Vec<Object>,
        at: PhysicalTime,
    ) -> Self {
        let mut objects = objects.into_iter();
        let parts = payload.parts.into_iter().filter_map(|part| match part {
            hprm_core::Part::Inline(bytes) => Some(Part::Inline(Arc::new(bytes))),
            hprm_core::Part::Object(_) => objects.next().map(Part::Object),
        });
        let arrival = Arrival { at, codec, head: payload.head, parts: parts.collect() };
        Self(Arc::new(Shared {
            object: PyOnceLock::new(),
            arrival: Some(arrival),
            encodings: Mutex::default(),
        }))
    }

    /// The object, decoded if it has not been.
    ///
    /// # Errors
    ///
    /// If what arrived cannot be decoded.
    pub(crate) fn object<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let object = self.0.object.get_or_try_init(py, || match &self.0.arrival {
            Some(Arrival { codec, head, parts, .. }) => codec.decode(py, head, parts),
            None => unreachable!("a value that did not arrive has its object from the start"),
        })?;
        Ok(object.bind(py).clone())
    }

    /// The physical time at which the value arrived, if it came from another federate.
    pub(crate) fn arrival(&self) -> Option<PhysicalTime> {
        self.0.arrival.as_ref().map(|arrival| arrival.at)
    }

    /// The value as `codec` writes it. Its objects stay in `store` as long as a clone of the value.
    ///
    /// # Errors
    ///
    /// If it cannot be encoded.
    pub(crate) fn encoded(
        &self,
        py: Python<'_>,
        codec: &Arc<Codec>,
        store: &mut Store,
        owner: FederateId,
    ) -> PyResult<Payload> {
        if let Some(payload) = self.as_it_came(py, codec) {
            return Ok(payload);
        }
        if let Some(encoded) = self.known(codec) {
            return Ok(encoded.payload.clone());
        }
        let encoded = Arc::new(codec.encode(&self.object(py)?, store, owner)?);
        let mut encodings = self.0.encodings.lock().unwrap_or_else(PoisonError::into_inner);
        encodings.push((Arc::clone(codec), Arc::clone(&encoded)));
        Ok(encoded.payload.clone())
    }

    fn known(&self, codec: &Arc<Codec>) -> Option<Arc<Encoded>> {
        let encodings = self.0.encodings.lock().unwrap_or_else(PoisonError::into_inner);
        let known = encodings.iter().find(|(with, _)| Arc::ptr_eq(with, codec));
        known.map(|(_, encoded)| Arc::clone(encoded))
    }

    /// The bytes that arrived, to be passed on. Not with objects: they are their owner's to lend,
    /// and to readers that it knows of.
    fn as_it_came(&self, py: Python<'_>, codec: &Arc<Codec>) -> Option<Payload> {
        let arrival = self.0.arrival.as_ref()?;
        let inline = |part: &Part| match part {
            Part::Inline(bytes) => Some(hprm_core::Part::Inline(bytes.to_vec())),
            Part::Object(_) => None,
        };
        // Decoded values may have been changed since.
        let untouched = Arc::ptr_eq(&arrival.codec, codec) && self.0.object.get(py).is_none();
        if !untouched {
            return None;
        }
        let parts = arrival.parts.iter().map(inline).collect::<Option<Vec<_>>>()?;
        Some(Payload { head: arrival.head.clone(), parts, ..Payload::default() })
    }
}
