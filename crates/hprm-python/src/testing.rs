//! Serialization without a federation, for the tests of the package.

use hprm::Pickling;
use hprm_core::{FederateId, Part};
use hprm_store::{Object, Store, StoreAllocator, StoreLimits};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyList};
use std::sync::Arc;

use crate::api;
use crate::buffer::ReceivedPart;
use crate::codec::Codec;
use crate::serialize::{self, Place, Trust};
use crate::value::Value;

/// The description of a value in a trace: the digest, the text, and whether a part of it is opaque.
#[pyfunction]
pub(crate) fn digest(value: &Bound<'_, PyAny>) -> (String, String, bool) {
    let (described, _) = crate::digest::describe(value);
    (described.digest.to_string(), described.text, described.opaque)
}

/// The head and the parts of a value, as it travels where there is no shared memory; to a federate
/// of the same user and machine, if it is `local`.
#[pyfunction]
#[pyo3(signature = (value, local = true))]
pub(crate) fn encode<'py>(
    value: &Bound<'py, PyAny>,
    local: bool,
) -> PyResult<(Bound<'py, PyBytes>, Vec<Bound<'py, PyBytes>>)> {
    let py = value.py();
    let payload =
        serialize::encode(value, Place::inline(), Trust::new(Pickling::Local, local))?.payload;
    let parts = payload.parts.iter().filter_map(|part| match part {
        Part::Inline(bytes) => Some(PyBytes::new(py, bytes)),
        Part::Object(_) | Part::Shipped(_) => None,
    });
    Ok((PyBytes::new(py, &payload.head), parts.collect()))
}

/// The value of a head and its parts.
#[pyfunction]
#[pyo3(signature = (head, parts, local = true))]
pub(crate) fn decode<'py>(
    py: Python<'py>,
    head: &[u8],
    parts: Vec<Vec<u8>>,
    local: bool,
) -> PyResult<Bound<'py, PyAny>> {
    let parts: Vec<_> =
        parts.into_iter().map(|bytes| ReceivedPart::Inline(Arc::new(bytes))).collect();
    serialize::decode(py, head, &parts, Trust::new(Pickling::Local, local))
}

/// Sends `value` through stores, as one federate does to `readers` others. Returns what each of them
/// gets, and the numbers of the sender's store.
#[pyfunction]
#[pyo3(signature = (value, readers, capacity = None))]
pub(crate) fn store_round_trip<'py>(
    value: &Bound<'py, PyAny>,
    readers: u16,
    capacity: Option<u64>,
) -> PyResult<(Bound<'py, PyList>, Bound<'py, PyDict>)> {
    let py = value.py();
    let default = StoreLimits::default();
    let capacity_bytes = capacity.unwrap_or(default.capacity_bytes);
    let owner = FederateId(0);
    let limits = StoreLimits { capacity_bytes, ..default };
    let sender = StoreAllocator::new(Store::new(owner, limits));
    let (value, codec) = (Value::new(value), Arc::new(Codec::Native));
    let trust = Trust::new(Pickling::Local, true);
    let values = PyList::empty(py);
    for reader in (1..=readers).map(FederateId) {
        let payload = value.encoded(py, &codec, &sender, owner, trust)?;
        let objects =
            pass(&mut sender.store(), reader, &payload).map_err(PyRuntimeError::new_err)?;
        let now = hprm::Clock::now();
        let way = (Arc::clone(&codec), trust);
        values.append(Value::arrived(way, payload, objects, now).object(py)?)?;
    }
    Ok((values, api::stats(py, sender.store().stats())?))
}

/// Hands the objects of a payload to a reader.
fn pass(
    sender: &mut Store,
    reader: FederateId,
    payload: &hprm_core::Payload,
) -> Result<Vec<Object>, String> {
    let mut store = Store::new(reader, StoreLimits::default());
    for object in payload.objects() {
        sender.add_reader(object.serial, reader).map_err(|error| error.to_string())?;
    }
    for segment in sender.unannounced(reader) {
        let fd = std::os::fd::AsFd::as_fd(&segment).try_clone_to_owned();
        let fd = fd.map_err(|error| error.to_string())?;
        let attached = store.attach(FederateId(0), segment.segment, segment.len, fd);
        attached.map_err(|error| error.to_string())?;
    }
    payload.objects().map(|object| store.open(object).map_err(|error| error.to_string())).collect()
}
