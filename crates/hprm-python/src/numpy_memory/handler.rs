//! The handler by which NumPy allocates arrays in the store (NEP 49).

#![allow(unsafe_code)]

use std::cell::Cell;
use std::ffi::c_void;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::ptr::{self, NonNull};
use std::sync::Arc;

use hprm_core::limits::{HEAP_ARRAY_LIMIT, INLINE_LIMIT};
use hprm_store::StoreAllocator;
use pyo3::ffi;
use pyo3::intern;
use pyo3::prelude::*;

use super::abi::{
    Allocator, CAPSULE, DEFAULT_HANDLER, GET_HANDLER, GetHandler, Handler, SET_HANDLER, entry,
    has_known_fields, is_known, release_reference, table,
};

thread_local! {
    /// How many bytes an array may have on this thread that is to be in the heap.
    static LEFT_IN_HEAP: Cell<usize> = const { Cell::new(HEAP_ARRAY_LIMIT) };
}

/// Calls a function whose array is made to be sent: all that does not travel inside a message is to be in the store.
pub(super) fn made_to_be_sent<T>(make: impl FnOnce() -> T) -> T {
    let before = LEFT_IN_HEAP.replace(INLINE_LIMIT);
    let made = make();
    LEFT_IN_HEAP.set(before);
    made
}

/// NumPy's handler for arrays in the store; never freed.
pub(super) struct StoreHandler {
    handler: Handler,
    /// The allocator that NumPy has by default.
    heap: Allocator,
    pub(super) store: Arc<StoreAllocator>,
    /// The capsule of this handler.
    pub(super) capsule: *mut ffi::PyObject,
    /// The capsule of NumPy's default handler.
    pub(super) default: *mut ffi::PyObject,
    set: unsafe extern "C" fn(*mut ffi::PyObject) -> *mut ffi::PyObject,
    get: GetHandler,
}

// SAFETY: nothing in a handler changes once it is made; the store's allocator may be used by all threads,
// NumPy's allocator too, and the capsules are used only by threads that are attached to the interpreter.
unsafe impl Send for StoreHandler {}
// SAFETY: as for `Send`.
unsafe impl Sync for StoreHandler {}

impl StoreHandler {
    /// Makes the handler, if this NumPy is one that is known.
    pub(super) fn new(
        py: Python<'_>,
        store: &Arc<StoreAllocator>,
    ) -> PyResult<Option<&'static Self>> {
        // SAFETY: this is the table of NumPy's functions; the entries have had these numbers and types
        // since they exist, and those of handlers exist if the versions are what is asked for.
        let handler = unsafe { Self::from_table(table(py)?, store)? };
        Ok(handler.filter(|handler| handler.is_as_expected(py).unwrap_or(false)))
    }

    /// # Safety
    ///
    /// `table` is that of NumPy's functions, and we are attached to the interpreter.
    unsafe fn from_table(
        table: *const *mut c_void,
        store: &Arc<StoreAllocator>,
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
        let (store, capsule) = (Arc::clone(store), ptr::null_mut());
        let this = Self { handler, heap, store, capsule, default, set, get };
        let this = Box::into_raw(Box::new(this));
        // SAFETY: there is no other pointer to it yet.
        let handler = unsafe { &raw mut (*this).handler };
        // SAFETY: as above.
        unsafe { (*handler).allocator.context = this.cast() };
        // SAFETY: the handler lives as long as the process, and so does the name.
        let capsule = unsafe { ffi::PyCapsule_New(handler.cast(), CAPSULE.as_ptr(), None) };
        // SAFETY: as above; from the next line on, it does not change any more.
        unsafe { (*this).capsule = capsule };
        // SAFETY: it is never freed.
        let this = unsafe { &*this };
        Ok((!capsule.is_null()).then_some(this))
    }

    /// Whether an array that is made here has its fields where they are expected.
    fn is_as_expected(&self, py: Python<'_>) -> PyResult<bool> {
        let empty = py.import(intern!(py, "numpy"))?.getattr(intern!(py, "empty"))?;
        self.select(self.capsule);
        let array = empty.call1((1,));
        self.select(self.default);
        has_known_fields(&array?, self.capsule)
    }

    /// The handler of the current context; none if NumPy does not tell. The pointer is only for comparisons.
    pub(super) fn current(&self) -> Option<*mut ffi::PyObject> {
        // SAFETY: only threads that are attached to the interpreter use a handler.
        let handler = unsafe { (self.get)() };
        release_reference(handler)
    }

    /// Makes a handler the one of the current context.
    pub(super) fn select(&self, handler: *mut ffi::PyObject) {
        // SAFETY: as above; both handlers are capsules that live for ever.
        let before = unsafe { (self.set)(handler) };
        release_reference(before);
    }

    /// Memory in the store, for a large array.
    fn alloc(&self, len: usize) -> Option<*mut c_void> {
        if len <= LEFT_IN_HEAP.get() {
            return None;
        }
        // Nothing may unwind into NumPy; after a panic the array is in the heap.
        let made = catch_unwind(AssertUnwindSafe(|| self.store.alloc(len)));
        made.ok().flatten().map(<*mut u8>::cast)
    }

    /// Frees memory of the store; false if it is not from there.
    fn free(&self, pointer: *mut c_void) -> bool {
        let freed = catch_unwind(AssertUnwindSafe(|| self.store.free(pointer as usize)));
        // After a panic, memory is leaked rather than freed twice.
        freed.unwrap_or(true)
    }
}

