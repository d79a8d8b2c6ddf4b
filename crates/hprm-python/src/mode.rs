//! The class of a mode, as an argument of a reaction that may enter it.

use std::sync::Arc;

use hprm_core::{ModeId, ReactionId, Transition};
use pyo3::prelude::*;

use crate::runtime::Runtime;

/// A mode that a reaction may enter.
#[pyclass(frozen, name = "mode_capsule_t", module = "hprm")]
pub(crate) struct Mode {
    runtime: Arc<Runtime>,
    reaction: ReactionId,
    mode: ModeId,
    transition: Transition,
}

impl Mode {
    /// The mode, for arguments of `reaction`.
    pub(crate) fn new(
        runtime: &Arc<Runtime>,
        reaction: ReactionId,
        mode: ModeId,
        transition: Transition,
    ) -> Self {
        Self { runtime: Arc::clone(runtime), reaction, mode, transition }
    }
}

#[pymethods]
impl Mode {
    /// Enters the mode when this tag is done. The last call at a tag counts.
    fn set(&self) -> PyResult<()> {
        self.runtime.change_mode(self.reaction, self.mode, self.transition)
    }

    fn __repr__(&self) -> String {
        let name = &self.runtime.program().modes[self.mode].name;
        match self.transition {
            Transition::Reset => format!("<mode reset({name})>"),
            Transition::History => format!("<mode history({name})>"),
        }
    }
}
