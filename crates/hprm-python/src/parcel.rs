//! Values on their way to another federate of the same process.
//!
//! Immutable values are shared. The memory of large arrays without other references is made read-only and
//! shared; other arrays are copied, because a program may go on writing to them. The array object itself,
//! whose shape can be changed, is made anew for each receiver. Lists, tuples and dicts of such things
//! are copied, their members are not. Anything else is encoded as if it went to another process: an
//! object of a class must not be seen by two federates, each of which has classes of its own. So is
//! what goes through a serializer that the program names, which may make something else of it.

use std::collections::BTreeMap;
use std::sync::Arc;

use hprm_core::limits::HEAP_ARRAY_LIMIT;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{
    PyBool, PyByteArray, PyBytes, PyDict, PyFloat, PyInt, PyList, PyString, PyTuple,
};

use crate::buffer::ReceivedPart;
use crate::codec::{self, Codec};
use crate::numpy_memory::count;
use crate::serialize::{self, Place, Sole, Trust};

/// Containers within containers beyond this are left to pickle.
const DEPTH_LIMIT: u32 = 64;

/// A value that no federate can change for another.
pub(crate) struct Parcel {
    content: Content,
    /// How many bytes its texts, bytes and arrays have.
    bytes: u64,
}

enum Content {
    /// It cannot be changed.
    Object(Py<PyAny>),
    /// Containers, which the receiver may change: it gets a copy of this copy. So are arrays, whose
    /// memory is not copied.
    Containers(Py<PyAny>),
    /// As it travels to another process, but for the store.
    Encoded {
        /// The structure.
        head: Vec<u8>,
        /// The large buffers.
        parts: Vec<ReceivedPart>,
    },
}

impl Parcel {
    /// Packs a value that goes through `codec`.
    ///
    /// # Errors
    ///
    /// If the value cannot be encoded.
    pub(crate) fn pack(value: &Bound<'_, PyAny>, codec: &Codec, trust: Trust) -> PyResult<Self> {
        if let Codec::Package(package) = codec {
            let head = codec::bytes(package.bind(value.py()), value)?.as_bytes().to_vec();
            return Ok(Self::encoded(head, Vec::new()));
        }
        let mut copying = Copying::new(value.py(), serialize::sole(value)?);
        match copying.value(value) {
            Ok(copy) => {
                let (copy, bytes) = (copy.unbind(), copying.bytes);
                let content = match copying.containers {
                    0 => Content::Object(copy),
                    _ => Content::Containers(copy),
                };
                return Ok(Self { content, bytes });
            }
            Err(Stop::Raised(error)) => return Err(error),
            Err(Stop::NeedsEncoding) => {}
        }
        let payload = serialize::encode(value, Place::inline(), trust)?.payload;
        let parts = payload.parts.into_iter().filter_map(|part| match part {
            hprm_core::Part::Inline(bytes) => Some(ReceivedPart::Inline(Arc::new(bytes))),
            hprm_core::Part::Object(_) | hprm_core::Part::Shipped(_) => None,
        });
        Ok(Self::encoded(payload.head, parts.collect()))
    }

    fn encoded(head: Vec<u8>, parts: Vec<ReceivedPart>) -> Self {
        let sizes = parts.iter().map(|part| match part {
            ReceivedPart::Inline(bytes) => bytes.len() as u64,
            ReceivedPart::Object(object) => object.object_ref().len,
        });
        let bytes = head.len() as u64 + sizes.sum::<u64>();
        Self { content: Content::Encoded { head, parts }, bytes }
    }

    /// How many bytes its texts, bytes and arrays have.
    pub(crate) fn bytes(&self) -> u64 {
        self.bytes
    }

    /// The value, as its receiver may have it.
    ///
    /// # Errors
    ///
    /// If it cannot be decoded.
    pub(crate) fn open(&self, py: Python<'_>, codec: &Codec, trust: Trust) -> PyResult<Py<PyAny>> {
        match &self.content {
            Content::Object(object) => Ok(object.clone_ref(py)),
            Content::Containers(object) => match Copying::opening(py).value(object.bind(py)) {
                Ok(copy) => Ok(copy.unbind()),
                Err(Stop::Raised(error)) => Err(error),
                Err(Stop::NeedsEncoding) => unreachable!("it has been copied before"),
            },
            Content::Encoded { head, parts } => codec.decode(py, head, parts, trust),
        }
    }
}

/// Why copying ends early.
enum Stop {
    /// Something in the value is not of the types that are known here.
    NeedsEncoding,
    /// Python raised.
    Raised(PyErr),
}

impl<E: Into<PyErr>> From<E> for Stop {
    fn from(error: E) -> Self {
        Self::Raised(error.into())
    }
}

/// Copies the containers in a value, and not their members.
struct Copying<'py> {
    py: Python<'py>,
    /// Whether it makes what a receiver gets of what was packed.
    opening: bool,
    /// The arrays without other references.
    sole: Sole,
    /// The copies of containers, by the address of the original. What occurs twice is copied once.
    seen: BTreeMap<usize, Bound<'py, PyAny>>,
    depth: u32,
    /// How many copies there are that could be changed.
    containers: u32,
    /// How many bytes the texts, bytes and arrays have.
    bytes: u64,
}

impl<'py> Copying<'py> {
    fn new(py: Python<'py>, sole: Sole) -> Self {
        Self { py, opening: false, sole, seen: BTreeMap::new(), depth: 0, containers: 0, bytes: 0 }
    }

