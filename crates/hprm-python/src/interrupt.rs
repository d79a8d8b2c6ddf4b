//! Signals: the first one asks the program to stop in order, the second one breaks into it. [`alone`](crate::alone)
//! makes sure that the first one is enough for a federate that was started by hand.

use std::os::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd};
use std::sync::atomic::{AtomicBool, AtomicI32, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::Instant;

use hprm::Inbox;
use hprm::supervisor::{Signal, TOGETHER};

use hprm_core::Scope;
use pyo3::exceptions::{PyKeyboardInterrupt, PySystemExit};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::alone;
use crate::stalls;
use crate::value::Value;

const SIGINT: i32 = Signal::INTERRUPT.0;
const SIGTERM: i32 = Signal::TERMINATE.0;
const SIGHUP: i32 = Signal::HANG_UP.0;

/// The handler of the signals, as Python calls it.
#[pyclass(frozen, module = "hprm._hprm")]
#[derive(Default)]
pub(crate) struct Interrupt {
    /// Whether the interpreter writes to a descriptor of ours when a signal comes.
    wakes: AtomicBool,
    /// The first signal that came, or zero.
    asked: AtomicI32,
    /// When it came.
    since: OnceLock<Instant>,
    /// Whether the loop has not noticed yet.
    pending: AtomicBool,
    /// Whether the loop has noticed, and whether the program has ended.
    progress: Arc<Progress>,
    /// Where the interpreter writes if a thread watches for signals.
    signal_writer: Mutex<Option<OwnedFd>>,
}

/// How far the end has come that a signal has asked for.
#[derive(Debug, Default)]
pub(crate) struct Progress {
    /// Whether the loop knows of the signal.
    pub(crate) noticed: AtomicBool,
    /// Whether the program has ended, so that nothing is left to be broken into.
    pub(crate) over: AtomicBool,
}

impl Interrupt {
    /// A handler that is in force, unless the program has one of its own, or this thread is not the
    /// one that gets signals. A signal that comes just before the loop waits wakes it by a byte to
    /// `wakeup`.
    ///
    /// Of a program in one process it handles all signals that ask for the end. A federate leaves
    /// those to its launcher, which stops all of them together; without one, see [`Self::handle_all`].
    ///
    /// # Errors
    ///
    /// What Python raises.
    pub(crate) fn install(
        py: Python<'_>,
        scope: Scope,
        wakeup: BorrowedFd<'_>,
    ) -> PyResult<Py<Self>> {
        let handler = Py::new(py, Self::default())?;
        hprm_store::watch_forks();
        let forked = PyDict::new(py);
        forked.set_item(intern!(py, "after_in_child"), handler.getattr(py, "_forked")?)?;
        py.import(intern!(py, "os"))?.call_method("register_at_fork", (), Some(&forked))?;
        let threading = py.import(intern!(py, "threading"))?;
        let this = threading.call_method0(intern!(py, "current_thread"))?;
        let main = threading.call_method0(intern!(py, "main_thread"))?;
        if !this.is(&main) {
            return Ok(handler);
        }
        let mut wakes = Self::handle(handler.bind(py), SIGINT, "default_int_handler")?;
        if scope == Scope::Whole {
            wakes |= Self::handle_all(handler.bind(py))?;
        }
        if wakes {
            handler.get().wakes.store(true, Ordering::Relaxed);
            Self::wake_by(py, wakeup)?;
        }
        Ok(handler)
    }

    /// Has the interpreter write the number of each signal that comes to a descriptor.
    fn wake_by(py: Python<'_>, wakeup: BorrowedFd<'_>) -> PyResult<()> {
        let signal = py.import(intern!(py, "signal"))?;
        let quiet = PyDict::new(py);
        quiet.set_item(intern!(py, "warn_on_full_buffer"), false)?;
        let wakeup = (wakeup.as_raw_fd(),);
        signal.call_method(intern!(py, "set_wakeup_fd"), wakeup, Some(&quiet))?;
        Ok(())
    }

    /// Handles all signals that ask a process to end, for a federate of that name which was started by
    /// hand; it then ends within a bounded time after the first of these signals.
    ///
    /// # Errors
    ///
    /// What Python raises.
    pub(crate) fn handle_alone(
        slf: &Bound<'_, Self>,
        federate: &str,
        inbox: &Inbox<Value>,
    ) -> PyResult<()> {
        let py = slf.py();
        if !(Self::handle_all(slf)? | slf.get().wakes.load(Ordering::Relaxed)) {
            return Ok(());
        }
        let handled = [SIGINT, SIGTERM, SIGHUP].into_iter();
        let handled = handled.filter(|number| Self::handles(slf, *number).unwrap_or(false));
        let handled: Vec<_> = handled.filter_map(|number| u8::try_from(number).ok()).collect();
        let progress = Arc::clone(&slf.get().progress);
        let writer = alone::watch(federate, handled, inbox.clone(), progress)?;
        Self::wake_by(py, writer.as_fd())?;
        slf.get().wakes.store(true, Ordering::Relaxed);
        *slf.get().signal_writer.lock().unwrap_or_else(PoisonError::into_inner) = Some(writer);
        Ok(())
    }

    /// Has it handle what asks a process for its end, too. Returns whether it handles any of that.
    fn handle_all(slf: &Bound<'_, Self>) -> PyResult<bool> {
        Ok(Self::handle(slf, SIGTERM, "SIG_DFL")? | Self::handle(slf, SIGHUP, "SIG_DFL")?)
    }

    /// Handles a signal, unless the program has a handler of its own instead of the `default`.
    fn handle(slf: &Bound<'_, Self>, number: i32, default: &str) -> PyResult<bool> {
        let signal = slf.py().import(intern!(slf.py(), "signal"))?;
        let current = signal.call_method1(intern!(slf.py(), "getsignal"), (number,))?;
        let is_free = current.eq(signal.getattr(default)?)?;
        if is_free {
            signal.call_method1(intern!(slf.py(), "signal"), (number, slf))?;
        }
        Ok(is_free)
    }

    /// Has the interpreter forget the descriptor, which is about to be closed.
    pub(crate) fn release(&self, py: Python<'_>) {
        if self.wakes.swap(false, Ordering::Relaxed) {
            // Fails only while the interpreter itself comes to its end.
            let _ = py
                .import(intern!(py, "signal"))
                .and_then(|signal| signal.call_method1(intern!(py, "set_wakeup_fd"), (-1,)));
            self.signal_writer.lock().unwrap_or_else(PoisonError::into_inner).take();
        }
    }

    /// From now on, signals change nothing.
    pub(crate) fn end(&self) {
        self.progress.over.store(true, Ordering::Relaxed);
    }

    /// Whether the user has asked the program to stop since this was last called.
    pub(crate) fn take(&self, py: Python<'_>) -> bool {
        // Runs the handlers of signals that have come, and raises what they raise.
        let raised = py.check_signals().is_err();
        let asked = self.pending.swap(false, Ordering::Relaxed) || raised;
        self.progress.noticed.fetch_or(asked, Ordering::Relaxed);
        asked
    }

    /// The exit code of a program that a signal has stopped, if one has.
    pub(crate) fn signal(&self) -> i32 {
        match self.asked.load(Ordering::Relaxed) {
            0 => SIGINT,
            number => number,
        }
    }
}

#[pymethods]
impl Interrupt {
    fn __call__(slf: &Bound<'_, Self>, number: i32, _frame: &Bound<'_, PyAny>) -> PyResult<()> {
        let this = slf.get();
        if this.progress.over.load(Ordering::Relaxed) {
            return Ok(());
        }
        let since = this.since.get_or_init(Instant::now);
        stalls::ask();
        if this.asked.load(Ordering::Relaxed) == 0 {
            this.asked.store(number, Ordering::Relaxed);
            this.pending.store(true, Ordering::Relaxed);
            return Ok(());
        }
        if since.elapsed() < TOGETHER {
            return Ok(());
        }
        stalls::break_in(slf.py());
        if number == SIGINT {
            return Err(PyKeyboardInterrupt::new_err(()));
        }
        // A third one ends the process at once.
        Self::restore(slf, number)?;
        Err(PySystemExit::new_err(Signal(number).exit_code()))
    }

    /// In a process that a body has forked: it is to obey its parent like any other.
    fn _forked(slf: &Bound<'_, Self>) -> PyResult<()> {
        [SIGTERM, SIGHUP].into_iter().try_for_each(|number| Self::restore(slf, number))
    }
}

impl Interrupt {
    /// Whether this is the handler of a signal.
    fn handles(slf: &Bound<'_, Self>, number: i32) -> PyResult<bool> {
        let signal = slf.py().import(intern!(slf.py(), "signal"))?;
        Ok(signal.call_method1(intern!(slf.py(), "getsignal"), (number,))?.is(slf))
    }

    /// Has a signal end the process, as it does by default, if this is its handler.
    fn restore(slf: &Bound<'_, Self>, number: i32) -> PyResult<()> {
        let py = slf.py();
        let signal = py.import(intern!(py, "signal"))?;
        if Self::handles(slf, number)? {
            let default = signal.getattr(intern!(py, "SIG_DFL"))?;
            signal.call_method1(intern!(py, "signal"), (number, default))?;
        }
        Ok(())
    }
}
