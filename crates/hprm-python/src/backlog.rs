//! The events that other threads have scheduled and no reaction has processed yet, and their limit.
//!
//! A thread that schedules a physical action faster than reactions run fills the memory. A warning is
//! written once, and from a limit on, if there is one, the thread gets an error. Only events with a value
//! count. An event counts as processed when its value is dropped.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use hprm::{EventLimit, Failure};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{PyByteArray, PyBytes, PyDict, PyList, PyString, PyTuple};

use crate::console::say;
use crate::serialize;

/// The environment variable with the limit.
const NAME: &str = EventLimit::NAME;

/// From here on it is told that events pile up.
const MANY: Limit = Limit { events: 100_000, bytes: 1 << 30 };

/// What to do about it.
const ADVICE: &str = "schedule less often, or declare the action with a minimum spacing and the \
    policy \"drop\" or \"replace\"";

/// The events of a program that wait.
pub(crate) struct Backlog {
    waiting: Arc<Waiting>,
    limit: Limit,
    told: AtomicBool,
}

#[derive(Default)]
struct Waiting {
    events: AtomicUsize,
    bytes: AtomicUsize,
}

/// The most that may wait.
#[derive(Clone, Copy)]
struct Limit {
    events: usize,
    bytes: usize,
}

impl Limit {
    const NONE: Self = Self { events: usize::MAX, bytes: usize::MAX };

    fn is_exceeded(self, events: usize, bytes: usize) -> bool {
        events > self.events || bytes > self.bytes
    }
}

/// An event that waits, until this is dropped.
pub(crate) struct Share {
    waiting: Arc<Waiting>,
    bytes: usize,
}

impl Drop for Share {
    fn drop(&mut self) {
        self.waiting.events.fetch_sub(1, Ordering::Relaxed);
        self.waiting.bytes.fetch_sub(self.bytes, Ordering::Relaxed);
    }
}

impl Backlog {
    /// An empty one, with the limit that the environment names.
    ///
    /// # Errors
    ///
    /// If that is no limit.
    pub(crate) fn from_environment() -> Result<Self, Failure> {
        let limit = match EventLimit::from_environment()? {
            None => Limit::NONE,
            Some(EventLimit::Events(events)) => Limit { events, ..Limit::NONE },
            Some(EventLimit::Bytes(bytes)) => Limit { bytes, ..Limit::NONE },
        };
        Ok(Self { waiting: Arc::default(), limit, told: AtomicBool::new(false) })
    }

    /// Lets a thread schedule an event of an action.
    ///
    /// # Errors
    ///
    /// `queue.Full`, if too much waits already. One event may always wait.
    pub(crate) fn admit(&self, action: &str, value: &Bound<'_, PyAny>) -> PyResult<Share> {
        let len = len_of(value, true)?;
        let Waiting { events, bytes } = &*self.waiting;
        let before = events.fetch_add(1, Ordering::Relaxed);
        let held = bytes.fetch_add(len, Ordering::Relaxed);
        // From here on, its end takes it away again.
        let share = Share { waiting: Arc::clone(&self.waiting), bytes: len };
        let (count, total) = (before + 1, held.saturating_add(len));
        if before > 0 && self.limit.is_exceeded(count, total) {
            let full = value.py().import(intern!(value.py(), "queue"))?.getattr("Full")?;
            return Err(PyErr::from_value(full.call1((format!(
                "{action} cannot be scheduled: {before} events that threads have scheduled, with \
                 {held} bytes, wait for reactions, and {NAME} permits no more; {ADVICE}"
            ),))?));
        }
        if MANY.is_exceeded(count, total) && !self.told.swap(true, Ordering::Relaxed) {
            say(&format!(
                "warning: {count} events that threads have scheduled, with {total} bytes, wait for \
                 reactions, now of {action}; they come faster than they are dealt with, so memory will \
                 run out: {ADVICE}, or limit them with {NAME}"
            ));
        }
        Ok(share)
    }
}

/// How many bytes are in arrays, bytes and text, and in those of a container, if it is asked for.
fn len_of(value: &Bound<'_, PyAny>, within: bool) -> PyResult<usize> {
    if let Ok(bytes) = value.cast_exact::<PyBytes>() {
        Ok(bytes.as_bytes().len())
    } else if let Ok(bytes) = value.cast_exact::<PyByteArray>() {
        Ok(bytes.len())
    } else if let Ok(text) = value.cast_exact::<PyString>() {
        text.len()
    } else if let Some(len) = serialize::array::len_of(value)? {
        Ok(len)
    } else if !within {
        Ok(0)
    } else if let Ok(list) = value.cast_exact::<PyList>() {
        sum_of(list.iter())
    } else if let Ok(tuple) = value.cast_exact::<PyTuple>() {
        sum_of(tuple.iter())
    } else if let Ok(dict) = value.cast_exact::<PyDict>() {
        sum_of(dict.values().iter())
    } else {
        Ok(0)
    }
}

fn sum_of<'py>(mut members: impl Iterator<Item = Bound<'py, PyAny>>) -> PyResult<usize> {
    members.try_fold(0_usize, |sum, member| Ok(sum.saturating_add(len_of(&member, false)?)))
}
