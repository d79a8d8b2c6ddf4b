//! Adaptive serialization: a value as a head, and large buffers that are shared rather than copied.
//!
//! [`encode`] and [`decode`] are inverse to each other for every value that pickle takes, and for
//! every layout of an array; an array that was decoded is a read-only view of the received bytes. The
//! argument is never changed (paper, section III-C, adaptive serialization). What needs no pickle is
//! in `docs/concepts/serialization.md`; [`Trust`] says whether one may be sent.

pub(crate) mod array;
mod decode;
mod encode;
mod kinds;
mod pickle_only;
mod place;
mod sole;
mod trust;

use hprm_codec::format;
use hprm_core::limits::INLINE_LIMIT;
use hprm_core::{FederateId, Payload, copy_of};
use hprm_store::{Object, StoreAllocator};
use pyo3::prelude::*;

use self::encode::EncodeError;
pub(crate) use self::place::Place;
pub(crate) use self::sole::{Sole, find as sole};
pub(crate) use self::trust::Trust;
use crate::buffer::ReceivedPart;

/// An encoded value, and what keeps its objects in the store.
#[derive(Debug)]
pub(crate) struct Encoded {
    /// What is sent.
    pub(crate) payload: Payload,
    /// Whether it is a pickle, which not every receiver may get.
    pub(crate) pickled: bool,
    /// Not read: the objects stay in the store as long as these live.
    _holds: Vec<Object>,
}

impl Encoded {
    /// A received value, unchanged; `None` if an object in it cannot be forwarded.
    pub(crate) fn forwarded(
        head: &[u8],
        parts: &[ReceivedPart],
        pickled: bool,
        store: &StoreAllocator,
    ) -> Option<Self> {
        let mut holds = Vec::new();
        let part = |part: &ReceivedPart| match part {
            ReceivedPart::Inline(bytes) => copy_of(bytes).ok().map(hprm_core::Part::Inline),
            ReceivedPart::Object(received) => {
                let object = store.store().forward(received)?;
                let part = hprm_core::Part::Object(object.object_ref());
                holds.push(object);
                Some(part)
            }
        };
        let parts = parts.iter().map(part).collect::<Option<_>>()?;
        let payload = Payload { head: head.to_vec(), parts, ..Payload::default() };
        Some(Self { payload, pickled, _holds: holds })
    }
}

/// Encodes `value` for a receiver with that trust, with its large buffers in `place`. Arrays in the store
/// that only `value` refers to stay where they are and become read-only; `value` itself
/// is expected to have two references, of its owner and of this call.
///
/// # Errors
///
/// If only pickle can take the value and may not, or cannot either; or the system has no memory.
pub(crate) fn encode(
    value: &Bound<'_, PyAny>,
    mut place: Place<'_>,
    trust: Trust,
) -> PyResult<Encoded> {
    let py = value.py();
    place.reach(value)?;
    let (draft, pickled) = match encode::encode(value) {
        Ok(draft) => (draft, false),
        Err(EncodeError::Raised(error)) => return Err(error),
        Err(EncodeError::NeedsPickle(part)) if trust.permits_pickle() => {
            (encode::pickle(value).inspect_err(|error| part.explain(py, error))?, true)
        }
        Err(EncodeError::NeedsPickle(part)) => return Err(part.refused(trust)),
    };
    let mut parts = Vec::with_capacity(draft.sources.len());
    for source in &draft.sources {
        parts.push(place.put(py, source)?);
    }
    let mut head = draft.head.into_bytes();
    if head.len() > INLINE_LIMIT {
        parts.push(match place.is_inline() {
            true => hprm_core::Part::Inline(head),
            false => place.put_bytes(&head)?,
        });
        head = vec![format::INDIRECT];
    }
    Ok(Encoded {
        payload: Payload { head, parts, ..Payload::default() },
        pickled,
        _holds: place.into_holds(),
    })
}

/// Writes what describes `value`, without placing its large buffers anywhere.
///
/// # Errors
///
/// If only pickle can take the value.
pub(crate) fn describe(value: &Bound<'_, PyAny>, trust: Trust) -> PyResult<Vec<u8>> {
    match encode::encode(value) {
        Ok(draft) => Ok(draft.head.into_bytes()),
        Err(EncodeError::Raised(error)) => Err(error),
        Err(EncodeError::NeedsPickle(part)) => Err(part.refused(trust)),
    }
}

/// Whether what arrived is a pickle.
pub(crate) fn is_pickled(head: &[u8], parts: &[ReceivedPart]) -> bool {
    decode::is_pickled(head, parts)
}

/// Rebuilds a value from what arrived from a sender that is trusted so far.
///
/// # Errors
///
/// If the bytes are no value, if it is a pickle and may not be, or if building it raises.
pub(crate) fn decode<'py>(
    py: Python<'py>,
    head: &[u8],
    parts: &[ReceivedPart],
    trust: Trust,
) -> PyResult<Bound<'py, PyAny>> {
    decode::decode(py, head, parts, trust)
}

/// Encodes the bytes that a serializer of the program's own made.
///
/// # Errors
///
/// If the system has no memory.
pub(crate) fn wrap(bytes: &[u8], store: &StoreAllocator, owner: FederateId) -> PyResult<Encoded> {
    let mut place = Place::store(store, owner);
    let payload = if bytes.len() > INLINE_LIMIT {
        Payload { parts: vec![place.put_bytes(bytes)?], ..Payload::default() }
    } else {
        Payload { head: bytes.to_vec(), ..Payload::default() }
    };
    Ok(Encoded { payload, pickled: false, _holds: place.into_holds() })
}

/// The bytes that [`wrap`] encoded.
pub(crate) fn unwrap<'a>(head: &'a [u8], parts: &'a [ReceivedPart]) -> &'a [u8] {
    parts.first().map_or(head, ReceivedPart::as_bytes)
}
