//! Walking a value into a head, and a list of large buffers that are not copied yet.
//!
//! Values of the basic types and arrays are written here; a value with anything else in it is pickled
//! as a whole, because only then do all shared references in it survive. Where the large buffers go
//! is decided afterwards, so nothing large is copied for a walk that fails.

use std::collections::BTreeMap;

use hprm_core::limits::INLINE_LIMIT;
use pyo3::buffer::PyBuffer;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{
    PyBool, PyByteArray, PyBytes, PyDict, PyFloat, PyInt, PyList, PyString, PyTuple,
};

use super::array::{Layout, Numpy};
use super::format::{self, DEPTH_LIMIT, Kind, put_number};

/// A large buffer of the value.
pub(super) enum Source<'py> {
    /// The elements of an array.
    Array(Bound<'py, PyAny>, Layout<'py>),
    /// Immutable bytes.
    Bytes(Bound<'py, PyBytes>),
    /// The UTF-8 of a string.
    Text(Bound<'py, PyString>),
    /// Anything else that has bytes in a row.
    Buffer(PyBuffer<u8>),
}

/// A value as a head and its large buffers.
pub(super) struct Draft<'py> {
    pub(super) head: Vec<u8>,
    pub(super) sources: Vec<Source<'py>>,
}

/// Why a walk ends early.
enum Stop {
    /// Something in the value is for pickle.
    Foreign,
    /// Python raised.
    Raised(PyErr),
}

impl<E: Into<PyErr>> From<E> for Stop {
    fn from(error: E) -> Self {
        Self::Raised(error.into())
    }
}

/// Writes `value`.
///
/// # Errors
///
/// If pickle cannot take it either.
pub(super) fn encode<'py>(value: &Bound<'py, PyAny>) -> PyResult<Draft<'py>> {
    let mut walk = Walk::new(value.py());
    match walk.node(value) {
        Ok(()) => return Ok(walk.draft),
        Err(Stop::Raised(error)) => return Err(error),
        Err(Stop::Foreign) => {}
    }
    let mut walk = Walk::new(value.py());
    walk.pickle(value)?;
    Ok(walk.draft)
}

struct Walk<'py> {
    py: Python<'py>,
    draft: Draft<'py>,
    /// The numbers of the values that may occur again, by address.
    seen: BTreeMap<usize, Seen>,
    depth: u32,
}

struct Seen {
    number: u64,
    /// A tuple that is not complete: a reference to it from inside cannot be rebuilt.
    open: bool,
}

impl<'py> Walk<'py> {
    fn new(py: Python<'py>) -> Self {
        let draft = Draft { head: vec![format::DIRECT], sources: Vec::new() };
        Self { py, draft, seen: BTreeMap::new(), depth: 0 }
    }

    fn node(&mut self, value: &Bound<'py, PyAny>) -> Result<(), Stop> {
        if value.is_none() {
            self.kind(Kind::None);
        } else if let Ok(value) = value.cast_exact::<PyFloat>() {
            self.kind(Kind::Float);
            self.draft.head.extend_from_slice(&value.value().to_le_bytes());
        } else if let Ok(value) = value.cast_exact::<PyInt>() {
            self.integer(value)?;
        } else if let Ok(value) = value.cast_exact::<PyString>() {
            self.text(value)?;
        } else if let Ok(value) = value.cast_exact::<PyBool>() {
            self.kind(if value.is_true() { Kind::True } else { Kind::False });
        } else if !self.again(value)? {
            self.shared(value)?;
        }
        Ok(())
    }

    /// A value that other values may refer to as well.
    fn shared(&mut self, value: &Bound<'py, PyAny>) -> Result<(), Stop> {
        if let Ok(value) = value.cast_exact::<PyBytes>() {
            self.begin(value.as_any(), Kind::Bytes);
            self.blob(value.as_bytes(), || Source::Bytes(value.clone()));
        } else if let Ok(value) = value.cast_exact::<PyDict>() {
            self.dict(value)?;
        } else if let Ok(value) = value.cast_exact::<PyList>() {
            self.begin(value.as_any(), Kind::List);
            put_number(&mut self.draft.head, value.len() as u64);
            self.all(value.as_any(), value.len(), value.iter())?;
        } else if let Ok(value) = value.cast_exact::<PyTuple>() {
            self.begin(value.as_any(), Kind::Tuple);
            put_number(&mut self.draft.head, value.len() as u64);
            self.set_open(value.as_any(), true);
            self.all(value.as_any(), value.len(), value.iter())?;
            self.set_open(value.as_any(), false);
        } else if let Ok(value) = value.cast_exact::<PyByteArray>() {
            self.begin(value.as_any(), Kind::ByteArray);
            self.buffer(PyBuffer::get(value.as_any())?)?;
        } else {
            self.array(value)?;
        }
        Ok(())
    }

    fn array(&mut self, value: &Bound<'py, PyAny>) -> Result<(), Stop> {
        let numpy = Numpy::if_imported(self.py)?.filter(|numpy| numpy.is_array(value));
        let Some(numpy) = numpy else { return Err(Stop::Foreign) };
        let Some(layout) = numpy.layout(value)? else { return Err(Stop::Foreign) };
        self.begin(value, Kind::Array);
        let description = layout.description.as_bytes();
        put_number(&mut self.draft.head, description.len() as u64);
        self.draft.head.extend_from_slice(description);
        self.draft.head.push(layout.order as u8);
        put_number(&mut self.draft.head, layout.shape.len() as u64);
        for length in &layout.shape {
            put_number(&mut self.draft.head, length.extract()?);
        }
        if layout.len > INLINE_LIMIT {
            self.part(layout.len, Source::Array(value.clone(), layout));
        } else {
            let bytes = Numpy::bytes(value, &layout)?;
            self.inline(bytes.as_bytes());
        }
        Ok(())
    }

