//! Ctrl-C: the first one asks the program to stop in order, the second one breaks into it.

use std::os::fd::{AsRawFd, BorrowedFd};
use std::sync::atomic::{AtomicBool, Ordering};

use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// The handler of the signal, as Python calls it.
#[pyclass(frozen, module = "hprm._hprm")]
#[derive(Default)]
pub(crate) struct Interrupt {
    /// Whether the interpreter writes to a descriptor of ours when a signal comes.
    wakes: AtomicBool,
    asked: AtomicBool,
    /// Whether the loop has not noticed yet.
    pending: AtomicBool,
    /// Whether the program has ended, so that nothing is left to be broken into.
    over: AtomicBool,
}

impl Interrupt {
    /// A handler that is in force, unless the program has one of its own, or this thread is not the
    /// one that gets signals. A signal that comes just before the loop waits wakes it by a byte to
    /// `wakeup`.
    ///
    /// # Errors
    ///
    /// What Python raises.
    pub(crate) fn install(py: Python<'_>, wakeup: BorrowedFd<'_>) -> PyResult<Py<Self>> {
        let handler = Py::new(py, Self::default())?;
        let signal = py.import(intern!(py, "signal"))?;
        let number = signal.getattr(intern!(py, "SIGINT"))?;
        let current = signal.call_method1(intern!(py, "getsignal"), (&number,))?;
        let threading = py.import(intern!(py, "threading"))?;
        let this = threading.call_method0(intern!(py, "current_thread"))?;
        let main = threading.call_method0(intern!(py, "main_thread"))?;
        if current.is(signal.getattr(intern!(py, "default_int_handler"))?) && this.is(&main) {
            signal.call_method1(intern!(py, "signal"), (&number, &handler))?;
            let quiet = PyDict::new(py);
            quiet.set_item(intern!(py, "warn_on_full_buffer"), false)?;
            let wakeup = (wakeup.as_raw_fd(),);
            signal.call_method(intern!(py, "set_wakeup_fd"), wakeup, Some(&quiet))?;
            handler.get().wakes.store(true, Ordering::Relaxed);
        }
        Ok(handler)
    }

    /// Has the interpreter forget the descriptor, which is about to be closed.
    pub(crate) fn release(&self, py: Python<'_>) {
        if self.wakes.swap(false, Ordering::Relaxed) {
            // Fails only while the interpreter itself comes to its end.
            let _ = py
                .import(intern!(py, "signal"))
                .and_then(|signal| signal.call_method1(intern!(py, "set_wakeup_fd"), (-1,)));
        }
    }

    /// From now on, signals change nothing.
    pub(crate) fn end(&self) {
        self.over.store(true, Ordering::Relaxed);
    }

    /// Whether the user has asked the program to stop since this was last called.
    pub(crate) fn take(&self, py: Python<'_>) -> bool {
        // Runs the handlers of signals that have come, and raises what they raise.
        let raised = py.check_signals().is_err();
        self.pending.swap(false, Ordering::Relaxed) || raised
    }
}

#[pymethods]
impl Interrupt {
    fn __call__(&self, _number: &Bound<'_, PyAny>, _frame: &Bound<'_, PyAny>) -> PyResult<()> {
        if self.over.load(Ordering::Relaxed) {
            return Ok(());
        }
        if self.asked.swap(true, Ordering::Relaxed) {
            return Err(PyKeyboardInterrupt::new_err(()));
        }
        self.pending.store(true, Ordering::Relaxed);
        Ok(())
    }
}
