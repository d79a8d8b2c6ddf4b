//! A part of a value that only pickle can carry, and where it is: for the error, if the sender may not pickle.
//!
//! The encoder makes one only for a value that needs pickle.

use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;

use super::trust::Trust;

/// The most steps that are shown.
const STEPS: usize = 12;

/// A part of a value that only pickle can carry.
pub(super) struct PickleOnly {
    what: String,
    /// From the inside outwards.
    path: Vec<String>,
}

impl PickleOnly {
    /// A value whose class is not known.
    pub(super) fn class_of(value: &Bound<'_, PyAny>) -> Self {
        Self::of(format!("of the type {}", class_name(value)))
    }

    /// A value that is within itself.
    pub(super) fn cycle(value: &Bound<'_, PyAny>) -> Self {
        Self::of(format!("a {} that is around it", class_name(value)))
    }

    /// A value below too many others.
    pub(super) fn deep(value: &Bound<'_, PyAny>) -> Self {
        Self::of(format!("a {} inside of too many others", class_name(value)))
    }

    fn of(what: String) -> Self {
        Self { what, path: Vec::new() }
    }

    /// The same, as seen from the container, in which it is at `place`.
    pub(super) fn within(&mut self, place: String) {
        self.path.push(place);
    }

    /// Adds where the part is to the error of a pickle that has failed.
    pub(super) fn explain(&self, py: Python<'_>, error: &PyErr) {
        let text =
            format!("the first part that needs a pickle is `{}`, {}", self.path(), self.what);
        let hints = py.import("hprm._hints");
        // Without it, the error itself is told nevertheless.
        let _ = hints.and_then(|hints| hints.call_method1("add", (error.value(py), text)));
    }

    /// Where it is, as Python would write it.
    fn path(&self) -> String {
        let mut path = "value".to_owned();
        for (at, step) in self.path.iter().rev().enumerate() {
            match at {
                STEPS => path.push_str("..."),
                _ if at > STEPS => {}
                _ => path.push_str(step),
            }
        }
        path
    }

    /// The error of a sender that may not pickle.
    pub(super) fn refused(&self, trust: Trust) -> PyErr {
        PyTypeError::new_err(format!(
            "`{}` is {}, which only pickle can carry, and {}; send what needs no pickle, such as \
             dicts, lists, arrays and dataclasses (handbook page concepts/serialization), or {}",
            self.path(),
            self.what,
            trust.reason(),
            trust.remedy()
        ))
    }
}

fn class_name(value: &Bound<'_, PyAny>) -> String {
    value.get_type().fully_qualified_name().map_or_else(|_| "?".to_owned(), |name| name.to_string())
}