    fn dict(&mut self, dict: &Bound<'py, PyDict>) -> Result<(), Stop> {
        self.begin(dict.as_any(), Kind::Dict);
        // A copy: the collector may run code while we walk, and that may change the dict.
        let items = dict.items();
        put_number(&mut self.draft.head, items.len() as u64);
        let pairs = items.iter().map(pair).collect::<PyResult<Vec<_>>>()?;
        self.all(dict.as_any(), pairs.len() * 2, pairs.into_iter().flatten())
    }

    fn all(
        &mut self,
        container: &Bound<'py, PyAny>,
        expected: usize,
        members: impl Iterator<Item = Bound<'py, PyAny>>,
    ) -> Result<(), Stop> {
        self.depth += 1;
        if self.depth > DEPTH_LIMIT {
            return Err(Stop::Foreign);
        }
        let mut count = 0;
        for member in members {
            self.node(&member)?;
            count += 1;
        }
        self.depth -= 1;
        if count == expected { Ok(()) } else { Err(changed(container).into()) }
    }

    fn integer(&mut self, value: &Bound<'py, PyInt>) -> Result<(), Stop> {
        if let Ok(number) = value.extract::<i64>() {
            self.kind(Kind::Int);
            put_number(&mut self.draft.head, format::zigzag(number));
            return Ok(());
        }
        let bits: usize = value.call_method0(intern!(self.py, "bit_length"))?.extract()?;
        let signed = PyDict::new(self.py);
        signed.set_item(intern!(self.py, "signed"), true)?;
        let args = (bits / 8 + 1, intern!(self.py, "little"));
        let bytes = value.call_method(intern!(self.py, "to_bytes"), args, Some(&signed))?;
        let bytes = bytes.cast_into::<PyBytes>()?;
        self.kind(Kind::Long);
        self.blob(bytes.as_bytes(), || Source::Bytes(bytes.clone()));
        Ok(())
    }

    fn text(&mut self, value: &Bound<'py, PyString>) -> Result<(), Stop> {
        // A lone surrogate has no UTF-8, but pickle has a way.
        let Ok(text) = value.to_str() else { return Err(Stop::Foreign) };
        self.kind(Kind::Str);
        self.blob(text.as_bytes(), || Source::Text(value.clone()));
        Ok(())
    }

    fn pickle(&mut self, value: &Bound<'py, PyAny>) -> PyResult<()> {
        let module = self.py.import(intern!(self.py, "hprm._pickle"))?;
        let pickled = module.call_method1(intern!(self.py, "dumps"), (value,))?;
        let (data, buffers): (Bound<'py, PyBytes>, Vec<Bound<'py, PyAny>>) = pickled.extract()?;
        self.kind(Kind::Pickle);
        self.blob(data.as_bytes(), || Source::Bytes(data.clone()));
        put_number(&mut self.draft.head, buffers.len() as u64);
        for buffer in buffers {
            self.buffer(PyBuffer::get(&buffer)?)?;
        }
        Ok(())
    }

    fn kind(&mut self, kind: Kind) {
        self.draft.head.push(kind as u8);
    }

    /// A reference to the value, if it occurred before.
    fn again(&mut self, value: &Bound<'py, PyAny>) -> Result<bool, Stop> {
        match self.seen.get(&(value.as_ptr() as usize)) {
            None => Ok(false),
            Some(Seen { open: true, .. }) => Err(Stop::Foreign),
            Some(Seen { number, .. }) => {
                let number = *number;
                self.kind(Kind::Again);
                put_number(&mut self.draft.head, number);
                Ok(true)
            }
        }
    }

    fn begin(&mut self, value: &Bound<'py, PyAny>, kind: Kind) {
        self.kind(kind);
        let seen = Seen { number: self.seen.len() as u64, open: false };
        self.seen.insert(value.as_ptr() as usize, seen);
    }

    fn set_open(&mut self, value: &Bound<'py, PyAny>, open: bool) {
        if let Some(seen) = self.seen.get_mut(&(value.as_ptr() as usize)) {
            seen.open = open;
        }
    }

    fn blob(&mut self, bytes: &[u8], source: impl FnOnce() -> Source<'py>) {
        if bytes.len() > INLINE_LIMIT {
            self.part(bytes.len(), source());
        } else {
            self.inline(bytes);
        }
    }

    fn buffer(&mut self, buffer: PyBuffer<u8>) -> PyResult<()> {
        if buffer.len_bytes() > INLINE_LIMIT {
            self.part(buffer.len_bytes(), Source::Buffer(buffer));
        } else {
            self.inline(&buffer.to_vec(self.py)?);
        }
        Ok(())
    }

    fn inline(&mut self, bytes: &[u8]) {
        put_number(&mut self.draft.head, (bytes.len() as u64) << 1);
        self.draft.head.extend_from_slice(bytes);
    }

    fn part(&mut self, len: usize, source: Source<'py>) {
        put_number(&mut self.draft.head, (len as u64) << 1 | 1);
        self.draft.sources.push(source);
    }
}

fn pair(item: Bound<'_, PyAny>) -> PyResult<[Bound<'_, PyAny>; 2]> {
    Ok([item.get_item(0)?, item.get_item(1)?])
}

fn changed(container: &Bound<'_, PyAny>) -> PyErr {
    let name = container.get_type().qualname().map_or_else(|_| "?".to_owned(), |n| n.to_string());
    pyo3::exceptions::PyRuntimeError::new_err(format!("a {name} changed while it was being sent"))
}
