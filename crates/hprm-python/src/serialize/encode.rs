//! Encodes a value as a head, and a list of large buffers that are not copied yet.
//!
//! Values of the basic types and arrays are written here, those of known classes after `hprm._kinds`
//! has taken them apart. A value with anything else in it is pickled as a whole, because only then do
//! all shared references in it survive. The caller copies the large buffers afterwards, so a walk that
//! fails has copied nothing large.

use std::collections::BTreeMap;
use std::ops::Range;

use hprm_codec::format::{self, DEPTH_LIMIT, Head, NodeKind, put_number};
use hprm_core::copy_of;
use hprm_core::limits::INLINE_LIMIT;
use pyo3::buffer::PyBuffer;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{
    PyBool, PyByteArray, PyBytes, PyComplex, PyDict, PyFloat, PyFrozenSet, PyInt, PyIterator,
    PyList, PyMemoryView, PySet, PyString, PyTuple,
};

use super::array::{Layout, Numpy};
use super::kinds::{Kinds, Parts};
use super::pickle_only::PickleOnly;
use crate::failure::no_memory;

/// At which lengths of [`Walk::seen`] the walk probes for memory: a map cannot report that it has no memory for
/// one more member. From the `start` on, the walk probes each time that the length has doubled, and after each
/// `end` more members. Below the `start` it does not: most values are small, and a probe costs more than to
/// encode them.
const PROBES: Range<usize> = 64..4096;
/// How many bytes a member of [`Walk::seen`] takes, at most.
const SEEN_BYTES: usize = 128;

/// A large buffer of the value.
pub(super) enum Source<'py> {
    /// The elements of an array.
    Array(Bound<'py, PyAny>, Layout<'py>),
    /// Immutable bytes.
    Bytes(Bound<'py, PyBytes>),
    /// The UTF-8 of a string.
    Text(Bound<'py, PyString>),
    /// The contiguous bytes of another object.
    Buffer(PyBuffer<u8>),
    /// A callable that fills a buffer, and the length of that buffer.
    Writer(Bound<'py, PyAny>, usize),
}

/// A value as a head and its large buffers.
pub(super) struct Draft<'py> {
    pub(super) head: Head,
    pub(super) sources: Vec<Source<'py>>,
}

/// Why the encoder cannot write a value without pickle.
pub(super) enum EncodeError {
    /// A part of the value can only be pickled.
    NeedsPickle(Box<PickleOnly>),
    /// Python has raised an exception.
    Raised(PyErr),
}

impl<E: Into<PyErr>> From<E> for EncodeError {
    fn from(error: E) -> Self {
        Self::Raised(error.into())
    }
}

impl EncodeError {
    fn needs_pickle(value: &Bound<'_, PyAny>) -> Self {
        Self::NeedsPickle(Box::new(PickleOnly::class_of(value)))
    }

    fn cycle(value: &Bound<'_, PyAny>) -> Self {
        Self::NeedsPickle(Box::new(PickleOnly::cycle(value)))
    }

    /// Adds to the error at which `place` of its container the part is.
    fn within(mut self, place: impl FnOnce() -> String) -> Self {
        if let Self::NeedsPickle(part) = &mut self {
            part.within(place());
        }
        self
    }
}

/// Writes `value` without pickle.
///
/// # Errors
///
/// If a part of the value can only be pickled, or Python raises.
pub(super) fn encode<'py>(value: &Bound<'py, PyAny>) -> Result<Draft<'py>, EncodeError> {
    let mut walk = Walk::new(value.py());
    walk.node(value)?;
    Ok(walk.draft)
}

/// Pickles `value`.
///
/// # Errors
///
/// If the value cannot be pickled.
pub(super) fn pickle<'py>(value: &Bound<'py, PyAny>) -> PyResult<Draft<'py>> {
    let mut walk = Walk::new(value.py());
    walk.pickle(value)?;
    walk.draft.head.check().map_err(no_memory)?;
    Ok(walk.draft)
}

