//! NumPy's large arrays in the memory of the federate's store.
//!
//! While reactions run, NumPy asks a [handler](handler::StoreHandler) of its own (NEP 49), which takes
//! large requests from the store and leaves the others to NumPy's default handler. An array made so can be
//! published without a copy: [`publish`] seals its memory and makes the array a read-only view of it.
//! [`freeze()`] does so with memory of any allocator, for threads.
//!
//! The argument for soundness, on which the unsafe blocks of the files below rely:
//!
//! - A [`StoreHandler`] is never freed: arrays may live for any time, on any thread, until the interpreter
//!   has ended. There is one, because a process has one federate that has a store.
//! - The functions of NumPy and the fields of an array are used only if NumPy says that its binary
//!   interface is one that is known here, and if an array made on trial has the fields where they are
//!   expected.
//! - What the handler returns is memory of at least the size that was asked for, aligned to 64 bytes, to
//!   which there is no other pointer until it is freed: the store's allocator keeps a loan for it.

mod abi;
mod handler;
mod publish;
mod references;

use std::sync::{Arc, OnceLock};

use hprm_store::{CowObject, Object, StoreAllocator};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyDict, PyTuple};

use self::handler::{StoreHandler, made_to_be_sent};
pub(crate) use self::publish::{freeze, publish};
pub(crate) use self::references::count;

static ALLOCATOR: OnceLock<Arc<StoreAllocator>> = OnceLock::new();
/// `sys.modules`.
static MODULES: PyOnceLock<Py<PyDict>> = PyOnceLock::new();
static HANDLER: PyOnceLock<Option<&'static StoreHandler>> = PyOnceLock::new();

/// From now on, arrays may be allocated in that store. Only the first call of a process counts.
pub(crate) fn set_allocator(allocator: &Arc<StoreAllocator>) {
    let _ = ALLOCATOR.set(Arc::clone(allocator));
}

/// How many arrays were refused, because arrays that are kept and never published use their share of the
/// store.
pub(crate) fn refused() -> u64 {
    ALLOCATOR.get().map_or(0, |allocator| allocator.refused())
}

/// From now on, the large arrays that NumPy makes on this thread, and in contexts that are copied from
/// its own, are in the store; if there is one, if NumPy is imported, and if the program has not chosen a
/// handler of its own. Python calls it on threads that run code of a program although they are not the
/// federate's.
#[pyfunction(name = "use_store")]
pub(crate) fn enter(py: Python<'_>) {
    if let Some(handler) = handler(py)
        && handler.current() == Some(handler.default)
    {
        handler.select(handler.capsule);
    }
}

/// Whether there may be arrays in the store.
pub(crate) fn is_in_use(py: Python<'_>) -> bool {
    made_handler(py).is_some()
}

/// Ends what [`enter`] began on this thread.
pub(crate) fn leave(py: Python<'_>) {
    if let Some(handler) = made_handler(py)
        && handler.current() == Some(handler.capsule)
    {
        handler.select(handler.default);
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
    let handler = handler(py).filter(|handler| handler.current() == Some(handler.default));
    if let Some(handler) = handler {
        handler.select(handler.capsule);
    }
    let made = made_to_be_sent(|| function.call(arguments, keywords));
    if let Some(handler) = handler {
        handler.select(handler.default);
    }
    made
}

/// An object in a copy-on-write mapping, to which Python may write without any other process seeing it.
/// None if there is no store, or if the object cannot be mapped so.
pub(crate) fn map_copy_on_write(py: Python<'_>, object: &Object) -> Option<Arc<CowObject>> {
    // A process that has a handler has registered its allocator for forks.
    handler(py)?.store.map_copy_on_write(object)
}

/// Whether the program has imported NumPy. The dict of modules is kept: an import statement takes longer than
/// encoding a small value.
///
/// # Errors
///
/// If Python raises.
pub(crate) fn is_imported(py: Python<'_>) -> PyResult<bool> {
    let modules = MODULES.get_or_try_init(py, || {
        let modules = py.import(intern!(py, "sys"))?.getattr(intern!(py, "modules"))?;
        Ok::<_, PyErr>(modules.cast_into::<PyDict>()?.unbind())
    })?;
    modules.bind(py).contains(intern!(py, "numpy"))
}

/// The handler of this process, if it was made already.
fn made_handler(py: Python<'_>) -> Option<&'static StoreHandler> {
    HANDLER.get(py).copied().flatten()
}

/// The handler of this process, made when NumPy has been imported.
fn handler(py: Python<'_>) -> Option<&'static StoreHandler> {
    if let Some(handler) = HANDLER.get(py) {
        return *handler;
    }
    let allocator = ALLOCATOR.get()?;
    if !is_imported(py).unwrap_or(false) {
        return None;
    }
    // A NumPy that is not as expected is no error: its arrays are copied.
    let made = || Ok::<_, PyErr>(StoreHandler::new(py, allocator).unwrap_or(None));
    HANDLER.get_or_try_init(py, made).ok().copied().flatten()
}
