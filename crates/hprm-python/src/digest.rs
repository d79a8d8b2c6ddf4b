//! Digests of Python values for the logical trace: equal for equal values, whichever process made
//! them.
//!
//! A digest is that of a tree: each value has a kind and either bytes or the digests of its members.
//! So it depends on nothing but the value: not on addresses, on the seed of hashes, on what is shared
//! with what. A member that is one of the values around it is written as the distance to it. Where
//! values refer to one another so much that the tree would be endless, they are numbered in the order
//! of the walk instead. What is not of a basic type is taken apart in `hprm._digest`.

use std::collections::{BTreeMap, BTreeSet};

use hprm::trace::{Described, Digest, Digester};
use pyo3::buffer::PyBuffer;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{
    PyBool, PyByteArray, PyBytes, PyDict, PyFloat, PyInt, PyList, PySlice, PyString, PyTuple,
};

use crate::buffer::Memory;

/// The deepest nesting that is looked into. Below that, a value counts as opaque.
const DEPTH_LIMIT: u32 = 200;

/// Bytes of a buffer that are copied at a time.
const PIECE: usize = 1 << 18;

/// How often values inside a cycle may be walked again before they are numbered.
const PATIENCE: u32 = 10_000;

/// Describes a value, and says whether it will always be described so, since nothing can change it.
/// Never fails.
pub(crate) fn describe(value: &Bound<'_, PyAny>) -> (Described, bool) {
    let mut walk = Walk::new(value.py(), false);
    let mut digest = walk.node(value);
    if matches!(digest, Err(Stop::Tangled)) {
        walk = Walk::new(value.py(), true);
        digest = walk.node(value);
    }
    let text = text(value).unwrap_or_else(|_| "value".to_owned());
    match digest {
        Ok(digest) => (Described { digest, text, opaque: walk.opaque }, walk.fixed),
        Err(_) => (Described::opaque(&text), false),
    }
}

fn text(value: &Bound<'_, PyAny>) -> PyResult<String> {
    let module = value.py().import(intern!(value.py(), "hprm._digest"))?;
    module.call_method1(intern!(value.py(), "text"), (value,))?.extract()
}

/// Why a walk ends early.
enum Stop {
    /// Too many values refer to one another.
    Tangled,
    /// Python raised, which it should not.
    Raised,
}

impl From<PyErr> for Stop {
    fn from(_: PyErr) -> Self {
        Self::Raised
    }
}

struct Walk<'py> {
    py: Python<'py>,
    /// Whether values are numbered; a value that occurs again is then its number.
    numbered: bool,
    /// What is known, by address.
    known: BTreeMap<usize, Known>,
    /// Values whose digest depends on where they are, by address.
    entangled: BTreeSet<usize>,
    /// Keeps what has been walked, so that no address is used twice.
    kept: Vec<Bound<'py, PyAny>>,
    depth: u32,
    /// The smallest depth of a value around that the current one refers to.
    outermost: u32,
    again: u32,
    opaque: bool,
    /// Whether nothing that has been walked can change.
    fixed: bool,
}

#[derive(Clone, Copy)]
enum Known {
    /// Its members are being walked, at this depth.
    Open(u32),
    Digest(Digest),
    Number(u64),
}

impl<'py> Walk<'py> {
    fn new(py: Python<'py>, numbered: bool) -> Self {
        Self {
            py,
            numbered,
            known: BTreeMap::new(),
            entangled: BTreeSet::new(),
            kept: Vec::new(),
            depth: 0,
            outermost: u32::MAX,
            again: 0,
            opaque: false,
            fixed: true,
        }
    }

    fn node(&mut self, value: &Bound<'py, PyAny>) -> Result<Digest, Stop> {
        if value.is_none() {
            Ok(Digest::of_bytes("none", &[]))
        } else if let Ok(value) = value.cast_exact::<PyBool>() {
            Ok(Digest::of_bytes("bool", &[u8::from(value.is_true())]))
        } else if let Ok(value) = value.cast_exact::<PyFloat>() {
            let value = value.value();
            let value = if value.is_nan() { f64::NAN } else { value };
            Ok(Digest::of_bytes("float", &value.to_le_bytes()))
        } else if let Ok(value) = value.cast_exact::<PyInt>() {
            self.integer(value)
        } else if let Ok(value) = value.cast_exact::<PyString>() {
            self.string(value)
        } else if let Ok(value) = value.cast_exact::<PyBytes>() {
            Ok(Digest::of_bytes("bytes", value.as_bytes()))
        } else {
            self.shared(value)
        }
    }