struct Walk<'py> {
    py: Python<'py>,
    draft: Draft<'py>,
    /// The numbers of the values that may occur again, by address.
    seen: BTreeMap<usize, Seen<'py>>,
    /// Objects that only this walk refers to. They live until it ends, so that no other object gets their
    /// addresses.
    kept: Vec<Bound<'py, PyAny>>,
    /// The bytes by which the walk sorts members of sets, by the address of the member.
    sort_keys: BTreeMap<usize, Vec<u8>>,
    /// The walk copies no buffers into the head that are longer than this.
    inline_limit: usize,
    depth: u32,
}

struct Seen<'py> {
    number: u64,
    /// Whether the members of the value are still being written. A receiver cannot rebuild a reference from
    /// one of them to the value.
    in_progress: bool,
    /// Keeps the value alive: otherwise another thread could remove it from its container during the walk, and
    /// another object could get its address.
    _value: Bound<'py, PyAny>,
}

impl<'py> Walk<'py> {
    fn new(py: Python<'py>) -> Self {
        let mut head = Head::new();
        head.push(format::DIRECT);
        let draft = Draft { head, sources: Vec::new() };
        let (seen, sort_keys) = (BTreeMap::new(), BTreeMap::new());
        Self { py, draft, seen, kept: Vec::new(), sort_keys, inline_limit: INLINE_LIMIT, depth: 0 }
    }

    fn node(&mut self, value: &Bound<'py, PyAny>) -> Result<(), EncodeError> {
        self.write_node(value)?;
        self.draft.head.check().map_err(no_memory)?;
        Ok(())
    }

    fn write_node(&mut self, value: &Bound<'py, PyAny>) -> Result<(), EncodeError> {
        if value.is_none() {
            self.kind(NodeKind::None);
        } else if let Ok(value) = value.cast_exact::<PyFloat>() {
            self.kind(NodeKind::Float);
            self.draft.head.extend_from_slice(&value.value().to_le_bytes());
        } else if let Ok(value) = value.cast_exact::<PyInt>() {
            self.integer(value)?;
        } else if let Ok(value) = value.cast_exact::<PyString>() {
            self.text(value)?;
        } else if let Ok(value) = value.cast_exact::<PyBool>() {
            self.kind(if value.is_true() { NodeKind::True } else { NodeKind::False });
        } else if !self.write_if_seen(value)? {
            self.shared(value)?;
        }
        Ok(())
    }

    /// Writes a value to which other parts of the message may refer as well.
    fn shared(&mut self, value: &Bound<'py, PyAny>) -> Result<(), EncodeError> {
        if let Some(numpy) = Numpy::if_imported(self.py)?.filter(|numpy| numpy.is_array(value)) {
            self.array(numpy, value)?;
        } else if let Ok(value) = value.cast_exact::<PyDict>() {
            self.dict(value)?;
        } else if let Ok(value) = value.cast_exact::<PyList>() {
            self.begin(value.as_any(), NodeKind::List);
            put_number(&mut self.draft.head, value.len() as u64);
            self.members(value.as_any(), value.len(), value.iter(), &index)?;
        } else if let Ok(value) = value.cast_exact::<PyTuple>() {
            self.begin(value.as_any(), NodeKind::Tuple);
            put_number(&mut self.draft.head, value.len() as u64);
            self.set_in_progress(value.as_any(), true);
            self.members(value.as_any(), value.len(), value.iter(), &index)?;
            self.set_in_progress(value.as_any(), false);
        } else if let Ok(value) = value.cast_exact::<PyBytes>() {
            self.begin(value.as_any(), NodeKind::Bytes);
            self.blob(value.as_bytes(), || Source::Bytes(value.clone()));
        } else if let Ok(value) = value.cast_exact::<PyByteArray>() {
            self.begin(value.as_any(), NodeKind::ByteArray);
            self.buffer(PyBuffer::get(value.as_any())?)?;
        } else {
            self.less_common(value)?;
        }
        Ok(())
    }

