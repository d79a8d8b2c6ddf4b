//! Rebuilding a value from a head and its parts.
//!
//! The bytes may be anything: whatever is wrong with them becomes an error, and no allocation exceeds
//! what the bytes at hand can justify. The bytes name classes and contain no code: `hprm._kinds` decides what
//! to make of the names, and a pickle is read only from a sender that may send pickles.

use std::slice;

use hprm_codec::cursor::{self, Cursor};
use hprm_codec::format::{self, DEPTH_LIMIT, Malformed, NodeKind};
use pyo3::exceptions::{PyPermissionError, PyValueError};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{
    PyByteArray, PyBytes, PyComplex, PyDict, PyFloat, PyFrozenSet, PyInt, PyList, PyMemoryView,
    PySet, PyString, PyTuple,
};

use super::array::Numpy;
use super::kinds::Kinds;
use super::trust::Trust;
use crate::buffer::{Memory, ReceivedPart};

/// The most values in one key of a dict or member of a set, one that occurs twice counted twice: Python visits
/// all of them for the hash.
const KEY_LIMIT: u64 = 1 << 16;

/// Rebuilds a value.
///
/// # Errors
///
/// If the bytes are no value, if they are a pickle and the sender may not send pickles, or if Python raises an
/// exception.
pub(super) fn decode<'py>(
    py: Python<'py>,
    head: &[u8],
    parts: &[ReceivedPart],
    trust: Trust,
) -> PyResult<Bound<'py, PyAny>> {
    let (head, parts) = node_of(head, parts)?;
    let (parts, seen) = (parts.iter(), Vec::new());
    let mut walk = Walk { py, head, parts, seen, depth: 0, weight: 0, trust, dtype: None };
    let value = if is_pickle(&head) { walk.root_pickle()? } else { walk.node()? };
    if walk.head.rest().is_empty() && walk.parts.as_slice().is_empty() {
        Ok(value)
    } else {
        Err(malformed(Malformed("bytes after its end")))
    }
}

/// Whether a payload of this head and these parts is a pickle.
pub(super) fn is_pickled(head: &[u8], parts: &[ReceivedPart]) -> bool {
    node_of(head, parts).is_ok_and(|(node, _)| is_pickle(&node))
}

fn is_pickle(node: &Cursor<'_>) -> bool {
    node.peek() == Ok(NodeKind::Pickle)
}

/// The bytes of the outermost node, and the parts that belong to it.
fn node_of<'a>(
    head: &'a [u8],
    parts: &'a [ReceivedPart],
) -> PyResult<(Cursor<'a>, &'a [ReceivedPart])> {
    format::root(head, parts, ReceivedPart::as_bytes).map_err(malformed)
}

/// A blob: where its bytes are.
enum Blob<'a> {
    Inline(&'a [u8]),
    Part(&'a ReceivedPart),
}

impl<'a> Blob<'a> {
    fn as_bytes(&self) -> &'a [u8] {
        match self {
            Self::Inline(bytes) => bytes,
            Self::Part(part) => part.as_bytes(),
        }
    }

    /// The bytes as a Python object. If they are many, there may be no memory for them, which is an exception.
    fn into_bytes<'py>(self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        match self {
            Self::Inline(bytes) => Ok(PyBytes::new(py, bytes)),
            Self::Part(_) => {
                let bytes = py.get_type::<PyBytes>().call1((self.into_buffer(py)?,))?;
                Ok(bytes.cast_into()?)
            }
        }
    }

    /// The bytes as a read-only object, which can be the memory of an array.
    fn into_buffer<'py>(self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        Ok(match self {
            Self::Inline(bytes) => PyBytes::new(py, bytes).into_any(),
            Self::Part(part) => Bound::new(py, Memory(part.clone()))?.into_any(),
        })
    }
}