    /// A value that may refer to others, or be referred to by itself.
    fn shared(&mut self, value: &Bound<'py, PyAny>) -> Result<Digest, Stop> {
        let address = value.as_ptr() as usize;
        match self.known.get(&address) {
            Some(Known::Digest(digest)) => return Ok(*digest),
            Some(Known::Number(number)) => {
                return Ok(Digest::of_bytes("again", &number.to_le_bytes()));
            }
            Some(Known::Open(depth)) => {
                self.outermost = self.outermost.min(*depth);
                return Ok(Digest::of_bytes("around", &(self.depth - depth).to_le_bytes()));
            }
            None => {}
        }
        if self.depth >= DEPTH_LIMIT {
            self.opaque = true;
            return Ok(Digest::of_bytes("deep", value.get_type().name()?.to_string().as_bytes()));
        }
        let known = match self.numbered {
            true => Known::Number(self.known.len() as u64),
            false => Known::Open(self.depth),
        };
        self.known.insert(address, known);
        self.kept.push(value.clone());
        let around = std::mem::replace(&mut self.outermost, u32::MAX);
        self.depth += 1;
        let digest = self.inside(value)?;
        self.depth -= 1;
        if !self.numbered {
            self.settle(address, digest)?;
        }
        // What refers no further than to this value is of no interest outside of it.
        let beyond = if self.outermost < self.depth { self.outermost } else { u32::MAX };
        self.outermost = around.min(beyond);
        Ok(digest)
    }

    /// Remembers the digest of a value if it is the same wherever the value occurs.
    fn settle(&mut self, address: usize, digest: Digest) -> Result<(), Stop> {
        if self.outermost >= self.depth {
            self.known.insert(address, Known::Digest(digest));
            return Ok(());
        }
        self.known.remove(&address);
        if !self.entangled.insert(address) {
            self.again += 1;
        }
        if self.again > PATIENCE { Err(Stop::Tangled) } else { Ok(()) }
    }

    fn inside(&mut self, value: &Bound<'py, PyAny>) -> Result<Digest, Stop> {
        if let Ok(tuple) = value.cast_exact::<PyTuple>() {
            return self.members("tuple", tuple.iter());
        }
        let fixed = self.fixed;
        self.fixed = false;
        if let Ok(list) = value.cast_exact::<PyList>() {
            self.members("list", list.iter())
        } else if let Ok(dict) = value.cast_exact::<PyDict>() {
            let pairs = dict.items();
            let mut members = Vec::with_capacity(2 * pairs.len());
            for pair in pairs.iter() {
                members.extend([pair.get_item(0)?, pair.get_item(1)?]);
            }
            self.members("dict", members.into_iter())
        } else if let Ok(bytes) = value.cast_exact::<PyByteArray>() {
            Ok(Digest::of_bytes("bytearray", &bytes.to_vec()))
        } else {
            self.foreign(value, fixed)
        }
    }

