//! Which arrays of a value have no other references: those may be published without a copy.
//!
//! A value is encoded at the end of its tag. Local variables of bodies are gone by then, so a reference to an
//! array, or to a container that it is in, is one that the program keeps: in an attribute, a view, an
//! iterator, a thread. An array to which nothing refers but the value itself cannot be used by the program
//! any more. Reference counts tell; `publish` checks the memory of the array, and the count once more,
//! in case that it has changed.
//!
//! An object is a container, too, if its class has no code that runs when its attributes are read:
//! `hprm._kinds` decides that. There may be weak references to it, and its attributes may be in a dict, to
//! which other code may have a reference.

use std::collections::BTreeMap;

use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyFloat, PyInt, PyList, PyString, PyTuple};

use super::array::Numpy;
use super::format::DEPTH_LIMIT;
use super::kinds::Kinds;
use crate::numpy_memory::count;

/// References to an object of the value while we look at it: the value's, or that of the container
/// that it is in, and ours.
const LOOKED_AT: isize = 2;

/// The arrays, by their addresses, with the references that they have when they are published: by the
/// `Source` of an encoding, and by whatever passes the value.
pub(crate) type Sole = BTreeMap<usize, isize>;

/// The arrays to which only `value` leads; to that leads only its owner, and the reference that is
/// passed.
///
/// # Errors
///
/// What Python raises; nothing has changed then.
pub(crate) fn find(value: &Bound<'_, PyAny>) -> PyResult<Sole> {
    let mut sole = Sole::new();
    if let Some(numpy) = Numpy::if_imported(value.py())? {
        visit(numpy, value, (LOOKED_AT + 1, 0), &mut sole)?;
    }
    Ok(sole)
}

/// `references` are those that it has when it is published, if it is an array.
fn visit(
    numpy: &Numpy,
    value: &Bound<'_, PyAny>,
    (references, depth): (isize, u32),
    sole: &mut Sole,
) -> PyResult<()> {
    if count(value) != LOOKED_AT || depth > DEPTH_LIMIT {
        return Ok(());
    }
    let mut below = |member: &Bound<'_, PyAny>| visit(numpy, member, (LOOKED_AT, depth + 1), sole);
    if numpy.is_array(value) {
        // With a global lock, no thread turns a weak reference into another one meanwhile.
        if !cfg!(Py_GIL_DISABLED) || !Kinds::get(value.py())?.is_weakly_referenced(value)? {
            sole.insert(value.as_ptr() as usize, references);
        }
    } else if let Ok(list) = value.cast_exact::<PyList>() {
        list.iter().try_for_each(|member| below(&member))?;
    } else if let Ok(tuple) = value.cast_exact::<PyTuple>() {
        tuple.iter().try_for_each(|member| below(&member))?;
    } else if let Ok(dict) = value.cast_exact::<PyDict>() {
        // Nothing here runs code of the program, so the dict does not change meanwhile.
        dict.iter().try_for_each(|(_, member)| below(&member))?;
    } else if !is_leaf(value)
        && let Some(slots) = Kinds::get(value.py())?.slots_alone(value)?
    {
        attributes(value, &slots, &mut below)?;
    }
    Ok(())
}

/// Whether it is of a type without members, of which there may be many values.
fn is_leaf(value: &Bound<'_, PyAny>) -> bool {
    value.is_exact_instance_of::<PyFloat>()
        || value.is_exact_instance_of::<PyString>()
        || value.is_exact_instance_of::<PyInt>()
        || value.is_exact_instance_of::<PyBytes>()
}

/// Visits what an object leads to, of which `slots` are the descriptors.
fn attributes(
    value: &Bound<'_, PyAny>,
    slots: &Bound<'_, PyTuple>,
    below: &mut dyn FnMut(&Bound<'_, PyAny>) -> PyResult<()>,
) -> PyResult<()> {
    let py = value.py();
    if let Ok(tuple) = value.cast::<PyTuple>() {
        return tuple.iter().try_for_each(|member| below(&member));
    }
    for slot in slots.iter() {
        // One that is not set raises, and leads nowhere.
        if let Ok(member) = slot.call_method1(intern!(py, "__get__"), (value,)) {
            below(&member)?;
        }
    }
    let Ok(dict) = value.getattr(intern!(py, "__dict__")) else { return Ok(()) };
    match dict.cast_exact::<PyDict>() {
        Ok(dict) if count(dict) == LOOKED_AT => {
            dict.iter().try_for_each(|(_, member)| below(&member))
        }
        // There is another reference to the dict itself.
        _ => Ok(()),
    }
}
