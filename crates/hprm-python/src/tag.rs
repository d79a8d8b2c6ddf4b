//! The class `Tag`: a tag as programs see it, with absolute time.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use hprm_core::PhysicalTime;

/// A point in superdense time: a time, and a microstep within it. Tags are ordered, and may be keys of a dict.
#[pyclass(frozen, eq, ord, hash, module = "hprm")]
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) struct Tag {
    /// The time, in nanoseconds since the Unix epoch.
    #[pyo3(get)]
    time: i64,
    /// The place among the tags of that time, from zero.
    #[pyo3(get)]
    microstep: u32,
}

impl Tag {
    /// The tag of a program that started at `start`.
    pub(crate) fn of(tag: hprm_core::Tag, start: PhysicalTime) -> Self {
        Self { time: tag.due(start).0, microstep: tag.microstep }
    }

    /// Nanoseconds since the Unix epoch.
    pub(crate) fn time(self) -> i64 {
        self.time
    }
}

#[pymethods]
impl Tag {
    #[new]
    #[pyo3(signature = (time, microstep = 0))]
    fn new(time: i64, microstep: i64) -> PyResult<Self> {
        let microstep = u32::try_from(microstep).map_err(|_| {
            PyValueError::new_err(format!(
                "a microstep is a number from 0 to {}, and {microstep} is not",
                u32::MAX
            ))
        })?;
        Ok(Self { time, microstep })
    }

    fn __repr__(&self) -> String {
        format!("Tag(time={}, microstep={})", self.time, self.microstep)
    }

    fn __getnewargs__(&self) -> (i64, u32) {
        (self.time, self.microstep)
    }
}
