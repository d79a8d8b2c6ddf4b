//! How a channel turns objects into bytes: our own way, or a package that the program names.

use hprm_core::FederateId;
use hprm_store::StoreAllocator;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::buffer::ReceivedPart;
use crate::serialize::{self, Encoded, Place, Trust};

/// Turns objects into bytes and back.
pub(crate) enum Codec {
    /// Adaptive serialization.
    Native,
    /// An object with `serialize` and `deserialize` (handbook, "serializer").
    Package(Py<PyAny>),
}

impl Codec {
    /// The codec that a connection names, or the native one. `proto` is a package of ours.
    ///
    /// # Errors
    ///
    /// What importing the package raised.
    pub(crate) fn of(py: Python<'_>, serializer: Option<&str>) -> PyResult<Self> {
        let Some(name) = serializer.filter(|name| !name.eq_ignore_ascii_case("native")) else {
            return Ok(Self::Native);
        };
        let package = match name {
            _ if name.eq_ignore_ascii_case("proto") => py.import("hprm._protobuf")?,
            _ => py.import(name)?,
        };
        Ok(Self::Package(package.getattr(intern!(py, "Serializer"))?.call0()?.unbind()))
    }

    /// Encodes `value`.
    ///
    /// # Errors
    ///
    /// If the value cannot be encoded, or the system has no memory.
    pub(crate) fn encode(
        &self,
        value: &Bound<'_, PyAny>,
        store: &StoreAllocator,
        owner: FederateId,
        trust: Trust,
    ) -> PyResult<Encoded> {
        let py = value.py();
        match self {
            Self::Native => serialize::encode(value, Place::store(store, owner), trust),
            Self::Package(package) => {
                serialize::wrap(bytes(package.bind(py), value)?.as_bytes(), store, owner)
            }
        }
    }

    /// Whether what arrived is a pickle of ours.
    pub(crate) fn is_pickled(&self, head: &[u8], parts: &[ReceivedPart]) -> bool {
        matches!(self, Self::Native) && serialize::is_pickled(head, parts)
    }

    /// Rebuilds a value from what arrived.
    ///
    /// # Errors
    ///
    /// If the bytes are no value, or if building it raises.
    pub(crate) fn decode(
        &self,
        py: Python<'_>,
        head: &[u8],
        parts: &[ReceivedPart],
        trust: Trust,
    ) -> PyResult<Py<PyAny>> {
        match self {
            Self::Native => serialize::decode(py, head, parts, trust).map(Bound::unbind),
            Self::Package(package) => {
                let bytes = PyBytes::new(py, serialize::unwrap(head, parts));
                package.call_method1(py, intern!(py, "deserialize"), (bytes,))
            }
        }
    }
}

/// What a package makes of a value.
///
/// # Errors
///
/// What it raises.
pub(crate) fn bytes<'py>(
    package: &Bound<'py, PyAny>,
    value: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyBytes>> {
    let py = value.py();
    let bytes = package.call_method1(intern!(py, "serialize"), (value,))?;
    Ok(py.get_type::<PyBytes>().call1((bytes,))?.cast_into::<PyBytes>()?)
}
