//! The class of a mode, as an argument of a reaction that may enter it, or as an attribute of its reactor.

use std::sync::Arc;

use hprm_core::{ModeId, Transition};
use pyo3::prelude::*;

use crate::runtime::Runtime;
use crate::users::Users;

/// A mode that reactions may enter.
#[pyclass(frozen, name = "mode_capsule_t", module = "hprm")]
pub(crate) struct Mode {
    runtime: Arc<Runtime>,
    mode: ModeId,
    users: Users<Transition>,
}

impl Mode {
    /// The mode, which its users enter, each by the transition that it declares.
    pub(crate) fn new(runtime: &Arc<Runtime>, mode: ModeId, users: Users<Transition>) -> Self {
        Self { runtime: Arc::clone(runtime), mode, users }
    }
}

#[pymethods]
impl Mode {
    /// Enters the mode when this tag is done. The last call at a tag counts.
    fn enter(&self) -> PyResult<()> {
        self.runtime.change_mode(&self.users, self.mode)
    }

    /// The same, by the name that Lingua Franca gives it.
    fn set(&self) -> PyResult<()> {
        self.enter()
    }

    fn __repr__(&self) -> String {
        let name = &self.runtime.program().modes[self.mode].name;
        match self.users {
            Users::Argument(_, Transition::Reset) => format!("<mode reset({name})>"),
            Users::Argument(_, Transition::History) => format!("<mode history({name})>"),
            Users::Declared(_) => format!("<mode {name}>"),
        }
    }
}