    /// Something that is not of a basic type; all before it was `fixed` or not.
    fn foreign(&mut self, value: &Bound<'py, PyAny>, fixed: bool) -> Result<Digest, Stop> {
        let module = self.py.import(intern!(self.py, "hprm._digest"))?;
        let parts = module.call_method1(intern!(self.py, "take_apart"), (value,))?;
        let (kind, name, held): (String, String, Bound<'py, PyAny>) = parts.extract()?;
        let inside = match kind.as_str() {
            "members" => {
                self.members("members", held.cast::<PyList>().map_err(PyErr::from)?.iter())?
            }
            "unordered" => self.unordered(held.cast::<PyList>().map_err(PyErr::from)?)?,
            "bytes" => {
                self.fixed = fixed && has_arrived(value)?;
                self.buffer(&held)?
            }
            "named" => Digest::of_bytes("named", &[]),
            _ => {
                self.opaque = true;
                Digest::of_bytes("opaque", &[])
            }
        };
        let mut digester = Digester::of_kind("object");
        digester.write(&Digest::of_bytes("name", name.as_bytes()).0.to_le_bytes());
        digester.write(&inside.0.to_le_bytes());
        Ok(digester.finish())
    }

    /// The bytes of a buffer, copied piece by piece: they may be many, and Python may change them.
    fn buffer(&self, held: &Bound<'py, PyAny>) -> Result<Digest, Stop> {
        let len = held.len()?;
        let mut digester = Digester::of_kind("buffer");
        let mut piece = vec![0; len.min(PIECE)];
        for from in (0..len).step_by(PIECE) {
            let until = len.min(from + PIECE);
            let part = held.get_item(PySlice::new(self.py, from as isize, until as isize, 1))?;
            let bytes = &mut piece[..until - from];
            PyBuffer::<u8>::get(&part)?.copy_to_slice(self.py, bytes)?;
            digester.write(bytes);
        }
        Ok(digester.finish())
    }

    fn members(
        &mut self,
        kind: &str,
        members: impl ExactSizeIterator<Item = Bound<'py, PyAny>>,
    ) -> Result<Digest, Stop> {
        let mut digester = Digester::of_kind(kind);
        digester.write(&(members.len() as u64).to_le_bytes());
        for member in members {
            digester.write(&self.node(&member)?.0.to_le_bytes());
        }
        Ok(digester.finish())
    }

    /// Members whose order depends on their hashes: sorted by their digests. Each is walked for
    /// itself, so that its digest does not depend on those before it.
    fn unordered(&mut self, members: &Bound<'py, PyList>) -> Result<Digest, Stop> {
        let mut digests = Vec::with_capacity(members.len());
        for member in members.iter() {
            if self.numbered {
                let mut walk = Walk::new(self.py, true);
                walk.depth = self.depth;
                digests.push(walk.node(&member)?);
                self.opaque |= walk.opaque;
                self.fixed &= walk.fixed;
            } else {
                digests.push(self.node(&member)?);
            }
        }
        digests.sort_unstable();
        let mut digester = Digester::of_kind("unordered");
        for digest in digests {
            digester.write(&digest.0.to_le_bytes());
        }
        Ok(digester.finish())
    }

    fn integer(&self, value: &Bound<'py, PyInt>) -> Result<Digest, Stop> {
        if let Ok(number) = value.extract::<i64>() {
            return Ok(Digest::of_bytes("int", &number.to_le_bytes()));
        }
        let bits: usize = value.call_method0(intern!(self.py, "bit_length"))?.extract()?;
        let signed = PyDict::new(self.py);
        signed.set_item(intern!(self.py, "signed"), true)?;
        let arguments = (bits / 8 + 1, intern!(self.py, "little"));
        let bytes = value.call_method(intern!(self.py, "to_bytes"), arguments, Some(&signed))?;
        Ok(Digest::of_bytes("int", bytes.extract().map_err(PyErr::from)?))
    }

    fn string(&self, value: &Bound<'py, PyString>) -> Result<Digest, Stop> {
        if let Ok(text) = value.to_str() {
            return Ok(Digest::of_bytes("str", text.as_bytes()));
        }
        // A lone surrogate.
        let arguments = (intern!(self.py, "utf-8"), intern!(self.py, "surrogatepass"));
        let bytes = value.call_method1(intern!(self.py, "encode"), arguments)?;
        Ok(Digest::of_bytes("str", bytes.extract().map_err(PyErr::from)?))
    }
}

/// Whether the elements of an array have arrived and are read in place: then nothing can change them.
fn has_arrived(array: &Bound<'_, PyAny>) -> PyResult<bool> {
    let py = array.py();
    let mut held = array.clone();
    while held.cast_exact::<Memory>().is_err() {
        let Some(flags) = held.getattr_opt(intern!(py, "flags"))? else { return Ok(false) };
        if flags.getattr(intern!(py, "writeable"))?.is_truthy()? {
            return Ok(false);
        }
        held = held.getattr(intern!(py, "base"))?;
    }
    Ok(true)
}