fn named(name: &str) -> [u8; 127] {
    let mut bytes = [0; 127];
    bytes[..name.len()].copy_from_slice(name.as_bytes());
    bytes
}

/// The handler that is the context of its functions.
///
/// # Safety
///
/// `context` is that of a [`StoreHandler`].
unsafe fn handler_of(context: *mut c_void) -> &'static StoreHandler {
    // SAFETY: by the contract; handlers are never freed, and do not change.
    unsafe { &*context.cast::<StoreHandler>() }
}

unsafe extern "C" fn malloc(context: *mut c_void, len: usize) -> *mut c_void {
    // SAFETY: NumPy passes the context of the handler.
    let this = unsafe { handler_of(context) };
    // SAFETY: a request for NumPy's own allocator, unchanged.
    this.alloc(len).unwrap_or_else(|| unsafe { (this.heap.malloc)(this.heap.context, len) })
}

unsafe extern "C" fn calloc(context: *mut c_void, count: usize, size: usize) -> *mut c_void {
    // SAFETY: NumPy passes the context of the handler.
    let this = unsafe { handler_of(context) };
    let len = count.checked_mul(size).unwrap_or(0);
    if let Some(start) = this.alloc(len) {
        // SAFETY: the store has given `len` bytes, to which there is no other pointer.
        unsafe { ptr::write_bytes(start.cast::<u8>(), 0, len) };
        return start;
    }
    // SAFETY: a request for NumPy's own allocator, unchanged.
    unsafe { (this.heap.calloc)(this.heap.context, count, size) }
}

unsafe extern "C" fn realloc(context: *mut c_void, from: *mut c_void, len: usize) -> *mut c_void {
    // SAFETY: NumPy passes the context of the handler.
    let this = unsafe { handler_of(context) };
    let Some(before) = this.store.len_at(from as usize) else {
        // SAFETY: not from the store, so from NumPy's own allocator, or null.
        return unsafe { (this.heap.realloc)(this.heap.context, from, len) };
    };
    // SAFETY: NumPy passes the context of the handler.
    let to = unsafe { malloc(context, len) };
    if !to.is_null() {
        // SAFETY: both are at least that long; `to` is new, so they do not overlap.
        unsafe { ptr::copy_nonoverlapping(from.cast::<u8>(), to.cast::<u8>(), before.min(len)) };
        this.free(from);
    }
    to
}

unsafe extern "C" fn free(context: *mut c_void, pointer: *mut c_void, len: usize) {
    // SAFETY: NumPy passes the context of the handler.
    let this = unsafe { handler_of(context) };
    if !this.free(pointer) {
        // SAFETY: not from the store, so from NumPy's own allocator, or null.
        unsafe { (this.heap.free)(this.heap.context, pointer, len) };
    }
}