    /// Continues [`Self::shared`] with the types that are less common.
    fn less_common(&mut self, value: &Bound<'py, PyAny>) -> Result<(), EncodeError> {
        if let Ok(value) = value.cast_exact::<PyComplex>() {
            self.kind(NodeKind::Complex);
            self.draft.head.extend_from_slice(&value.real().to_le_bytes());
            self.draft.head.extend_from_slice(&value.imag().to_le_bytes());
            return Ok(());
        }
        if value.is_exact_instance_of::<PySet>() {
            return self.set(value, NodeKind::Set);
        }
        if value.is_exact_instance_of::<PyFrozenSet>() {
            return self.set(value, NodeKind::FrozenSet);
        }
        let kinds = Kinds::get(self.py)?;
        let is_view = value.is_exact_instance_of::<PyMemoryView>() || kinds.is_pickle_buffer(value);
        if let Some(bytes) = is_view.then(|| plain_bytes(value)).flatten() {
            self.begin(value, NodeKind::Buffer);
            self.buffer(bytes)?;
        } else if kinds.writes_itself(value) {
            self.begin(value, NodeKind::Buffer);
            self.writer(value)?;
        } else {
            let parts = kinds.take_apart(value)?.ok_or_else(|| EncodeError::needs_pickle(value))?;
            self.encode_parts(kinds, value, &parts)?;
        }
        Ok(())
    }

    /// Writes the parts into which `hprm._kinds` has taken a value.
    fn encode_parts(
        &mut self,
        kinds: &Kinds,
        value: &Bound<'py, PyAny>,
        parts: &Parts<'py>,
    ) -> Result<(), EncodeError> {
        self.begin(value, NodeKind::Reconstructed);
        put_number(&mut self.draft.head, parts.code);
        put_number(&mut self.draft.head, parts.members.len() as u64);
        self.set_in_progress(value, true);
        self.kept.push(parts.members.clone().into_any());
        let place = |at| kinds.place(parts, at).unwrap_or_default();
        self.members(value, parts.members.len(), parts.members.iter(), &place)?;
        self.set_in_progress(value, false);
        Ok(())
    }

    fn array(&mut self, numpy: &Numpy, value: &Bound<'py, PyAny>) -> Result<(), EncodeError> {
        let Some(layout) = numpy.layout(value)? else {
            let kinds = Kinds::get(self.py)?;
            let parts = kinds.take_apart(value)?.ok_or_else(|| EncodeError::needs_pickle(value))?;
            return self.encode_parts(kinds, value, &parts);
        };
        self.begin(value, NodeKind::Array);
        let description = layout.description.as_bytes();
        put_number(&mut self.draft.head, description.len() as u64);
        self.draft.head.extend_from_slice(description);
        self.draft.head.push(layout.order as u8);
        put_number(&mut self.draft.head, layout.shape.len() as u64);
        for length in &layout.shape {
            put_number(&mut self.draft.head, length.extract()?);
        }
        if layout.len > self.inline_limit {
            self.part(layout.len, Source::Array(value.clone(), layout));
        } else {
            let bytes = Numpy::bytes(value, &layout)?;
            self.inline(bytes.as_bytes());
        }
        Ok(())
    }

    fn dict(&mut self, dict: &Bound<'py, PyDict>) -> Result<(), EncodeError> {
        self.begin(dict.as_any(), NodeKind::Dict);
        // The walk reads a copy of the items: the garbage collector may run code meanwhile, and that may change
        // the dict.
        let items = dict.items();
        put_number(&mut self.draft.head, items.len() as u64);
        let pairs = items.iter().map(pair).collect::<PyResult<Vec<_>>>()?;
        let place = |at: usize| {
            let key =
                pairs[at / 2][0].repr().map_or_else(|_| "?".to_owned(), |key| key.to_string());
            if at.is_multiple_of(2) { format!("{{key {key}}}") } else { format!("[{key}]") }
        };
        self.members(dict.as_any(), pairs.len() * 2, pairs.iter().flatten().cloned(), &place)
    }

    /// Writes the members of a set in an order that does not depend on their hashes, which differ between runs.
    fn set(&mut self, set: &Bound<'py, PyAny>, kind: NodeKind) -> Result<(), EncodeError> {
        self.begin(set, kind);
        self.set_in_progress(set, true);
        let members = PyIterator::from_object(set)?.collect::<PyResult<Vec<_>>>()?;
        put_number(&mut self.draft.head, members.len() as u64);
        let mut sorted = Vec::with_capacity(members.len());
        for member in members {
            let key =
                self.sort_key(&member).map_err(|error| error.within(|| "{...}".to_owned()))?;
            sorted.push((key, member));
        }
        sorted.sort_by(|(one, _), (other, _)| one.cmp(other));
        let members = sorted.into_iter().map(|(_, member)| member);
        self.members(set, members.len(), members, &|_| "{...}".to_owned())?;
        self.set_in_progress(set, false);
        Ok(())
    }

