//! A token that threads of a program give to one another: one is there or not, and a thread waits for it.
//!
//! `hprm.ros` runs the callbacks of a script in the script's own threads, one at a time, and two threads
//! change for each callback. With locks of Python, the thread that gives would wake the other one while it
//! still holds the interpreter, which that needs at once, so that each change would be two. Here the
//! thread that gives releases the interpreter first. Which thread gets a turn is decided in
//! `python/hprm/ros/_turns.py`, not here.

use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rustix::io::Errno;
use rustix::thread::futex;

/// How long a thread waits before it looks for signals. One that comes after the interpreter has looked for them and
/// before the thread waits interrupts no wait.
const LOOKS_FOR_SIGNALS: Duration = Duration::from_millis(100);

const ABSENT: u32 = 0;
const PRESENT: u32 = 1;

/// A token that threads give to one another.
#[pyclass(frozen, module = "hprm._hprm")]
pub(crate) struct Turn {
    token: AtomicU32,
}

#[pymethods]
impl Turn {
    #[new]
    fn new() -> Self {
        Self { token: AtomicU32::new(ABSENT) }
    }

    /// Put the token there, and wake the thread that waits for it; a second one is the same.
    fn give(&self) {
        // The release pairs with the acquire of `taken`, for what the threads share beside this.
        if self.token.swap(PRESENT, Ordering::Release) == ABSENT {
            // An error would be one of the address, which is that of this object.
            let _woken = futex::wake(&self.token, futex::Flags::PRIVATE, 1);
        }
    }

    /// Take the token, as soon as it is there, and return whether it was there in time.
    ///
    /// Another one may be given just before, once the interpreter is free for the thread that waits for that.
    #[pyo3(signature = (timeout=None, giving=None))]
    fn take(
        &self,
        py: Python<'_>,
        timeout: Option<f64>,
        giving: Option<PyRef<'_, Self>>,
    ) -> PyResult<bool> {
        let timeout = timeout.map(Duration::try_from_secs_f64).transpose();
        let timeout = timeout.map_err(|error| PyValueError::new_err(error.to_string()))?;
        let until = timeout.and_then(|it| Instant::now().checked_add(it));
        let mut giving = giving.as_deref();
        loop {
            let given = giving.take();
            let waited = py.detach(|| {
                if let Some(other) = given {
                    other.give();
                }
                self.wait(until)
            });
            match waited {
                Waited::Taken => return Ok(true),
                Waited::TooLong => return Ok(false),
                Waited::LooksForSignals => py.check_signals()?,
            }
        }
    }
}

enum Waited {
    Taken,
    TooLong,
    /// A signal may have come, for which there may be a handler in Python.
    LooksForSignals,
}

impl Turn {
    fn wait(&self, until: Option<Instant>) -> Waited {
        while !self.taken() {
            let left = until.map(|it| it.saturating_duration_since(Instant::now()));
            if left.is_some_and(|it| it.is_zero()) {
                return Waited::TooLong;
            }
            let is_last = left.is_some_and(|it| it <= LOOKS_FOR_SIGNALS);
            let span = left.unwrap_or(LOOKS_FOR_SIGNALS).min(LOOKS_FOR_SIGNALS);
            let span = span.try_into().ok();
            match futex::wait(&self.token, futex::Flags::PRIVATE, ABSENT, span.as_ref()) {
                Err(Errno::INTR) => return Waited::LooksForSignals,
                Err(Errno::TIMEDOUT) if !is_last => return Waited::LooksForSignals,
                // The token is there, the time is over, or the wake was not for this: look again.
                _ => {}
            }
        }
        Waited::Taken
    }

    fn taken(&self) -> bool {
        self.token.swap(ABSENT, Ordering::Acquire) == PRESENT
    }
}
