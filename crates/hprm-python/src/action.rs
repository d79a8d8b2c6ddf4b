//! The class `action_capsule_t`: an action, as an argument of a reaction or as an attribute of its reactor.

use std::ffi::CString;
use std::sync::Arc;

use hprm_core::ActionId;
use pyo3::exceptions::{PyAttributeError, PyRuntimeWarning, PyValueError};
use pyo3::prelude::*;

use crate::accepts::Accepts;
use crate::runtime::Runtime;
use crate::time::nanos;
use crate::users::{Access, Users};
use crate::value::Value;

/// An action: what schedules events, and has their values.
#[pyclass(frozen, name = "action_capsule_t", module = "hprm")]
pub(crate) struct Action {
    runtime: Arc<Runtime>,
    action: ActionId,
    /// The reactions that declare it; none of an argument.
    users: Option<Users<Access>>,
    /// The values that it accepts, if not all.
    accepts: Option<Accepts>,
}

impl Action {
    /// The action, for arguments of reactions.
    pub(crate) fn new(runtime: &Arc<Runtime>, action: ActionId) -> Self {
        Self { runtime: Arc::clone(runtime), action, users: None, accepts: None }
    }

    /// The action, as an attribute of its reactor.
    pub(crate) fn attribute(
        runtime: &Arc<Runtime>,
        action: ActionId,
        users: Users<Access>,
        accepts: Option<Accepts>,
    ) -> Self {
        Self { runtime: Arc::clone(runtime), action, users: Some(users), accepts }
    }

    /// None if it is absent, else the value of its event, if that has one.
    fn read(&self) -> PyResult<Option<Option<Value>>> {
        self.runtime.action(self.users.as_ref(), self.action)
    }

    fn name(&self) -> &str {
        &self.runtime.program().actions[self.action].name
    }

    /// The error of a reaction that reads the value of an attribute while there is none.
    fn absent(&self) -> PyErr {
        let (program, name) = (self.runtime.program(), self.name());
        let reader = self.runtime.running_reaction();
        let reader = reader.map_or_else(String::new, |reaction| program.reaction_label(reaction));
        PyValueError::new_err(format!(
            "action {name} is absent at this tag, so reaction {reader} cannot read its value: ask \
             {name}.is_present first, or read {name}.get(default)"
        ))
    }
}

#[pymethods]
impl Action {
    /// The value with which it was scheduled; None if it had none.
    ///
    /// While the action is absent, that is None in the body of an `.lf` file, where the action is an argument,
    /// and a `ValueError` in plain Python, where it is an attribute of `self`.
    #[getter]
    fn value<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        match self.read()? {
            None if self.users.is_some() => Err(self.absent()),
            event => event.flatten().map(|value| value.object(py)).transpose(),
        }
    }

    /// Returns the value with which it was scheduled, or the default while it is absent.
    #[pyo3(signature = (default = None))]
    fn get<'py>(
        &self,
        py: Python<'py>,
        default: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Option<Bound<'py, PyAny>>> {
        match self.read()? {
            None => Ok(default),
            Some(value) => value.map(|value| value.object(py)).transpose(),
        }
    }

    #[setter(value)]
    fn refuse_value(&self, _value: &Bound<'_, PyAny>) -> PyResult<()> {
        Err(PyAttributeError::new_err(format!(
            "the value of an action is that of its event: {}.schedule(offset, value)",
            self.name()
        )))
    }

    /// Whether it has an event at this tag.
    #[getter]
    fn is_present(&self) -> PyResult<bool> {
        Ok(self.read()?.is_some())
    }

    /// Schedules an event, `offset` and the minimum delay after the current tag; of a physical action, after
    /// what the clock shows, and from any thread. In a test in virtual time, only reactions schedule either.
    ///
    /// The offset is a whole number of nanoseconds, a text such as "10 ms", or a `timedelta`; zero if it is
    /// left out. Raises `queue.Full` if a thread schedules more than `HPRM_EVENT_LIMIT` allows.
    #[pyo3(signature = (offset = None, value = None))]
    fn schedule(
        &self,
        py: Python<'_>,
        offset: Option<&Bound<'_, PyAny>>,
        value: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let nanos = offset.map_or(Ok(0), nanos)?;
        if nanos < 0 {
            let name = self.name();
            let message = format!(
                "{name}.schedule({nanos}): the past cannot be changed, so this is {name}.schedule(0)"
            );
            // It names the line, once.
            let category = py.get_type::<PyRuntimeWarning>();
            PyErr::warn(py, &category, &CString::new(message)?, 1)?;
        }
        if let (Some(accepts), Some(value)) = (&self.accepts, value) {
            accepts.check(value, || {
                let setter = self.runtime.running_reaction();
                let setter = setter.map(|it| self.runtime.program().reaction_label(it));
                (format!("action {}", self.name()), setter)
            })?;
        }
        if self.runtime.is_outside_of_virtual_time(self.action) {
            let name = self.name();
            let message = format!(
                "an event of {name} is dropped: in a test in virtual time, only reactions and inputs={{\"{name}\": \
                 [...]}} schedule a physical action"
            );
            return PyErr::warn(py, &py.get_type::<PyRuntimeWarning>(), &CString::new(message)?, 1);
        }
        self.runtime.schedule(self.users.as_ref(), (self.action, nanos), value)
    }

    fn __repr__(&self) -> String {
        format!("<action {}>", self.name())
    }
}