    fn opening(py: Python<'py>) -> Self {
        Self { opening: true, ..Self::new(py, Sole::new()) }
    }

    fn value(&mut self, value: &Bound<'py, PyAny>) -> Result<Bound<'py, PyAny>, Stop> {
        let immutable = value.is_none()
            || value.is_exact_instance_of::<PyFloat>()
            || value.is_exact_instance_of::<PyInt>()
            || value.is_exact_instance_of::<PyString>()
            || value.is_exact_instance_of::<PyBool>()
            || value.is_exact_instance_of::<PyBytes>();
        if immutable {
            self.bytes += length(value)?;
            return Ok(value.clone());
        }
        if let Some(copy) = self.seen.get(&address(value)) {
            return Ok(copy.clone());
        }
        self.depth += 1;
        if self.depth > DEPTH_LIMIT {
            return Err(Stop::NeedsEncoding);
        }
        let copy = if let Ok(list) = value.cast_exact::<PyList>() {
            self.list(list)?
        } else if let Ok(dict) = value.cast_exact::<PyDict>() {
            self.dict(dict)?
        } else if let Ok(tuple) = value.cast_exact::<PyTuple>() {
            self.tuple(tuple)?
        } else if let Ok(bytes) = value.cast_exact::<PyByteArray>() {
            self.containers += 1;
            self.bytes += bytes.len() as u64;
            PyByteArray::new(self.py, &bytes.to_vec()).into_any()
        } else {
            self.foreign(value)?
        };
        self.seen.insert(address(value), copy.clone());
        self.depth -= 1;
        Ok(copy)
    }

    fn list(&mut self, list: &Bound<'py, PyList>) -> Result<Bound<'py, PyAny>, Stop> {
        self.containers += 1;
        let copy = PyList::empty(self.py);
        // Before its members, which may refer to it.
        self.seen.insert(address(list), copy.clone().into_any());
        for member in list.iter() {
            copy.append(self.value(&member)?)?;
        }
        Ok(copy.into_any())
    }

    fn dict(&mut self, dict: &Bound<'py, PyDict>) -> Result<Bound<'py, PyAny>, Stop> {
        self.containers += 1;
        let copy = PyDict::new(self.py);
        self.seen.insert(address(dict), copy.clone().into_any());
        // A list of its own: the collector may run code meanwhile, and that may change the dict.
        for item in dict.items().iter() {
            let (key, member) = item.extract::<(Bound<'py, PyAny>, Bound<'py, PyAny>)>()?;
            copy.set_item(self.value(&key)?, self.value(&member)?)?;
        }
        Ok(copy.into_any())
    }

    fn tuple(&mut self, tuple: &Bound<'py, PyTuple>) -> Result<Bound<'py, PyAny>, Stop> {
        let members =
            tuple.iter().map(|member| self.value(&member)).collect::<Result<Vec<_>, Stop>>()?;
        if tuple.iter().zip(&members).all(|(member, copy)| member.is(copy)) {
            return Ok(tuple.clone().into_any());
        }
        // A list in it may refer to it, and has made its copy then.
        if let Some(copy) = self.seen.get(&address(tuple)) {
            return Ok(copy.clone());
        }
        Ok(PyTuple::new(self.py, members)?.into_any())
    }

    /// Arrays and numbers of NumPy.
    fn foreign(&mut self, value: &Bound<'py, PyAny>) -> Result<Bound<'py, PyAny>, Stop> {
        let module = self.py.import(intern!(self.py, "hprm._handover"))?;
        if self.opening {
            return Ok(module.call_method1(intern!(self.py, "opened"), (value,))?);
        }
        let alone = self.sole.contains_key(&address(value)) && has_its_memory_alone(value)?;
        let small = if alone { HEAP_ARRAY_LIMIT } else { usize::MAX };
        let frozen = module.call_method1(intern!(self.py, "frozen"), (value, small))?;
        if frozen.is_none() {
            return Err(Stop::NeedsEncoding);
        }
        // Of an array; what else cannot be changed is small.
        if let Some(bytes) = frozen.getattr_opt(intern!(self.py, "nbytes"))? {
            self.bytes += bytes.extract::<u64>().unwrap_or(0);
        }
        // An array, of which each receiver gets its own view.
        self.containers += u32::from(!frozen.is(value));
        Ok(frozen)
    }
}

/// How long a text or bytes are; zero for a number.
fn length(value: &Bound<'_, PyAny>) -> PyResult<u64> {
    let is_long =
        value.is_exact_instance_of::<PyBytes>() || value.is_exact_instance_of::<PyString>();
    Ok(if is_long { value.len()? as u64 } else { 0 })
}

/// Whether there are no other references to the arrays of which this one is a view. Code that has such a
/// reference may have another view, or make one.
fn has_its_memory_alone(array: &Bound<'_, PyAny>) -> PyResult<bool> {
    let base = intern!(array.py(), "base");
    let mut viewed = array.getattr_opt(base)?;
    while let Some(array) = viewed.filter(|viewed| !viewed.is_none()) {
        // The view's, and ours.
        if count(&array) != 2 {
            return Ok(false);
        }
        viewed = array.getattr_opt(base)?;
    }
    Ok(true)
}

fn address<T>(value: &Bound<'_, T>) -> usize {
    value.as_ptr() as usize
}
