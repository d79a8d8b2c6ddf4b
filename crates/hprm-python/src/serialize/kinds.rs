//! The bridge to `hprm._kinds`, where values of known classes are taken apart and made again.
//!
//! Which classes these are, and of what parts they are made, is decided there.

use pyo3::intern;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyTuple, PyType};

/// The names of the module that walks need.
pub(super) struct Kinds {
    take_apart: Py<PyAny>,
    make: Py<PyAny>,
    make_or_stand_in: Py<PyAny>,
    place: Py<PyAny>,
    slots_alone: Py<PyAny>,
    weak_references: Py<PyAny>,
    written: Py<PyType>,
    buffer: Py<PyType>,
}

static KINDS: PyOnceLock<Kinds> = PyOnceLock::new();

/// A value of a known class.
pub(super) struct Parts<'py> {
    /// How it is made again.
    pub(super) code: u64,
    /// Of what.
    pub(super) members: Bound<'py, PyTuple>,
}

impl Kinds {
    /// The module.
    pub(super) fn get(py: Python<'_>) -> PyResult<&'static Self> {
        KINDS.get_or_try_init(py, || {
            let module = py.import(intern!(py, "hprm._kinds"))?;
            let class = |name: &str| PyResult::Ok(module.getattr(name)?.cast_into()?.unbind());
            Ok(Self {
                take_apart: module.getattr(intern!(py, "take_apart"))?.unbind(),
                make: module.getattr(intern!(py, "make"))?.unbind(),
                make_or_stand_in: module.getattr(intern!(py, "make_or_stand_in"))?.unbind(),
                place: module.getattr(intern!(py, "place"))?.unbind(),
                slots_alone: module.getattr(intern!(py, "slots_alone"))?.unbind(),
                weak_references: py.import("_weakref")?.getattr("getweakrefcount")?.unbind(),
                written: class("Written")?,
                buffer: class("PickleBuffer")?,
            })
        })
    }

    /// What `value` is made of; none if its class is not known.
    pub(super) fn take_apart<'py>(
        &self,
        value: &Bound<'py, PyAny>,
    ) -> PyResult<Option<Parts<'py>>> {
        let parts = self.take_apart.bind(value.py()).call1((value,))?;
        if parts.is_none() {
            return Ok(None);
        }
        let (code, members) = parts.extract()?;
        Ok(Some(Parts { code, members }))
    }

    /// The value that is made of `members`. Only a trusted sender makes modules being imported.
    pub(super) fn make<'py>(
        &self,
        code: u64,
        members: &Bound<'py, PyTuple>,
        trusted: bool,
    ) -> PyResult<Bound<'py, PyAny>> {
        self.make.bind(members.py()).call1((code, members, trusted))
    }

    /// The same for a process that only looks at what others send: what stands in for an object of a class that it has
    /// not imported.
    pub(super) fn make_or_stand_in<'py>(
        &self,
        code: u64,
        members: &Bound<'py, PyTuple>,
    ) -> PyResult<Bound<'py, PyAny>> {
        self.make_or_stand_in.bind(members.py()).call1((code, members))
    }

    /// The descriptors of the slots of `value`, if its attributes can be reached only by a reference to it
    /// or to its dict, and if no code runs when they are read; else none.
    pub(super) fn slots_alone<'py>(
        &self,
        value: &Bound<'py, PyAny>,
    ) -> PyResult<Option<Bound<'py, PyTuple>>> {
        let py = value.py();
        let slots = self.slots_alone.bind(py).call1((value.get_type(),))?;
        if slots.is_none() {
            return Ok(None);
        }
        Ok(if self.is_weakly_referenced(value)? {
            None
        } else {
            Some(slots.cast_into::<PyTuple>()?)
        })
    }

    /// Whether there are weak references to `value`.
    pub(super) fn is_weakly_referenced(&self, value: &Bound<'_, PyAny>) -> PyResult<bool> {
        let count: usize = self.weak_references.bind(value.py()).call1((value,))?.extract()?;
        Ok(count > 0)
    }

    /// Where the member at `index` is in a value, for people: `.field`, or nothing.
    pub(super) fn place(&self, parts: &Parts<'_>, index: usize) -> PyResult<String> {
        let py = parts.members.py();
        self.place.bind(py).call1((parts.code, &parts.members, index))?.extract()
    }

    /// Whether `value` writes itself into a buffer, of which it tells the length.
    pub(super) fn writes_itself(&self, value: &Bound<'_, PyAny>) -> bool {
        value.get_type().is(&self.written)
    }

    /// Whether `value` is a `PickleBuffer`.
    pub(super) fn is_pickle_buffer(&self, value: &Bound<'_, PyAny>) -> bool {
        value.get_type().is(&self.buffer)
    }
}