struct Walk<'a, 'py> {
    py: Python<'py>,
    /// What has not been read.
    head: Cursor<'a>,
    parts: slice::Iter<'a, ReceivedPart>,
    /// The values that may occur again, and their weights; none for one that is not complete.
    seen: Vec<Option<(Bound<'py, PyAny>, u64)>>,
    depth: u32,
    /// How many values have been made, those that occur again counted again.
    weight: u64,
    trust: Trust,
    /// The dtype of the last array, and its description.
    dtype: Option<(&'a [u8], Bound<'py, PyAny>)>,
}

impl<'a, 'py> Walk<'a, 'py> {
    fn node(&mut self) -> PyResult<Bound<'py, PyAny>> {
        self.depth += 1;
        if self.depth > DEPTH_LIMIT + 1 {
            return Err(malformed(Malformed("values nested too deeply")));
        }
        self.weight = self.weight.saturating_add(1);
        let kind = self.head.kind().map_err(malformed)?;
        let py = self.py;
        let value = match kind {
            NodeKind::None => py.None().into_bound(py),
            NodeKind::False | NodeKind::True => {
                (kind == NodeKind::True).into_pyobject(py)?.to_owned().into_any()
            }
            NodeKind::Int => format::unzigzag(self.number()?).into_pyobject(py)?.into_any(),
            NodeKind::Long => self.long()?,
            NodeKind::Float => PyFloat::new(py, f64::from_le_bytes(self.take()?)).into_any(),
            NodeKind::Str => self.text()?,
            NodeKind::Bytes => {
                let bytes = self.blob()?.into_bytes(py)?;
                self.number_value(bytes.into_any())
            }
            NodeKind::ByteArray => {
                let bytes = match self.blob()? {
                    Blob::Inline(bytes) => PyByteArray::new(py, bytes),
                    part @ Blob::Part(_) => PyByteArray::from(&part.into_buffer(py)?)?,
                };
                self.number_value(bytes.into_any())
            }
            NodeKind::List => self.list()?,
            NodeKind::Tuple => self.tuple()?,
            NodeKind::Dict => self.dict()?,
            NodeKind::BackReference => self.back_reference()?,
            NodeKind::Array => self.array()?,
            NodeKind::Pickle => {
                return Err(malformed(Malformed("a pickle inside of another value")));
            }
            NodeKind::Complex => {
                let [real, imag] = [self.take()?, self.take()?].map(f64::from_le_bytes);
                PyComplex::from_doubles(py, real, imag).into_any()
            }
            NodeKind::Set => self.set()?,
            NodeKind::FrozenSet => self.frozen_set()?,
            NodeKind::Buffer => {
                let buffer = self.blob()?.into_buffer(py)?;
                self.number_value(PyMemoryView::from(&buffer)?.into_any())
            }
            NodeKind::Reconstructed => self.reconstructed()?,
        };
        self.depth -= 1;
        Ok(value)
    }

