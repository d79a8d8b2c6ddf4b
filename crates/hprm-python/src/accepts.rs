//! The types that a port or an action accepts, if the program declares them.

use pyo3::exceptions::PyTypeError;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

/// What `isinstance` is asked: a type, or a tuple of types.
pub(crate) struct Accepts(Py<PyAny>);

impl Accepts {
    /// Those that a declaration names.
    pub(crate) fn new(types: &Bound<'_, PyAny>) -> Self {
        Self(types.clone().unbind())
    }

    /// The same ones.
    pub(crate) fn clone_ref(&self, py: Python<'_>) -> Self {
        Self(self.0.clone_ref(py))
    }

    /// Whether it is an instance of them.
    ///
    /// # Errors
    ///
    /// `TypeError`, if it is not; `place` says what is set, and by which reaction, if one runs.
    pub(crate) fn check(
        &self,
        value: &Bound<'_, PyAny>,
        place: impl FnOnce() -> (String, Option<String>),
    ) -> PyResult<()> {
        let py = value.py();
        if value.is_instance(self.0.bind(py))? {
            return Ok(());
        }
        let (given, accepted) = (name_of(value.get_type().as_any()), self.names(py));
        let (what, reaction) = place();
        let giver = match reaction {
            Some(name) => format!("reaction {name} gives it"),
            None => "this is".to_owned(),
        };
        Err(PyTypeError::new_err(format!(
            "{what} accepts {accepted}, and {giver} a value of type {given}"
        )))
    }

    fn names(&self, py: Python<'_>) -> String {
        let types = self.0.bind(py);
        match types.cast::<PyTuple>() {
            Ok(types) => types.iter().map(|it| name_of(&it)).collect::<Vec<_>>().join(" or "),
            Err(_) => name_of(types),
        }
    }
}

/// The name of a type as a program writes it, with its module unless that is known to all.
fn name_of(it: &Bound<'_, PyAny>) -> String {
    let py = it.py();
    let attribute = |name| it.getattr(name).and_then(|found| found.extract::<String>()).ok();
    match (attribute(intern!(py, "__module__")), attribute(intern!(py, "__qualname__"))) {
        (Some(module), Some(name)) if !["builtins", "__main__"].contains(&module.as_str()) => {
            format!("{module}.{name}")
        }
        (_, Some(name)) => name,
        (_, None) => it.to_string(),
    }
}
