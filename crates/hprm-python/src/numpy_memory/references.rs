//! How many references there are to an object, counted so that they tell whether code of the program has one.
//!
//! Where threads run without a global lock (PEP 703), an object has two counters: one for the thread that made it, without
//! atomic operations, and one for all others. Their sum may be too small for a moment, while a reference moves between
//! threads. The first alone is exact if this thread made the object and the second is zero: then no
//! other thread has a reference, and none can get one that does not come from here, or from a weak reference.

#![allow(unsafe_code)]

use pyo3::ffi;
use pyo3::prelude::*;

/// How many references there are to an object; more than there can be if other threads may have some. Weak references
/// are not counted.
#[cfg(not(Py_GIL_DISABLED))]
pub(crate) fn count<T>(object: &Bound<'_, T>) -> isize {
    // SAFETY: the object is alive, and we are attached to the interpreter.
    unsafe { ffi::Py_REFCNT(object.as_ptr()) }
}

#[cfg(Py_GIL_DISABLED)]
pub(crate) use by_thread::count;

#[cfg(Py_GIL_DISABLED)]
mod by_thread {
    use std::cell::Cell;
    use std::sync::atomic::Ordering;

    use pyo3::types::PyList;

    use super::*;

    /// Of an object to which other threads may have references, or that lives for ever.
    const MANY: isize = isize::MAX;
    /// What the counter of the others has if they have no references, but an object has or had weak ones.
    const MAYBE_WEAK: isize = 1;
    /// What the counter of this thread has for an object that lives for ever.
    const IMMORTAL: u32 = u32::MAX;

    thread_local! {
        /// What objects that this thread makes name as their thread; zero if that is not known yet.
        static THREAD: Cell<usize> = const { Cell::new(0) };
    }

    /// How many references there are to an object; more than there can be if other threads may have some. Weak references,
    /// which other threads may turn into others at any time, are not counted.
    pub(crate) fn count<T>(object: &Bound<'_, T>) -> isize {
        // SAFETY: the object is alive. Its counters are atomic; its thread is cleared only by a thread that then sets
        // the counter of others, at a time when this one is not attached or has released it.
        let it = unsafe { &*object.as_ptr() };
        let shared = it.ob_ref_shared.load(Ordering::Acquire);
        if it.ob_tid != thread(object.py()) || shared & !MAYBE_WEAK != 0 {
            return MANY;
        }
        match it.ob_ref_local.load(Ordering::Relaxed) {
            IMMORTAL => MANY,
            count => isize::try_from(count).unwrap_or(MANY),
        }
    }

    fn thread(py: Python<'_>) -> usize {
        match THREAD.get() {
            0 => {
                let made_here = PyList::empty(py);
                // SAFETY: no other thread has a reference to that list.
                let thread = unsafe { &*made_here.as_ptr() }.ob_tid;
                THREAD.set(thread);
                thread
            }
            thread => thread,
        }
    }
}
