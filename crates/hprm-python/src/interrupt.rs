//! Signals, as the interpreter handles them: the first one asks the program to stop in order, the second one
//! interrupts it. That it ends in time, even if the interpreter cannot handle them, is up to
//! [`signals`](crate::signals).

use std::os::fd::{AsRawFd, OwnedFd};
use std::sync::atomic::{AtomicBool, AtomicI32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use hprm::StopProgress;
use hprm::supervisor::{SIGNAL_DEBOUNCE, Signal};

use pyo3::exceptions::{PyKeyboardInterrupt, PySystemExit};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::signals::{self, SignalEvent};
use crate::stalls;

const SIGINT: i32 = Signal::INTERRUPT.0;
const SIGTERM: i32 = Signal::TERMINATE.0;
const SIGHUP: i32 = Signal::HANG_UP.0;

/// The signals that ask a process for its end, and what Python does about each if nothing handles it.
const ASKING: [(i32, &str); 3] =
    [(SIGINT, "default_int_handler"), (SIGTERM, "SIG_DFL"), (SIGHUP, "SIG_DFL")];

/// The handler of the signals, as Python calls it.
#[pyclass(frozen, module = "hprm._hprm")]
#[derive(Default)]
pub(crate) struct Interrupt {
    /// The first signal that came, or zero.
    asked: AtomicI32,
    /// When it came.
    since: OnceLock<Instant>,
    /// Whether the loop has not noticed yet.
    pending: AtomicBool,
    /// Whether a signal is interrupting reactions, and those that run are being reported.
    is_reporting: AtomicBool,
    progress: Arc<Progress>,
    /// The descriptor to which the interpreter writes the numbers of signals, while a thread listens; and the one
    /// to which it wrote them before.
    writer: Mutex<Option<(OwnedFd, i32)>>,
    /// Which signals it handles, and what handled them before.
    previous: Mutex<Vec<(i32, Py<PyAny>)>>,
}

/// The handler that is in force, for forked processes.
static IN_FORCE: Mutex<Option<Py<Interrupt>>> = Mutex::new(None);
/// Whether Python tells of forks.
static TELLS_OF_FORKS: AtomicBool = AtomicBool::new(false);

/// How far the end has come that a signal has asked for.
#[derive(Debug, Default)]
pub(crate) struct Progress {
    /// Whether the loop knows of the signal.
    noticed: AtomicBool,
    /// Whether the interpreter has noticed the interrupting signal.
    interrupted: AtomicBool,
    /// Whether the program has ended, so that nothing is left to interrupt.
    over: AtomicBool,
}

impl Progress {
    /// Whether the loop knows of the signal.
    pub(crate) fn is_noticed(&self) -> bool {
        self.noticed.load(Ordering::Relaxed)
    }

    /// What is done so far.
    pub(crate) fn steps(&self) -> StopProgress {
        StopProgress {
            interrupted: self.interrupted.load(Ordering::Relaxed),
            over: self.over.load(Ordering::Relaxed),
        }
    }
}

/// Which signals the process handles.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Handled {
    /// All that ask for the end.
    All,
    /// Ctrl-C; the launcher of the process decides when it is to end.
    CtrlC,
}

impl Interrupt {
    /// A handler that is in force, unless the program has handlers of its own, or this thread is not the
    /// one that gets signals. What a thread is to do that receives all signals is made by `on_event`.
    ///
    /// # Errors
    ///
    /// What Python raises.
    pub(crate) fn install<H>(
        py: Python<'_>,
        handled: Handled,
        on_event: impl FnOnce(Arc<Progress>) -> H,
    ) -> PyResult<Py<Self>>
    where
        H: FnMut(SignalEvent) -> Option<Duration> + Send + 'static,
    {
        let handler = Py::new(py, Self::default())?;
        hprm_store::watch_forks();
        let threading = py.import(intern!(py, "threading"))?;
        let this = threading.call_method0(intern!(py, "current_thread"))?;
        let main = threading.call_method0(intern!(py, "main_thread"))?;
        if !this.is(&main) {
            return Ok(handler);
        }
        if !TELLS_OF_FORKS.swap(true, Ordering::Relaxed) {
            let hooks = PyDict::new(py);
            hooks.set_item(intern!(py, "after_in_child"), wrap_pyfunction!(forked, py)?)?;
            py.import(intern!(py, "os"))?.call_method("register_at_fork", (), Some(&hooks))?;
        }
        let earlier = in_force().replace(handler.clone_ref(py));
        drop(earlier);
        let mut numbers = Vec::new();
        for (number, default) in ASKING {
            let wanted = handled == Handled::All || number == SIGINT;
            if wanted && Self::handle(handler.bind(py), number, default)? {
                numbers.extend(u8::try_from(number));
            }
        }
        if !numbers.is_empty() {
            let writer = signals::listen(numbers, on_event(Arc::clone(&handler.get().progress)))?;
            let before = write_to(py, writer.as_raw_fd())?;
            let mut held = handler.get().writer.lock().unwrap_or_else(PoisonError::into_inner);
            *held = Some((writer, before));
        }
        Ok(handler)
    }