    /// A key of a dict, or a member of a set: Python computes its hash.
    fn key(&mut self) -> PyResult<Bound<'py, PyAny>> {
        let before = self.weight;
        let key = self.node()?;
        if self.weight - before > KEY_LIMIT {
            return Err(malformed(Malformed("a key of too many parts")));
        }
        Ok(key)
    }

    fn set(&mut self) -> PyResult<Bound<'py, PyAny>> {
        let number = self.reserve_number();
        let set = PySet::empty(self.py)?;
        for _ in 0..self.count()? {
            set.add(self.key()?)?;
        }
        Ok(self.complete(number, set.into_any()))
    }

    fn frozen_set(&mut self) -> PyResult<Bound<'py, PyAny>> {
        let number = self.reserve_number();
        let members = (0..self.count()?).map(|_| self.key()).collect::<PyResult<Vec<_>>>()?;
        let set = PyFrozenSet::new(self.py, members)?;
        Ok(self.complete(number, set.into_any()))
    }

    fn reconstructed(&mut self) -> PyResult<Bound<'py, PyAny>> {
        let number = self.reserve_number();
        let code = self.number()?;
        let members = (0..self.count()?).map(|_| self.node()).collect::<PyResult<Vec<_>>>()?;
        let members = PyTuple::new(self.py, members)?;
        let kinds = Kinds::get(self.py)?;
        let made = match self.trust.only_looks() {
            true => kinds.make_or_stand_in(code, &members),
            false => kinds.make(code, &members, self.trust.permits_pickle()),
        }?;
        Ok(self.complete(number, made))
    }

    /// Numbers a value that can be made only after its members. Returns the number for [`Self::complete`].
    fn reserve_number(&mut self) -> (usize, u64) {
        self.seen.push(None);
        (self.seen.len() - 1, self.weight)
    }

    /// The value with the reserved number is made: the bytes may refer to it from now on.
    fn complete(
        &mut self,
        (number, before): (usize, u64),
        value: Bound<'py, PyAny>,
    ) -> Bound<'py, PyAny> {
        self.seen[number] = Some((value.clone(), self.weight.saturating_sub(before)));
        value
    }

    fn list(&mut self) -> PyResult<Bound<'py, PyAny>> {
        let list = PyList::empty(self.py);
        self.number_value(list.clone().into_any());
        for _ in 0..self.count()? {
            list.append(self.node()?)?;
        }
        Ok(list.into_any())
    }

    fn tuple(&mut self) -> PyResult<Bound<'py, PyAny>> {
        let number = self.reserve_number();
        let members = (0..self.count()?).map(|_| self.node()).collect::<PyResult<Vec<_>>>()?;
        let tuple = PyTuple::new(self.py, members)?.into_any();
        Ok(self.complete(number, tuple))
    }

    fn dict(&mut self) -> PyResult<Bound<'py, PyAny>> {
        let dict = PyDict::new(self.py);
        self.number_value(dict.clone().into_any());
        for _ in 0..self.count()? {
            let key = self.key()?;
            dict.set_item(key, self.node()?)?;
        }
        Ok(dict.into_any())
    }

    fn back_reference(&mut self) -> PyResult<Bound<'py, PyAny>> {
        let number = usize::try_from(self.number()?).ok();
        let seen = number.and_then(|number| self.seen.get(number)).cloned().flatten();
        let (value, weight) = seen.ok_or_else(|| malformed(Malformed("a reference to nothing")))?;
        self.weight = self.weight.saturating_add(weight);
        Ok(value)
    }

    fn array(&mut self) -> PyResult<Bound<'py, PyAny>> {
        let numpy = Numpy::imported(self.py)?;
        let header = self.head.array_header().map_err(malformed)?;
        let shape = match header.shape[..] {
            // NumPy takes this too, and most arrays have one.
            [length] => length.into_pyobject(self.py)?.into_any(),
            ref shape => PyTuple::new(self.py, shape)?.into_any(),
        };
        let buffer = self.blob()?.into_buffer(self.py)?;
        let dtype = self.dtype(numpy, header.description)?;
        let array = numpy.over(&shape, &dtype, &buffer, header.order)?;
        Ok(self.number_value(array))
    }

    /// The dtype of that description, which is often the same as that of the previous array.
    fn dtype(&mut self, numpy: &Numpy, description: &'a [u8]) -> PyResult<Bound<'py, PyAny>> {
        match &self.dtype {
            Some((known, dtype)) if *known == description => Ok(dtype.clone()),
            _ => {
                let dtype = numpy.dtype(&PyBytes::new(self.py, description))?;
                self.dtype = Some((description, dtype.clone()));
                Ok(dtype)
            }
        }
    }

    fn root_pickle(&mut self) -> PyResult<Bound<'py, PyAny>> {
        if !self.trust.permits_pickle() {
            return Err(PyPermissionError::new_err(format!(
                "a pickle has arrived and was not read, because {}; {}",
                self.trust.reason(),
                self.trust.remedy()
            )));
        }
        let [_kind] = self.take()?;
        let data = self.blob()?.into_buffer(self.py)?;
        let count = self.count()?;
        let buffers =
            (0..count).map(|_| self.blob()?.into_buffer(self.py)).collect::<PyResult<Vec<_>>>()?;
        let module = self.py.import(intern!(self.py, "hprm._pickle"))?;
        module.call_method1(intern!(self.py, "loads"), (data, buffers))
    }

    fn long(&mut self) -> PyResult<Bound<'py, PyAny>> {
        let bytes = self.blob()?.into_bytes(self.py)?;
        let signed = PyDict::new(self.py);
        signed.set_item(intern!(self.py, "signed"), true)?;
        let args = (bytes, intern!(self.py, "little"));
        self.py.get_type::<PyInt>().call_method(intern!(self.py, "from_bytes"), args, Some(&signed))
    }

    fn text(&mut self) -> PyResult<Bound<'py, PyAny>> {
        let blob = self.blob()?;
        let text = std::str::from_utf8(blob.as_bytes())
            .map_err(|_| malformed(Malformed("a string that is not UTF-8")))?;
        Ok(match blob {
            Blob::Inline(_) => PyString::new(self.py, text),
            Blob::Part(_) => {
                let bytes = blob.into_buffer(self.py)?;
                PyString::from_encoded_object(&bytes, Some(c"utf-8"), Some(c"strict"))?
            }
        }
        .into_any())
    }

    /// Gives a value the next number: the bytes may refer to it from now on.
    fn number_value(&mut self, value: Bound<'py, PyAny>) -> Bound<'py, PyAny> {
        self.seen.push(Some((value.clone(), 1)));
        value
    }

    fn blob(&mut self) -> PyResult<Blob<'a>> {
        let len = match self.head.blob().map_err(malformed)? {
            cursor::Blob::Inline(bytes) => return Ok(Blob::Inline(bytes)),
            cursor::Blob::Part(len) => len,
        };
        match self.parts.next() {
            Some(part) if part.as_bytes().len() == len => Ok(Blob::Part(part)),
            Some(_) => Err(malformed(Malformed("a buffer of another length than announced"))),
            None => Err(malformed(Malformed("a buffer is missing"))),
        }
    }

    fn count(&mut self) -> PyResult<usize> {
        self.head.count().map_err(malformed)
    }

    fn number(&mut self) -> PyResult<u64> {
        self.head.number().map_err(malformed)
    }

    fn take<const N: usize>(&mut self) -> PyResult<[u8; N]> {
        self.head.take().map_err(malformed)
    }
}

fn malformed(what: Malformed) -> PyErr {
    PyValueError::new_err(what.to_string())
}
