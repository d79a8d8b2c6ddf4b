//! Publishing an array from where it is in the store, and freezing one that threads share.
//!
//! `serialize` and `parcel` decide which arrays have no other users.

#![allow(unsafe_code)]

use std::ffi::{c_int, c_uint};
use std::ptr;

use hprm_core::FederateId;
use hprm_store::{Object, Store};
use pyo3::exceptions::PyRuntimeError;
use pyo3::ffi;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::sync::critical_section::with_critical_section;

use super::abi::{
    CONTIGUOUS, Fields, OWNS_DATA, TRACE_DOMAIN, WRITE_BACK, WRITEABLE, fields_are_known,
};
use super::made_handler;
use super::references::count;
use crate::buffer::{Frozen, Memory, ReceivedPart};

unsafe extern "C" {
    fn PyTraceMalloc_Untrack(domain: c_uint, pointer: usize) -> c_int;
}

/// Seals the memory of an array in `store`, without a copy, and makes the array a read-only view of it.
/// None, and nothing has changed, if its memory is elsewhere or not wholly its own, or if more than
/// `references` refer to it; weak ones count, too.
///
/// # Errors
///
/// If the interpreter has no memory.
pub(crate) fn publish(
    array: &Bound<'_, PyAny>,
    references: isize,
    len: usize,
    (store, owner): (&mut Store, FederateId),
) -> PyResult<Option<Object>> {
    let py = array.py();
    let Some(handler) = made_handler(py) else { return Ok(None) };
    if count(array) != references {
        return Ok(None);
    }
    let fields = array.as_ptr().cast::<Fields>();
    // SAFETY: there is a handler, so NumPy's arrays have these fields; the caller passes an array, and no
    // other thread has it: all references are ours, and we call no Python until the last use.
    let it = unsafe { &mut *fields };
    let whole = it.handler == handler.capsule
        && it.flags & (OWNS_DATA | WRITE_BACK) == OWNS_DATA
        && it.flags & CONTIGUOUS != 0
        && it.base.is_null()
        && it.weak_references.is_null();
    if !whole {
        return Ok(None);
    }
    let address = it.data as usize;
    let Some(loan) = handler.store.take(address, len, store) else { return Ok(None) };
    // From here on the array does not free its memory, which the allocator does not own any more, and it
    // is read-only. Its reference to the handler is released, because arrays that do not own their
    // memory have none.
    it.flags &= !(OWNS_DATA | WRITEABLE);
    it.handler = ptr::null_mut();
    // SAFETY: releases the reference that the array had a line ago.
    unsafe { ffi::Py_DECREF(handler.capsule) };
    // SAFETY: only removes the entry of that address, if there is one.
    unsafe { PyTraceMalloc_Untrack(TRACE_DOMAIN, address) };
    let object = store.seal(loan, &[owner]);
    let object = store.open(object).map_err(|error| PyRuntimeError::new_err(error.to_string()))?;
    let memory =
        Bound::new(py, Memory(ReceivedPart::Object(object.clone()))).inspect_err(|_| {
            // The array stays a view of it, without a reference of its own.
            std::mem::forget(object.clone());
        })?;
    // The array, whose base was null, takes over the reference. It keeps its memory alive by it, and as
    // the memory gives only read-only buffers, NumPy does not allow to make the array writeable again.
    it.base = memory.into_ptr();
    Ok(Some(object))
}

/// Makes the memory of an array read-only for good: the array becomes a view of what is returned, and
/// so do, through it, its views. None of them can be made writeable again that is not writeable now.
/// None, and nothing has changed, if the array does not own its memory, or if this NumPy is not known.
///
/// # Errors
///
/// If the interpreter has no memory.
#[pyfunction]
pub(crate) fn freeze<'py>(array: &Bound<'py, PyAny>) -> PyResult<Option<Bound<'py, Frozen>>> {
    let py = array.py();
    let class = py.import(intern!(py, "numpy"))?.getattr(intern!(py, "ndarray"))?;
    if !array.get_type().is(&class) || !fields_are_known(py) {
        return Ok(None);
    }
    let len: usize = array.getattr(intern!(py, "nbytes"))?.extract()?;
    // A view that becomes the owner, and that only `Frozen` refers to: NumPy allows to make the owner of
    // memory writeable at any time.
    let keeper = array.call_method0(intern!(py, "view"))?;
    // Two federates may send the same array of a module, which is one for the process.
    with_critical_section(array, || hand_over(array, &keeper, len))
}

/// Makes `keeper`, a view of `array`, the owner of its memory.
fn hand_over<'py>(
    array: &Bound<'py, PyAny>,
    keeper: &Bound<'py, PyAny>,
    len: usize,
) -> PyResult<Option<Bound<'py, Frozen>>> {
    let py = array.py();
    // SAFETY: the fields are known; both are arrays, and no thread changes them meanwhile, because this
    // one is attached, has the array's lock, and calls no Python until the last use.
    let it = unsafe { &mut *array.as_ptr().cast::<Fields>() };
    // SAFETY: as above, and it is another array.
    let its = unsafe { &mut *keeper.as_ptr().cast::<Fields>() };
    let whole = it.flags & (OWNS_DATA | WRITE_BACK) == OWNS_DATA
        && it.flags & CONTIGUOUS != 0
        && it.base.is_null()
        && !it.handler.is_null()
        && its.base == array.as_ptr()
        && its.data == it.data;
    if !whole {
        return Ok(None);
    }
    its.flags = its.flags & !WRITEABLE | OWNS_DATA;
    its.handler = std::mem::replace(&mut it.handler, ptr::null_mut());
    its.base = ptr::null_mut();
    it.flags &= !(OWNS_DATA | WRITEABLE);
    // SAFETY: releases the reference that the view had a line ago; the caller still has one.
    unsafe { ffi::Py_DECREF(array.as_ptr()) };
    // SAFETY: the view owns that memory now, and frees it when it ends. It is not written: the caller
    // knows that no array is writeable that shows it, and from now on none becomes so.
    let frozen = unsafe { Frozen::new(keeper.clone().unbind(), it.data, len) };
    let frozen = Bound::new(py, frozen).inspect_err(|_| {
        // The array stays a view of it, without a reference of its own.
        std::mem::forget(keeper.clone());
    })?;
    it.base = frozen.clone().into_any().into_ptr();
    Ok(Some(frozen))
}
