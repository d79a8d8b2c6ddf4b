//! Which arrays of a value nobody else can reach: those may be published where they lie.
//!
//! A value is encoded at the end of its tag. Local variables of bodies have gone by then, so whatever
//! still refers to an array, or to a container that it is in, is something that the program keeps: an
//! attribute, a view, an iterator, a thread. An array to which nothing refers but the value
//! itself will never be seen by the program again. Reference counts tell; the memory of the array is
//! looked at by who publishes it, and the count once more, in case that something has changed.

use std::collections::BTreeMap;

use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyTuple};

use super::format::DEPTH_LIMIT;
use crate::numpy_memory::count;

/// References to an object of the value while we look at it: the value's, or that of the container
/// that it is in, and ours.
const LOOKED_AT: isize = 2;

/// The arrays, by their addresses, with the references that they have when they are published: by the
/// `Source` of an encoding, and by whatever passes the value.
pub(crate) type Sole = BTreeMap<usize, isize>;

/// The arrays to which only `value` leads; to that leads only its owner, and the reference that is
/// passed.
pub(crate) fn find(value: &Bound<'_, PyAny>) -> Sole {
    let mut sole = Sole::new();
    visit(value, LOOKED_AT + 1, 0, &mut sole);
    sole
}

/// `references` are those that it has when it is published, if it is an array.
fn visit(value: &Bound<'_, PyAny>, references: isize, depth: u32, sole: &mut Sole) {
    if count(value) != LOOKED_AT || depth > DEPTH_LIMIT {
        return;
    }
    let below = depth + 1;
    if let Ok(list) = value.cast_exact::<PyList>() {
        list.iter().for_each(|member| visit(&member, LOOKED_AT, below, sole));
    } else if let Ok(tuple) = value.cast_exact::<PyTuple>() {
        tuple.iter().for_each(|member| visit(&member, LOOKED_AT, below, sole));
    } else if let Ok(dict) = value.cast_exact::<PyDict>() {
        // Nothing here runs Python code, so nobody changes the dict meanwhile.
        dict.iter().for_each(|(_, member)| visit(&member, LOOKED_AT, below, sole));
    } else {
        sole.insert(value.as_ptr() as usize, references);
    }
}
