//! Turning what Python raised into the end of a program.

use hprm::Failure;
use hprm_core::NoMemory;
use pyo3::exceptions::PyMemoryError;
use pyo3::prelude::*;

/// The failure that `error` means, where `what` was going on: `reaction Main.a.1`.
///
/// `sys.exit` is a choice and has nothing to say; Ctrl-C neither.
pub(crate) fn failure(py: Python<'_>, error: PyErr, what: &str) -> Failure {
    failure_at(py, error, what, "")
}

/// The exception that says so.
pub(crate) fn no_memory(error: NoMemory) -> PyErr {
    PyMemoryError::new_err(error.to_string())
}

/// As [`failure`], about the `place` of the program `what` stems from, if the error names no other.
pub(crate) fn failure_at(py: Python<'_>, error: PyErr, what: &str, place: &str) -> Failure {
    let error = error.into_value(py).into_bound(py);
    let described = py
        .import("hprm._errors")
        .and_then(|errors| errors.call_method1("describe", (&error, what, place)))
        .and_then(|described| described.extract::<(i32, String)>());
    match described {
        Ok((code, message)) => Failure { message, code },
        Err(second) => Failure::new(format!("error: {what} raised {error}; and then {second}")),
    }
}