    /// The bytes by which a member of a set is sorted: the encoding of the member alone, so that it does not
    /// depend on where the set is.
    fn sort_key(&mut self, member: &Bound<'py, PyAny>) -> Result<Vec<u8>, EncodeError> {
        if let Some(key) = self.sort_keys.get(&address(member)) {
            return Ok(copy_of(key).map_err(no_memory)?);
        }
        let mut walk = Walk::new(self.py);
        // The sort keys of sets inside the member are the same in both walks.
        (walk.inline_limit, walk.depth) = (usize::MAX, self.depth + 1);
        walk.sort_keys = std::mem::take(&mut self.sort_keys);
        let walked = walk.node(member);
        self.sort_keys = walk.sort_keys;
        self.kept.append(&mut walk.kept);
        walked?;
        self.kept.push(member.clone());
        let key = walk.draft.head.into_bytes();
        self.sort_keys.insert(address(member), copy_of(&key).map_err(no_memory)?);
        Ok(key)
    }

    /// Writes the members of a container. `place` tells, for an error, where in the container a member is.
    fn members(
        &mut self,
        container: &Bound<'py, PyAny>,
        expected: usize,
        members: impl Iterator<Item = Bound<'py, PyAny>>,
        place: &dyn Fn(usize) -> String,
    ) -> Result<(), EncodeError> {
        self.depth += 1;
        if self.depth > DEPTH_LIMIT {
            return Err(EncodeError::NeedsPickle(Box::new(PickleOnly::deep(container))));
        }
        let mut count = 0;
        for member in members {
            self.node(&member).map_err(|error| error.within(|| place(count)))?;
            count += 1;
        }
        self.depth -= 1;
        if count == expected { Ok(()) } else { Err(changed(container).into()) }
    }

    fn integer(&mut self, value: &Bound<'py, PyInt>) -> Result<(), EncodeError> {
        if let Ok(number) = value.extract::<i64>() {
            self.kind(NodeKind::Int);
            put_number(&mut self.draft.head, format::zigzag(number));
            return Ok(());
        }
        let bits: usize = value.call_method0(intern!(self.py, "bit_length"))?.extract()?;
        let signed = PyDict::new(self.py);
        signed.set_item(intern!(self.py, "signed"), true)?;
        let args = (bits / 8 + 1, intern!(self.py, "little"));
        let bytes = value.call_method(intern!(self.py, "to_bytes"), args, Some(&signed))?;
        let bytes = bytes.cast_into::<PyBytes>()?;
        self.kind(NodeKind::Long);
        self.blob(bytes.as_bytes(), || Source::Bytes(bytes.clone()));
        Ok(())
    }

    fn text(&mut self, value: &Bound<'py, PyString>) -> Result<(), EncodeError> {
        let Ok(text) = value.to_str() else {
            // A lone surrogate has no UTF-8.
            let kinds = Kinds::get(self.py)?;
            let parts = kinds.take_apart(value)?.ok_or_else(|| EncodeError::needs_pickle(value))?;
            return if self.write_if_seen(value)? {
                Ok(())
            } else {
                self.encode_parts(kinds, value, &parts)
            };
        };
        self.kind(NodeKind::Str);
        self.blob(text.as_bytes(), || Source::Text(value.clone()));
        Ok(())
    }

    fn pickle(&mut self, value: &Bound<'py, PyAny>) -> PyResult<()> {
        let module = self.py.import(intern!(self.py, "hprm._pickle"))?;
        let pickled = module.call_method1(intern!(self.py, "dumps"), (value,))?;
        let (data, buffers): (Bound<'py, PyBytes>, Vec<Bound<'py, PyAny>>) = pickled.extract()?;
        self.kind(NodeKind::Pickle);
        self.blob(data.as_bytes(), || Source::Bytes(data.clone()));
        put_number(&mut self.draft.head, buffers.len() as u64);
        for buffer in buffers {
            self.buffer(PyBuffer::get(&buffer)?)?;
        }
        Ok(())
    }

