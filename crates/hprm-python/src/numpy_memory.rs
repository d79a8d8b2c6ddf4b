//! NumPy's large arrays in the memory of the federate's store: the crate's second room for unsafe
//! code.
//!
//! While reactions run, NumPy asks our allocator (its NEP 49), which takes large requests from the
//! store and leaves the others to the one that NumPy had. An array made so can be published where it
//! lies: [`publish`] seals its memory and makes the array a read-only view of it. [`freeze`] does so
//! with memory of any allocator, for threads. Which arrays nobody else can reach is decided in
//! `serialize` and `parcel`.
//!
//! The argument for soundness, on which the blocks below rely:
//!
//! - A [`Room`] is never freed: arrays live as long as they like, on any thread, until the
//!   interpreter has ended. There is one, because a process has one federate that has a store.
//! - The functions of NumPy and the fields of an array are used only if NumPy says that its binary
//!   interface is one that is known here, and if an array made on trial has the fields where they are
//!   expected.
//! - What the allocator returns is memory of at least the size that was asked for, aligned to 64
//!   bytes, that nobody else has until it is freed: the yard keeps a loan for it.

#![allow(unsafe_code)]

use std::ffi::{CStr, c_int, c_uint, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::ptr::{self, NonNull};
use std::sync::{Arc, OnceLock};

use hprm_core::FederateId;
use hprm_core::limits::INLINE_LIMIT;
use hprm_store::{CowObject, Object, Store, StoreAllocator};
use pyo3::exceptions::PyRuntimeError;
use pyo3::ffi;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyCapsule, PyDict, PyTuple};

use crate::buffer::{Frozen, Memory, Part};

// Numbers in NumPy's table of functions (numpy/__multiarray_api.h).
const GET_BINARY_VERSION: usize = 0;
const GET_FEATURE_VERSION: usize = 211;
const SET_HANDLER: usize = 304;
const GET_HANDLER: usize = 305;
const DEFAULT_HANDLER: usize = 306;

/// The binary interfaces that are known here: those of NumPy 1 and 2.
const BINARY_VERSIONS: [c_uint; 2] = [0x0100_0009, 0x0200_0000];
/// The features of NumPy 1.22, the first that has handlers.
const FEATURE_VERSION: c_uint = 0xf;
/// What NumPy calls capsules with handlers.
const CAPSULE: &CStr = c"mem_handler";
/// The domain in which NumPy reports its memory to `tracemalloc`.
const TRACE_DOMAIN: c_uint = 389_047;

// Flags of arrays.
const CONTIGUOUS: c_int = 0x1 | 0x2;
const OWNS_DATA: c_int = 0x4;
const WRITEABLE: c_int = 0x400;
const WRITE_BACK: c_int = 0x2000;

unsafe extern "C" {
    fn PyTraceMalloc_Untrack(domain: c_uint, pointer: usize) -> c_int;
}

/// `PyDataMemAllocator`.
#[repr(C)]
#[derive(Clone, Copy)]
struct Allocator {
    context: *mut c_void,
    malloc: unsafe extern "C" fn(*mut c_void, usize) -> *mut c_void,
    calloc: unsafe extern "C" fn(*mut c_void, usize, usize) -> *mut c_void,
    realloc: unsafe extern "C" fn(*mut c_void, *mut c_void, usize) -> *mut c_void,
    free: unsafe extern "C" fn(*mut c_void, *mut c_void, usize),
}

/// `PyDataMem_Handler`.
#[repr(C)]
struct Handler {
    name: [u8; 127],
    version: u8,
    allocator: Allocator,
}

/// `PyArrayObject_fields`, as it is since NumPy 1.22.
#[repr(C)]
struct Fields {
    object: ffi::PyObject,
    data: *mut u8,
    dimensions: c_int,
    shape: *mut isize,
    strides: *mut isize,
    base: *mut ffi::PyObject,
    dtype: *mut ffi::PyObject,
    flags: c_int,
    weak_references: *mut ffi::PyObject,
    buffer_info: *mut c_void,
    handler: *mut ffi::PyObject,
}

/// What a process needs for its arrays; never freed.
struct Room {
    handler: Handler,
    /// The allocator that NumPy has by default.
    heap: Allocator,
    yard: Arc<StoreAllocator>,
    /// The capsules of this handler and of the default one.
    ours: *mut ffi::PyObject,
    default: *mut ffi::PyObject,
    set: unsafe extern "C" fn(*mut ffi::PyObject) -> *mut ffi::PyObject,
    get: GetHandler,
}

