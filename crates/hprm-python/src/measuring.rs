//! The cost of serialization by itself, for the comparison with other libraries in `bench/peers`.
//!
//! A value that is sent is described, and its large buffers are placed; a value that is received is built
//! over buffers that exist. Both are here without the placing, which a program measures.

use std::sync::Arc;

use hprm::Pickling;
use hprm_core::Part;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::buffer::ReceivedPart;
use crate::serialize::{self, Place, Trust};

/// A process that measures may read its own pickles.
const HERE: Trust = Trust::new(Pickling::Local, true);

/// The description of a value, without its large buffers.
#[pyfunction]
pub(crate) fn describe_value<'py>(value: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyBytes>> {
    Ok(PyBytes::new(value.py(), &serialize::describe(value, HERE)?))
}

/// A value that has arrived and may be decoded any number of times.
#[pyclass(frozen, module = "hprm._hprm")]
pub(crate) struct ArrivedValue {
    head: Vec<u8>,
    parts: Vec<ReceivedPart>,
}

#[pymethods]
impl ArrivedValue {
    /// `value` as it would arrive.
    #[new]
    fn new(value: &Bound<'_, PyAny>) -> PyResult<Self> {
        let payload = serialize::encode(value, Place::inline(), HERE)?.payload;
        let parts = payload.parts.into_iter().filter_map(|part| match part {
            Part::Inline(bytes) => Some(ReceivedPart::Inline(Arc::new(bytes))),
            Part::Object(_) | Part::Shipped(_) => None, // there is no store
        });
        Ok(Self { head: payload.head, parts: parts.collect() })
    }

    /// The value, over the buffers that arrived.
    fn decode<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        serialize::decode(py, &self.head, &self.parts, HERE)
    }
}
