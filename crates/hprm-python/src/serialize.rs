//! Adaptive serialization: a value as a head, and large buffers that are shared rather than copied.
//!
//! [`encode`] and [`decode`] are inverse to each other for every value that pickle takes, and for
//! every layout of an array; an array that was decoded is read-only and lies where it arrived. The
//! argument is never changed (paper, section III-C, adaptive serialization).

mod array;
mod decode;
mod encode;
mod format;
mod place;
mod sole;

use hprm_core::limits::INLINE_LIMIT;
use hprm_core::{FederateId, Payload};
use hprm_store::{Object, Store};
use pyo3::prelude::*;

pub(crate) use self::place::Place;
use crate::buffer::Part;

/// An encoded value, and what keeps its objects in the store.
#[derive(Debug)]
pub(crate) struct Encoded {
    /// What travels.
    pub(crate) payload: Payload,
    /// Not read: the objects stay in the store as long as these live.
    _holds: Vec<Object>,
}

/// Encodes `value`, with its large buffers in `place`. Arrays that live in the store, and that only
/// `value` leads to, stay where they are and become read-only; `value` itself is expected to have two
/// references, of its owner and of this call.
///
/// # Errors
///
/// If pickle cannot take the value, or the system has no memory.
pub(crate) fn encode(value: &Bound<'_, PyAny>, mut place: Place<'_>) -> PyResult<Encoded> {
    let py = value.py();
    place.reach(value);
    let draft = encode::encode(value)?;
    let mut parts = Vec::with_capacity(draft.sources.len());
    for source in &draft.sources {
        parts.push(place.put(py, source)?);
    }
    let mut head = draft.head;
    if head.len() > INLINE_LIMIT {
        parts.push(place.put_bytes(head)?);
        head = vec![format::INDIRECT];
    }
    Ok(Encoded {
        payload: Payload { head, parts, ..Payload::default() },
        _holds: place.into_holds(),
    })
}

/// Rebuilds a value from what arrived.
///
/// # Errors
///
/// If the bytes are no value, or if building it raises.
pub(crate) fn decode<'py>(
    py: Python<'py>,
    head: &[u8],
    parts: &[Part],
) -> PyResult<Bound<'py, PyAny>> {
    decode::decode(py, head, parts)
}

/// Encodes the bytes that a serializer of the program's own made.
///
/// # Errors
///
/// If the system has no memory.
pub(crate) fn wrap(bytes: &[u8], store: &mut Store, owner: FederateId) -> PyResult<Encoded> {
    let mut place = Place::store(store, owner);
    let payload = if bytes.len() > INLINE_LIMIT {
        Payload { parts: vec![place.put_bytes(bytes.to_vec())?], ..Payload::default() }
    } else {
        Payload { head: bytes.to_vec(), ..Payload::default() }
    };
    Ok(Encoded { payload, _holds: place.into_holds() })
}

/// The bytes that [`wrap`] encoded.
pub(crate) fn unwrap<'a>(head: &'a [u8], parts: &'a [Part]) -> &'a [u8] {
    parts.first().map_or(head, Part::as_bytes)
}