// SAFETY: nothing in a room changes once it is made; the yard is for all threads, NumPy's allocator
// too, and the capsules are used only by who is attached to the interpreter.
unsafe impl Send for Room {}
// SAFETY: as for `Send`.
unsafe impl Sync for Room {}

static YARD: OnceLock<Arc<StoreAllocator>> = OnceLock::new();
/// `sys.modules`.
static MODULES: PyOnceLock<Py<PyDict>> = PyOnceLock::new();
static ROOM: PyOnceLock<Option<&'static Room>> = PyOnceLock::new();

/// From now on, arrays may live in that yard. Only the first call of a process counts.
pub(crate) fn furnish(yard: &Arc<StoreAllocator>) {
    let _ = YARD.set(Arc::clone(yard));
}

/// How many arrays were refused room because too many are kept that are never published.
pub(crate) fn refused() -> u64 {
    YARD.get().map_or(0, |yard| yard.refused())
}

/// From now on, the large arrays that NumPy makes on this thread, and in contexts that are copied from
/// its own, live in the yard; if there is one, if NumPy is there, and if the program has not chosen a
/// handler of its own.
pub(crate) fn enter(py: Python<'_>) {
    if let Some(room) = room(py)
        && room.current() == Some(room.default)
    {
        room.select(room.ours);
    }
}

/// Whether there may be arrays in the yard.
pub(crate) fn is_in_use(py: Python<'_>) -> bool {
    ROOM.get(py).is_some_and(Option::is_some)
}

/// Ends what [`enter`] began on this thread.
pub(crate) fn leave(py: Python<'_>) {
    if let Some(room) = ROOM.get(py).copied().flatten()
        && room.current() == Some(room.ours)
    {
        room.select(room.default);
    }
}

/// Calls a function of NumPy whose array is to be in the federate's store, if there is one.
#[pyfunction]
#[pyo3(signature = (function, /, *arguments, **keywords))]
pub(crate) fn in_store<'py>(
    function: &Bound<'py, PyAny>,
    arguments: &Bound<'py, PyTuple>,
    keywords: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyAny>> {
    let py = function.py();
    let room = room(py).filter(|room| room.current() == Some(room.default));
    if let Some(room) = room {
        room.select(room.ours);
    }
    let made = function.call(arguments, keywords);
    if let Some(room) = room {
        room.select(room.default);
    }
    made
}

/// Seals the memory of an array in `store`, without a copy, and makes the array a view of it that
/// nobody can write to. None, and nothing has changed, if its memory is elsewhere or not wholly its
/// own, or if more than `references` refer to it; weak ones count, too.
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
    let Some(room) = ROOM.get(py).copied().flatten() else { return Ok(None) };
    let fields = array.as_ptr().cast::<Fields>();
    // SAFETY: there is a room, so NumPy's arrays have these fields; the caller passes an array, and
    // nobody changes it meanwhile, because we are attached and call no Python until the last use.
    let it = unsafe { &mut *fields };
    let whole = it.handler == room.ours
        && it.flags & (OWNS_DATA | WRITE_BACK) == OWNS_DATA
        && it.flags & CONTIGUOUS != 0
        && it.base.is_null()
        && it.weak_references.is_null();
    if !whole || count(array) != references {
        return Ok(None);
    }
    let address = it.data as usize;
    let Some(loan) = room.yard.take(address, len, store) else { return Ok(None) };
    // From here on the array does not free its memory, which is not the yard's any more, and nobody
    // writes to it. Its reference to the handler goes, because arrays that do not own their memory
    // have none.
    it.flags &= !(OWNS_DATA | WRITEABLE);
    it.handler = ptr::null_mut();
    // SAFETY: the reference that the array had a line ago.
    unsafe { ffi::Py_DECREF(room.ours) };
    // SAFETY: only forgets what it may know of that address.
    unsafe { PyTraceMalloc_Untrack(TRACE_DOMAIN, address) };
    let object = store.seal(loan, &[owner]);
    let object = store.open(object).map_err(|error| PyRuntimeError::new_err(error.to_string()))?;
    let memory = Bound::new(py, Memory(Part::Object(object.clone()))).inspect_err(|_| {
        // The array stays a view of it, without a reference of its own.
        std::mem::forget(object.clone());
    })?;
    // The array, whose base was null, takes over the reference. It keeps its memory alive by it, and
    // as the memory gives only read-only buffers, NumPy lets nobody make the array writeable again.
    it.base = memory.into_ptr();
    Ok(Some(object))
}