    fn kind(&mut self, kind: NodeKind) {
        self.draft.head.push(kind as u8);
    }

    /// Writes a reference to the value, if the value has occurred before. Returns whether it has.
    fn write_if_seen(&mut self, value: &Bound<'py, PyAny>) -> Result<bool, EncodeError> {
        match self.seen.get(&address(value)) {
            None => Ok(false),
            Some(Seen { in_progress: true, .. }) => Err(EncodeError::cycle(value)),
            Some(Seen { number, .. }) => {
                let number = *number;
                self.kind(NodeKind::BackReference);
                put_number(&mut self.draft.head, number);
                Ok(true)
            }
        }
    }

    /// Begins the node of a value that may occur again, and numbers the value.
    fn begin(&mut self, value: &Bound<'py, PyAny>, kind: NodeKind) {
        let seen = self.seen.len();
        if seen >= PROBES.start && (seen.is_power_of_two() || seen.is_multiple_of(PROBES.end)) {
            self.draft.head.probe(seen.min(PROBES.end) * SEEN_BYTES);
        }
        self.kind(kind);
        let number = self.seen.len() as u64;
        let seen = Seen { number, in_progress: false, _value: value.clone() };
        self.seen.insert(address(value), seen);
    }

    fn set_in_progress(&mut self, value: &Bound<'py, PyAny>, in_progress: bool) {
        if let Some(seen) = self.seen.get_mut(&address(value)) {
            seen.in_progress = in_progress;
        }
    }

    fn blob(&mut self, bytes: &[u8], source: impl FnOnce() -> Source<'py>) {
        if bytes.len() > self.inline_limit {
            self.part(bytes.len(), source());
        } else {
            self.inline(bytes);
        }
    }

    fn buffer(&mut self, buffer: PyBuffer<u8>) -> PyResult<()> {
        if buffer.len_bytes() > self.inline_limit {
            self.part(buffer.len_bytes(), Source::Buffer(buffer));
        } else {
            self.inline(&buffer.to_vec(self.py)?);
        }
        Ok(())
    }

    fn writer(&mut self, value: &Bound<'py, PyAny>) -> PyResult<()> {
        let len: usize = value.getattr(intern!(self.py, "length"))?.extract()?;
        let write = value.getattr(intern!(self.py, "write"))?;
        if len > self.inline_limit {
            self.part(len, Source::Writer(write, len));
            return Ok(());
        }
        let bytes = PyByteArray::new_with(self.py, len, |_| Ok(()))?;
        write.call1((&bytes,))?;
        self.inline(&bytes.to_vec());
        Ok(())
    }

    /// Writes a buffer into the head.
    fn inline(&mut self, bytes: &[u8]) {
        put_number(&mut self.draft.head, (bytes.len() as u64) << 1);
        self.draft.head.extend_from_slice(bytes);
    }

    /// Writes only the length of a buffer into the head, and leaves the buffer for later.
    fn part(&mut self, len: usize, source: Source<'py>) {
        put_number(&mut self.draft.head, (len as u64) << 1 | 1);
        self.draft.sources.push(source);
    }
}

/// The bytes of a buffer, if it has one dimension and its elements are unsigned bytes. A node of bytes would
/// lose any other format, even that of single characters, and any other shape.
fn plain_bytes(value: &Bound<'_, PyAny>) -> Option<PyBuffer<u8>> {
    let bytes = PyBuffer::<u8>::get(value).ok()?;
    (bytes.dimensions() == 1 && bytes.format() == c"B").then_some(bytes)
}

fn index(at: usize) -> String {
    format!("[{at}]")
}

fn address<T>(value: &Bound<'_, T>) -> usize {
    value.as_ptr() as usize
}

fn pair(item: Bound<'_, PyAny>) -> PyResult<[Bound<'_, PyAny>; 2]> {
    Ok([item.get_item(0)?, item.get_item(1)?])
}

fn changed(container: &Bound<'_, PyAny>) -> PyErr {
    let name = container.get_type().qualname().map_or_else(|_| "?".to_owned(), |n| n.to_string());
    pyo3::exceptions::PyRuntimeError::new_err(format!("a {name} changed while it was being sent"))
}