    /// Handles a signal, unless the program has a handler of its own instead of the `default`.
    fn handle(slf: &Bound<'_, Self>, number: i32, default: &str) -> PyResult<bool> {
        let signal = slf.py().import(intern!(slf.py(), "signal"))?;
        let current = signal.call_method1(intern!(slf.py(), "getsignal"), (number,))?;
        let is_free = current.eq(signal.getattr(default)?)?;
        if is_free {
            signal.call_method1(intern!(slf.py(), "signal"), (number, slf))?;
            let mut previous = slf.get().previous.lock().unwrap_or_else(PoisonError::into_inner);
            previous.push((number, current.unbind()));
        }
        Ok(is_free)
    }

    /// Ends the thread that receives signals.
    pub(crate) fn release(&self, py: Python<'_>) {
        let held = self.writer.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some((_writer, before)) = held {
            // Fails if the descriptor from before is closed, and while the interpreter itself comes to its end.
            let _ = write_to(py, before).or_else(|_| write_to(py, -1));
        }
    }

    /// Restores what handled the signals before, in a process that goes on.
    pub(crate) fn uninstall(slf: &Bound<'_, Self>) {
        let py = slf.py();
        slf.get().release(py);
        let previous =
            std::mem::take(&mut *slf.get().previous.lock().unwrap_or_else(PoisonError::into_inner));
        for (number, handler) in previous {
            // Fails only while the interpreter itself comes to its end.
            let _ = Self::hand_over(slf, number, handler.bind(py));
        }
        let mut in_force = in_force();
        if in_force.as_ref().is_some_and(|it| it.is(slf)) {
            *in_force = None;
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
        stalls::note_stop_request();
        if this.asked.load(Ordering::Relaxed) == 0 {
            this.asked.store(number, Ordering::Relaxed);
            this.pending.store(true, Ordering::Relaxed);
            return Ok(());
        }
        if since.elapsed() < SIGNAL_DEBOUNCE {
            return Ok(());
        }
        // The report runs Python code, in which the interpreter may handle the next signal. An exception there
        // would spoil the report; the signal that is being handled raises one in any case.
        if this.is_reporting.swap(true, Ordering::Relaxed) {
            return Ok(());
        }
        this.progress.interrupted.store(true, Ordering::Relaxed);
        stalls::report_interrupted(slf.py());
        this.is_reporting.store(false, Ordering::Relaxed);
        if number == SIGINT {
            return Err(PyKeyboardInterrupt::new_err(()));
        }
        // A third one ends the process at once.
        Self::restore(slf, number)?;
        Err(PySystemExit::new_err(Signal(number).exit_code()))
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
        let signal = slf.py().import(intern!(slf.py(), "signal"))?;
        Self::hand_over(slf, number, &signal.getattr(intern!(slf.py(), "SIG_DFL"))?)
    }

    /// Has another handler handle a signal, if this is its handler.
    fn hand_over(slf: &Bound<'_, Self>, number: i32, handler: &Bound<'_, PyAny>) -> PyResult<()> {
        let py = slf.py();
        if Self::handles(slf, number)? {
            let signal = py.import(intern!(py, "signal"))?;
            signal.call_method1(intern!(py, "signal"), (number, handler))?;
        }
        Ok(())
    }
}

fn in_force() -> MutexGuard<'static, Option<Py<Interrupt>>> {
    IN_FORCE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// In a process that a body has forked: it is to obey its parent like any other.
#[pyfunction]
fn forked(py: Python<'_>) -> PyResult<()> {
    // The lock may be held by a thread that is not there any more.
    let Ok(in_force) = IN_FORCE.try_lock() else { return Ok(()) };
    let handler = in_force.as_ref().map(|handler| handler.clone_ref(py));
    drop(in_force);
    let Some(handler) = handler else { return Ok(()) };
    // The pipe leads to the parent.
    handler.get().release(py);
    let restore = |number| Interrupt::restore(handler.bind(py), number);
    [SIGTERM, SIGHUP].into_iter().try_for_each(restore)
}

/// Has the interpreter write the number of each signal that comes to a descriptor, or -1 for none. Returns the
/// descriptor to which it wrote before.
fn write_to(py: Python<'_>, descriptor: i32) -> PyResult<i32> {
    let signal = py.import(intern!(py, "signal"))?;
    let quiet = PyDict::new(py);
    quiet.set_item(intern!(py, "warn_on_full_buffer"), false)?;
    signal.call_method(intern!(py, "set_wakeup_fd"), (descriptor,), Some(&quiet))?.extract()
}