/// Makes the memory of an array read-only for good: the array becomes a view of what is returned, and
/// so do, through it, its views. Nobody can make one of them writeable again that is not so now. None,
/// and nothing has changed, if the array does not own its memory, or if this NumPy is not known.
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
    // A view that becomes the owner, and that only `Frozen` knows: NumPy lets the owner of memory
    // become writeable at any time.
    let keeper = array.call_method0(intern!(py, "view"))?;
    // SAFETY: the fields are known; both are arrays, and nobody changes them meanwhile, because we are
    // attached and call no Python until the last use.
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
    // SAFETY: the reference that the view had a line ago; there is the caller's.
    unsafe { ffi::Py_DECREF(array.as_ptr()) };
    // SAFETY: the view owns that memory now, and frees it when it ends. Nobody writes there: the caller
    // knows that no array is writeable that shows it, and from now on none becomes so.
    let frozen = unsafe { Frozen::new(keeper.clone().unbind(), it.data, len) };
    let frozen = Bound::new(py, frozen).inspect_err(|_| {
        // The array stays a view of it, without a reference of its own.
        std::mem::forget(keeper.clone());
    })?;
    it.base = frozen.clone().into_any().into_ptr();
    Ok(Some(frozen))
}

/// Whether arrays have the fields that are known here.
fn fields_are_known(py: Python<'_>) -> bool {
    static KNOWN: PyOnceLock<bool> = PyOnceLock::new();
    let find = || {
        if !counts_tell(py)? {
            return Ok(false);
        }
        let table = table(py)?;
        // SAFETY: this is NumPy's table.
        if !unsafe { is_known(table) } {
            return Ok(false);
        }
        // SAFETY: as above; this version has handlers.
        let get = unsafe { entry::<GetHandler>(table, GET_HANDLER) };
        // SAFETY: we are attached to the interpreter.
        let Some(handler) = Room::settle(unsafe { get() }) else { return Ok(false) };
        let trial = py.import(intern!(py, "numpy"))?.getattr(intern!(py, "empty"))?.call1((1,))?;
        has_known_fields(&trial, handler)
    };
    // A NumPy that is not as expected is no error: its arrays are copied.
    let known = KNOWN.get_or_try_init(py, || Ok::<_, PyErr>(find().unwrap_or(false)));
    known.is_ok_and(|known| *known)
}

type GetHandler = unsafe extern "C" fn() -> *mut ffi::PyObject;

