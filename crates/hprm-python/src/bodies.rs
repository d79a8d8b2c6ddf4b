//! The Python functions of a reaction, and the arguments of their calls.

use hprm_core::Body;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

/// The Python functions of a reaction, and their arguments.
pub(crate) struct Bodies {
    pub(crate) main: Py<PyAny>,
    pub(crate) deadline: Option<Py<PyAny>>,
    /// None if it declares no handler, or one without a body: then the main body runs.
    pub(crate) tardy: Option<Py<PyAny>>,
    pub(crate) arguments: Arguments,
}

/// The arguments of the functions of a reaction.
pub(crate) struct Arguments {
    /// The reactor, then the arguments that the program declares.
    pub(crate) all: Py<PyTuple>,
    /// Positions of mutable inputs, of which each call gets a copy.
    pub(crate) mutable: Vec<usize>,
}

impl Bodies {
    /// Calls the function for a body of the reaction. In a program in plain Python (`is_bound`) it must return nothing.
    ///
    /// # Errors
    ///
    /// If Python raises one, or the body returns a value.
    pub(crate) fn call(&self, py: Python<'_>, body: Body, is_bound: bool) -> PyResult<()> {
        let function = match body {
            Body::Main => &self.main,
            Body::Deadline => self.deadline.as_ref().unwrap_or(&self.main),
            Body::Tardy => self.tardy.as_ref().unwrap_or(&self.main),
        };
        let returned = function.bind(py).call1(self.arguments.fresh(py)?)?;
        if is_bound && !returned.is_none() {
            let slips = py.import("hprm._slips")?;
            slips.call_method1("refuse_returned", (function, returned))?;
        }
        Ok(())
    }
}

impl Arguments {
    /// The arguments for one call, while the reaction runs.
    ///
    /// # Errors
    ///
    /// If a mutable input cannot be copied.
    pub(crate) fn fresh<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let all = self.all.bind(py);
        if self.mutable.is_empty() {
            return Ok(all.clone());
        }
        let arguments = all.to_list();
        let copy = py.import("hprm._ports")?.getattr("mutable")?;
        for at in &self.mutable {
            arguments.set_item(*at, copy.call1((arguments.get_item(*at)?,))?)?;
        }
        Ok(arguments.to_tuple())
    }

    pub(crate) fn clone_ref(&self, py: Python<'_>) -> Self {
        Self { all: self.all.clone_ref(py), mutable: self.mutable.clone() }
    }
}
