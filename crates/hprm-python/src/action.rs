//! The class `action_capsule_t`: an action, as an argument of a reaction.

use std::ffi::CString;
use std::sync::Arc;

use hprm_core::ActionId;
use pyo3::exceptions::{
    PyAttributeError, PyOverflowError, PyRuntimeWarning, PyTypeError, PyValueError,
};
use pyo3::prelude::*;
use pyo3::types::PyFloat;

use crate::runtime::Runtime;

/// An action.
#[pyclass(frozen, name = "action_capsule_t", module = "hprm")]
pub(crate) struct Action {
    runtime: Arc<Runtime>,
    action: ActionId,
}

impl Action {
    /// The action, for arguments of reactions.
    pub(crate) fn new(runtime: &Arc<Runtime>, action: ActionId) -> Self {
        Self { runtime: Arc::clone(runtime), action }
    }
}

#[pymethods]
impl Action {
    /// The value with which it was scheduled; None if it had none or is absent.
    #[getter]
    fn value<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let value = self.runtime.action(self.action)?.flatten();
        value.map(|value| value.object(py)).transpose()
    }

    #[setter(value)]
    fn refuse_value(&self, _value: &Bound<'_, PyAny>) -> PyResult<()> {
        Err(PyAttributeError::new_err(format!(
            "the value of an action is that of its event: {}.schedule(offset, value)",
            self.runtime.program().actions[self.action].name
        )))
    }

    /// Whether it has an event at this tag.
    #[getter]
    fn is_present(&self) -> PyResult<bool> {
        Ok(self.runtime.action(self.action)?.is_some())
    }

    /// Schedules it `offset` nanoseconds from now, and its minimum delay.
    #[pyo3(signature = (offset = None, value = None))]
    fn schedule(
        &self,
        offset: Option<&Bound<'_, PyAny>>,
        value: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let nanos = offset.map_or(Ok(0), nanos)?;
        if let Some(offset) = offset.filter(|_| nanos < 0) {
            let name = &self.runtime.program().actions[self.action].name;
            let message = format!(
                "{name}.schedule({nanos}): the past cannot be changed, so this is {name}.schedule(0)"
            );
            // It names the line, once.
            let category = offset.py().get_type::<PyRuntimeWarning>();
            PyErr::warn(offset.py(), &category, &CString::new(message)?, 1)?;
        }
        self.runtime.schedule(self.action, nanos, value)
    }

    fn __repr__(&self) -> String {
        format!("<action {}>", self.runtime.program().actions[self.action].name)
    }
}

/// The name of an object's type, for messages.
pub(crate) fn kind(object: &Bound<'_, PyAny>) -> String {
    object.get_type().name().map_or_else(|_| "thing".to_owned(), |name| name.to_string())
}

/// A number of nanoseconds; `MSEC(1.5)` is a float.
pub(crate) fn nanos(offset: &Bound<'_, PyAny>) -> PyResult<i64> {
    let Ok(number) = offset.cast::<PyFloat>() else {
        return offset.extract().map_err(|error: PyErr| {
            if error.is_instance_of::<PyTypeError>(offset.py()) {
                let kind = kind(offset);
                PyTypeError::new_err(format!(
                    "a time must be a number of nanoseconds, such as MSEC(10), and this is a {kind}"
                ))
            } else if error.is_instance_of::<PyOverflowError>(offset.py()) {
                PyOverflowError::new_err(format!(
                    "a time has at most {} nanoseconds, which is 292 years, and this is {offset}",
                    i64::MAX
                ))
            } else {
                error
            }
        });
    };
    let number = number.value();
    if number != 0.0 && number.abs() < 1.0 {
        return Err(PyValueError::new_err(format!(
            "a time is a number of nanoseconds, and {number} is less than one: SEC({number}) is in seconds"
        )));
    }
    // Of the floats beyond, none is a number of 64 bits; the cast of one within is exact enough.
    if number.abs() < i64::MAX as f64 {
        Ok(number as i64)
    } else {
        Err(PyValueError::new_err(format!("{number} is no number of nanoseconds")))
    }
}