/// NumPy's table of functions, which is there as long as the module is loaded, so for ever.
fn table(py: Python<'_>) -> PyResult<*const *mut c_void> {
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
unsafe fn is_known(table: *const *mut c_void) -> bool {
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
fn has_known_fields(array: &Bound<'_, PyAny>, handler: *mut ffi::PyObject) -> PyResult<bool> {
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

/// Whether counts of references say who has one: without a lock around the interpreter they do not.
pub(crate) fn counts_tell(py: Python<'_>) -> PyResult<bool> {
    let flags = py.import(intern!(py, "sys"))?.getattr(intern!(py, "abiflags"))?;
    Ok(!flags.extract::<String>()?.contains('t'))
}

/// An object that Python may write to without anybody else seeing it, not copied before that. None if
/// there is no store, or if it cannot be done.
pub(crate) fn own(py: Python<'_>, object: &Object) -> Option<Arc<CowObject>> {
    // Who has a room has it told of forks.
    room(py)?.yard.map_copy_on_write(object)
}

/// How many references there are to an object.
pub(crate) fn count<T>(object: &Bound<'_, T>) -> isize {
    // SAFETY: the object is alive, and we are attached to the interpreter.
    unsafe { ffi::Py_REFCNT(object.as_ptr()) }
}

/// The room of this process, made when NumPy is there.
fn room(py: Python<'_>) -> Option<&'static Room> {
    if let Some(room) = ROOM.get(py) {
        return *room;
    }
    let yard = YARD.get()?;
    let modules = MODULES.get_or_try_init(py, || {
        let modules = py.import(intern!(py, "sys"))?.getattr(intern!(py, "modules"))?;
        Ok::<_, PyErr>(modules.cast_into::<PyDict>()?.unbind())
    });
    if !modules.is_ok_and(|it| it.bind(py).contains(intern!(py, "numpy")).unwrap_or(false)) {
        return None;
    }
    // A NumPy that is not as expected is no error: its arrays are copied.
    let made = || Ok::<_, PyErr>(Room::make(py, yard).unwrap_or(None));
    ROOM.get_or_try_init(py, made).ok().copied().flatten()
}

impl Room {
    /// Makes the room, if this NumPy is one that is known.
    fn make(py: Python<'_>, yard: &Arc<StoreAllocator>) -> PyResult<Option<&'static Self>> {
        if !counts_tell(py)? {
            return Ok(None);
        }
        // SAFETY: this is the table of NumPy's functions; the entries have had these numbers and types
        // since they exist, and those of handlers exist if the versions are what is asked for.
        let room = unsafe { Self::from_table(table(py)?, yard)? };
        let Some(room) = room.filter(|room| room.is_as_expected(py).unwrap_or(false)) else {
            return Ok(None);
        };
        Ok(Some(room))
    }

    /// # Safety
    ///
    /// `table` is that of NumPy's functions, and we are attached to the interpreter.
    unsafe fn from_table(
        table: *const *mut c_void,
        yard: &Arc<StoreAllocator>,
    ) -> PyResult<Option<&'static Self>> {
        // SAFETY: by the contract.
        if !unsafe { is_known(table) } {
            return Ok(None);
        }
        // SAFETY: by the contract; this version has handlers.
        let set = unsafe { entry(table, SET_HANDLER) };
        // SAFETY: by the contract; this version has handlers.
        let get = unsafe { entry(table, GET_HANDLER) };
        // SAFETY: by the contract; this version has handlers.
        let default = unsafe { entry::<*const *mut ffi::PyObject>(table, DEFAULT_HANDLER) };
        // SAFETY: the entry is the address of a variable, which is set when NumPy is imported.
        let default = unsafe { default.read() };
        // SAFETY: NumPy's own capsule, which it keeps.
        let theirs = unsafe { ffi::PyCapsule_GetPointer(default, CAPSULE.as_ptr()) };
        let Some(theirs) = NonNull::new(theirs.cast::<Handler>()) else { return Ok(None) };
        // SAFETY: capsules of that name point to handlers.
        let heap = unsafe { theirs.as_ref() }.allocator;
        let allocator = Allocator { context: ptr::null_mut(), malloc, calloc, realloc, free };
        let handler = Handler { name: named("hprm"), version: 1, allocator };
        let (yard, ours) = (Arc::clone(yard), ptr::null_mut());
        let room = Box::into_raw(Box::new(Self { handler, heap, yard, ours, default, set, get }));
        // SAFETY: nobody else knows the room yet.
        let handler = unsafe { &raw mut (*room).handler };
        // SAFETY: as above.
        unsafe { (*handler).allocator.context = room.cast() };
        // SAFETY: the handler is as long as the process, and so is the name.
        let ours = unsafe { ffi::PyCapsule_New(handler.cast(), CAPSULE.as_ptr(), None) };
        // SAFETY: as above; from the next line on, it does not change any more.
        unsafe { (*room).ours = ours };
        // SAFETY: it is never freed.
        let room = unsafe { &*room };
        Ok((!ours.is_null()).then_some(room))
    }

    /// Whether an array that is made here has its fields where they are expected.
    fn is_as_expected(&self, py: Python<'_>) -> PyResult<bool> {
        let empty = py.import(intern!(py, "numpy"))?.getattr(intern!(py, "empty"))?;
        self.select(self.ours);
        let array = empty.call1((1,));
        self.select(self.default);
        has_known_fields(&array?, self.ours)
    }

    /// The handler of the current context; none if NumPy does not tell. It is only for comparisons.
    fn current(&self) -> Option<*mut ffi::PyObject> {
        // SAFETY: who has a room is attached to the interpreter.
        let handler = unsafe { (self.get)() };
        Self::settle(handler)
    }

    fn select(&self, handler: *mut ffi::PyObject) {
        // SAFETY: as above; both handlers are capsules that live for ever.
        let before = unsafe { (self.set)(handler) };
        Self::settle(before);
    }

    /// Gives up a reference that NumPy has returned, or the error that it has set.
    fn settle(handler: *mut ffi::PyObject) -> Option<*mut ffi::PyObject> {
        if handler.is_null() {
            // SAFETY: as above.
            unsafe { ffi::PyErr_Clear() };
            return None;
        }
        // SAFETY: as above; the reference is our own.
        unsafe { ffi::Py_DECREF(handler) };
        Some(handler)
    }

    /// Memory for an array in the yard, if it is for that.
    fn alloc(&self, len: usize) -> Option<*mut c_void> {
        if len <= INLINE_LIMIT {
            return None;
        }
        // Nothing may unwind into NumPy; there, the heap is the way out.
        let made = catch_unwind(AssertUnwindSafe(|| self.yard.alloc(len)));
        made.ok().flatten().map(<*mut u8>::cast)
    }

    /// Gives memory back to the yard; false if it is not from there.
    fn free(&self, pointer: *mut c_void) -> bool {
        let freed = catch_unwind(AssertUnwindSafe(|| self.yard.free(pointer as usize)));
        // If in doubt, it is lost rather than freed twice.
        freed.unwrap_or(true)
    }
}

/// An entry of NumPy's table.
///
/// # Safety
///
/// The table has that entry, and it is of that type.
unsafe fn entry<T: Copy>(table: *const *mut c_void, number: usize) -> T {
    // SAFETY: by the contract. All entries are pointers.
    unsafe { table.wrapping_add(number).cast::<T>().read() }
}

fn named(name: &str) -> [u8; 127] {
    let mut bytes = [0; 127];
    bytes[..name.len()].copy_from_slice(name.as_bytes());
    bytes
}

/// The room that is the context of a handler's functions.
///
/// # Safety
///
/// `context` is that of the handler of a room.
unsafe fn room_of(context: *mut c_void) -> &'static Room {
    // SAFETY: by the contract; rooms are never freed, and do not change.
    unsafe { &*context.cast::<Room>() }
}

unsafe extern "C" fn malloc(context: *mut c_void, len: usize) -> *mut c_void {
    // SAFETY: NumPy passes the context of the handler.
    let room = unsafe { room_of(context) };
    // SAFETY: a request for NumPy's own allocator, passed on as it came.
    room.alloc(len).unwrap_or_else(|| unsafe { (room.heap.malloc)(room.heap.context, len) })
}

unsafe extern "C" fn calloc(context: *mut c_void, count: usize, size: usize) -> *mut c_void {
    // SAFETY: NumPy passes the context of the handler.
    let room = unsafe { room_of(context) };
    let len = count.checked_mul(size).unwrap_or(0);
    if let Some(start) = room.alloc(len) {
        // SAFETY: the yard has given `len` bytes, which nobody else has.
        unsafe { ptr::write_bytes(start.cast::<u8>(), 0, len) };
        return start;
    }
    // SAFETY: a request for NumPy's own allocator, passed on as it came.
    unsafe { (room.heap.calloc)(room.heap.context, count, size) }
}

unsafe extern "C" fn realloc(context: *mut c_void, from: *mut c_void, len: usize) -> *mut c_void {
    // SAFETY: NumPy passes the context of the handler.
    let room = unsafe { room_of(context) };
    let Some(before) = room.yard.len_at(from as usize) else {
        // SAFETY: not from the yard, so from NumPy's own allocator, or null.
        return unsafe { (room.heap.realloc)(room.heap.context, from, len) };
    };
    // SAFETY: NumPy passes the context of the handler.
    let to = unsafe { malloc(context, len) };
    if !to.is_null() {
        // SAFETY: both are at least that long; `to` is new, so they do not overlap.
        unsafe { ptr::copy_nonoverlapping(from.cast::<u8>(), to.cast::<u8>(), before.min(len)) };
        room.free(from);
    }
    to
}

unsafe extern "C" fn free(context: *mut c_void, pointer: *mut c_void, len: usize) {
    // SAFETY: NumPy passes the context of the handler.
    let room = unsafe { room_of(context) };
    if !room.free(pointer) {
        // SAFETY: not from the yard, so from NumPy's own allocator, or null.
        unsafe { (room.heap.free)(room.heap.context, pointer, len) };
    }
}
