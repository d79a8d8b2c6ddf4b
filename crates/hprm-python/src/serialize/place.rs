//! Where the large buffers of a value go: into the own store, or into the message.
//!
//! The only copy of an array is made here, or none: an array that was allocated in the store, and that has
//! no other references, is published without a copy; and one that is a view of an object of the store is
//! forwarded.

use hprm_core::{FederateId, Part, zeroed};
use hprm_store::{Object, STREAMED, StoreAllocator, StoreError};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

use super::array::{self, Layout, Numpy};
use super::encode::Source;
use super::sole::{self, Sole};
use crate::buffer::{Draft, Staging, copy_in_a_row};
use crate::console::say;
use crate::failure::no_memory;
use crate::numpy_memory;

/// What happens then, told once.
const WITHOUT_ROOM: &str = "such values travel inside their messages now, which costs copies and \
    loses nothing (--store-full error makes it a failure)";

/// A place for large buffers.
pub(crate) struct Place<'s> {
    /// The store, and the federate that owns it; without one, everything travels in the message.
    store: Option<(&'s StoreAllocator, FederateId)>,
    /// Holds on what was stored.
    holds: Vec<Object>,
    /// The arrays that may be published without a copy.
    sole: Sole,
}

impl<'s> Place<'s> {
    /// In the store of `owner`, as long as it has room.
    pub(crate) fn store(store: &'s StoreAllocator, owner: FederateId) -> Self {
        Self { store: Some((store, owner)), holds: Vec::new(), sole: Sole::new() }
    }

    /// In the message.
    pub(crate) fn inline() -> Self {
        Self { store: None, holds: Vec::new(), sole: Sole::new() }
    }

    /// Whether everything travels in the message.
    pub(super) fn is_inline(&self) -> bool {
        self.store.is_none()
    }

    /// Ends the placing: what keeps the stored objects.
    pub(super) fn into_holds(self) -> Vec<Object> {
        self.holds
    }

    /// Looks at the value, before anything else refers to what is in it.
    ///
    /// # Errors
    ///
    /// What Python raises.
    pub(super) fn reach(&mut self, value: &Bound<'_, PyAny>) -> PyResult<()> {
        if self.store.is_some() && numpy_memory::is_in_use(value.py()) {
            self.sole = sole::find(value)?;
        }
        Ok(())
    }

    /// Places one buffer.
    pub(super) fn put(&mut self, py: Python<'_>, source: &Source<'_>) -> PyResult<Part> {
        let len = source.len()?;
        if let Source::Array(array, layout) = source
            && let Some(part) = self.as_it_lies(array, layout)?
        {
            return Ok(part);
        }
        self.write(len, |draft| source.write(py, draft))
    }

    /// Places bytes.
    pub(super) fn put_bytes(&mut self, bytes: &[u8]) -> PyResult<Part> {
        self.write(bytes.len(), |mut draft| {
            hprm::copy_value(draft.bytes_mut(), bytes);
            Ok(draft)
        })
    }

    /// The part that an array is without a copy, if it can be.
    fn as_it_lies(
        &mut self,
        array: &Bound<'_, PyAny>,
        layout: &Layout<'_>,
    ) -> PyResult<Option<Part>> {
        let Some((store, owner)) = self.store else { return Ok(None) };
        let object = if let Some(object) = array::object_under(array, layout)? {
            store.store().forward(&object)
        } else if let Some(references) = self.sole.get(&(array.as_ptr() as usize)) {
            numpy_memory::publish(array, *references, layout.len, (&mut store.store(), owner))?
        } else {
            None
        };
        let part = object.as_ref().map(|object| Part::Object(object.object_ref()));
        self.holds.extend(object);
        Ok(part)
    }

    fn write(
        &mut self,
        len: usize,
        write: impl FnOnce(Draft) -> PyResult<Draft>,
    ) -> PyResult<Part> {
        match write(self.draft(len)?)? {
            Draft::Inline(bytes) => Ok(Part::Inline(bytes)),
            Draft::Loan(loan) => {
                let (store, owner) = self.store.expect("the loan is from a store");
                let mut store = store.store();
                store.count_copy(len);
                let object = store.seal(loan, &[owner]);
                self.holds.push(store.open(object).map_err(refused)?);
                Ok(Part::Object(object))
            }
        }
    }

    fn draft(&mut self, len: usize) -> PyResult<Draft> {
        let Some((store, _)) = self.store else { return inline(len) };
        let mut store = store.store();
        match store.loan(len) {
            Ok(loan) => Ok(Draft::Loan(loan)),
            Err(error) => {
                if let Some(first) = store.fall_back(error).map_err(refused)? {
                    say(&format!("warning: {first}; {WITHOUT_ROOM}"));
                }
                inline(len)
            }
        }
    }
}

impl Source<'_> {
    fn len(&self) -> PyResult<usize> {
        Ok(match self {
            Self::Array(_, layout) => layout.len,
            Self::Bytes(bytes) => bytes.as_bytes().len(),
            Self::Text(text) => text.to_str()?.len(),
            Self::Buffer(buffer) => buffer.len_bytes(),
            Self::Writer(_, len) => *len,
        })
    }

    fn write(&self, py: Python<'_>, mut draft: Draft) -> PyResult<Draft> {
        match self {
            Self::Array(array, layout) => {
                let is_streamed = layout.len >= STREAMED && layout.has_plain_elements();
                if is_streamed && copy_in_a_row(array, draft.bytes_mut()) {
                    return Ok(draft);
                }
                let numpy = Numpy::imported(py)?;
                return Staging::lend(py, draft, |buffer| numpy.gather(array, layout, buffer));
            }
            Self::Writer(write, _) => {
                return Staging::lend(py, draft, |buffer| write.call1((buffer,)).map(drop));
            }
            Self::Bytes(bytes) => hprm::copy_value(draft.bytes_mut(), bytes.as_bytes()),
            Self::Text(text) => hprm::copy_value(draft.bytes_mut(), text.to_str()?.as_bytes()),
            Self::Buffer(buffer) => buffer.copy_to_slice(py, draft.bytes_mut())?,
        }
        Ok(draft)
    }
}

/// Memory for a buffer that travels in its message.
fn inline(len: usize) -> PyResult<Draft> {
    zeroed(len).map(Draft::Inline).map_err(no_memory)
}

fn refused(error: StoreError) -> PyErr {
    PyRuntimeError::new_err(error.to_string())
}
