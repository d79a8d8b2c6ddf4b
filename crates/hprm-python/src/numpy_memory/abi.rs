//! The binary interface of NumPy that is used here: its table of functions, handlers, and the fields of an
//! array; and whether this NumPy is one whose interface is known.

#![allow(unsafe_code)]

use std::ffi::{CStr, c_int, c_uint, c_void};

use pyo3::ffi;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyCapsule;

// Numbers in NumPy's table of functions (numpy/__multiarray_api.h).
pub(super) const GET_BINARY_VERSION: usize = 0;
pub(super) const GET_FEATURE_VERSION: usize = 211;
pub(super) const SET_HANDLER: usize = 304;
pub(super) const GET_HANDLER: usize = 305;
pub(super) const DEFAULT_HANDLER: usize = 306;

/// The binary interfaces that are known here: those of NumPy 1 and 2.
pub(super) const BINARY_VERSIONS: [c_uint; 2] = [0x0100_0009, 0x0200_0000];
/// The features of NumPy 1.22, the first that has handlers.
pub(super) const FEATURE_VERSION: c_uint = 0xf;
/// What NumPy calls capsules with handlers.
pub(super) const CAPSULE: &CStr = c"mem_handler";
/// The domain in which NumPy reports its memory to `tracemalloc`.
pub(super) const TRACE_DOMAIN: c_uint = 389_047;

// Flags of arrays.
pub(super) const CONTIGUOUS: c_int = 0x1 | 0x2;
pub(super) const OWNS_DATA: c_int = 0x4;
pub(super) const WRITEABLE: c_int = 0x400;
pub(super) const WRITE_BACK: c_int = 0x2000;

/// `PyDataMemAllocator`.
#[repr(C)]
#[derive(Clone, Copy)]
pub(super) struct Allocator {
    pub(super) context: *mut c_void,
    pub(super) malloc: unsafe extern "C" fn(*mut c_void, usize) -> *mut c_void,
    pub(super) calloc: unsafe extern "C" fn(*mut c_void, usize, usize) -> *mut c_void,
    pub(super) realloc: unsafe extern "C" fn(*mut c_void, *mut c_void, usize) -> *mut c_void,
    pub(super) free: unsafe extern "C" fn(*mut c_void, *mut c_void, usize),
}

/// `PyDataMem_Handler`.
#[repr(C)]
pub(super) struct Handler {
    pub(super) name: [u8; 127],
    pub(super) version: u8,
    pub(super) allocator: Allocator,
}

/// `PyArrayObject_fields`, as it is since NumPy 1.22.
#[repr(C)]
pub(super) struct Fields {
    pub(super) object: ffi::PyObject,
    pub(super) data: *mut u8,
    pub(super) dimensions: c_int,
    pub(super) shape: *mut isize,
    pub(super) strides: *mut isize,
    pub(super) base: *mut ffi::PyObject,
    pub(super) dtype: *mut ffi::PyObject,
    pub(super) flags: c_int,
    pub(super) weak_references: *mut ffi::PyObject,
    pub(super) buffer_info: *mut c_void,
    pub(super) handler: *mut ffi::PyObject,
}

pub(super) type GetHandler = unsafe extern "C" fn() -> *mut ffi::PyObject;

/// Whether arrays have the fields that are known here.
pub(super) fn fields_are_known(py: Python<'_>) -> bool {
    static KNOWN: PyOnceLock<bool> = PyOnceLock::new();
    let find = || {
        let table = table(py)?;
        // SAFETY: this is NumPy's table.
        if !unsafe { is_known(table) } {
            return Ok(false);
        }
        // SAFETY: as above; this version has handlers.
        let get = unsafe { entry::<GetHandler>(table, GET_HANDLER) };
        // SAFETY: we are attached to the interpreter.
        let Some(handler) = release_reference(unsafe { get() }) else { return Ok(false) };
        let trial = py.import(intern!(py, "numpy"))?.getattr(intern!(py, "empty"))?.call1((1,))?;
        has_known_fields(&trial, handler)
    };
    // A NumPy that is not as expected is no error: its arrays are copied.
    let known = KNOWN.get_or_try_init(py, || Ok::<_, PyErr>(find().unwrap_or(false)));
    known.is_ok_and(|known| *known)
}

/// NumPy's table of functions, which is there as long as the module is loaded, so for ever.
pub(super) fn table(py: Python<'_>) -> PyResult<*const *mut c_void> {
    let module = py.import("numpy._core.multiarray");
    let module = module.or_else(|_| py.import("numpy.core.multiarray"))?;
    let table = module.getattr("_ARRAY_API")?.cast_into::<PyCapsule>()?;
    Ok(table.pointer_checked(None)?.cast::<*mut c_void>().as_ptr())
}

/// Whether this is a NumPy whose binary interface is known, with handlers.
///
/// # Safety
///
/// `table` is that of NumPy's functions.
pub(super) unsafe fn is_known(table: *const *mut c_void) -> bool {
    type Number = unsafe extern "C" fn() -> c_uint;
    // SAFETY: by the contract; every version has this function.
    let binary = unsafe { entry::<Number>(table, GET_BINARY_VERSION) };
    // SAFETY: by the contract; every version has this function.
    let feature = unsafe { entry::<Number>(table, GET_FEATURE_VERSION) };
    // SAFETY: it takes nothing and returns a number.
    let binary = unsafe { binary() };
    // SAFETY: it takes nothing and returns a number.
    BINARY_VERSIONS.contains(&binary) && unsafe { feature() } >= FEATURE_VERSION
}

/// Whether a new array of one element, made with that handler, has its fields where they are expected.
pub(super) fn has_known_fields(
    array: &Bound<'_, PyAny>,
    handler: *mut ffi::PyObject,
) -> PyResult<bool> {
    let address: usize =
        array.getattr("__array_interface__")?.get_item("data")?.get_item(0)?.extract()?;
    let size: usize = array.get_type().getattr("__basicsize__")?.extract()?;
    if size < size_of::<Fields>() {
        return Ok(false);
    }
    // SAFETY: the object is alive and at least that large.
    let it = unsafe { array.as_ptr().cast::<Fields>().as_ref() }.expect("it has an address");
    Ok(it.data as usize == address
        && it.dimensions == 1
        && it.handler == handler
        && it.base.is_null()
        && it.weak_references.is_null()
        && it.flags & (OWNS_DATA | WRITEABLE) == OWNS_DATA | WRITEABLE)
}

/// An entry of NumPy's table.
///
/// # Safety
///
/// The table has that entry, and it is of that type.
pub(super) unsafe fn entry<T: Copy>(table: *const *mut c_void, number: usize) -> T {
    // SAFETY: by the contract. All entries are pointers.
    unsafe { table.wrapping_add(number).cast::<T>().read() }
}

/// Releases a reference that NumPy has returned, or clears the error that it has set.
pub(super) fn release_reference(handler: *mut ffi::PyObject) -> Option<*mut ffi::PyObject> {
    if handler.is_null() {
        // SAFETY: the caller has called NumPy, so it is attached to the interpreter.
        unsafe { ffi::PyErr_Clear() };
        return None;
    }
    // SAFETY: as above; NumPy returns a reference that the caller owns.
    unsafe { ffi::Py_DECREF(handler) };
    Some(handler)
}
