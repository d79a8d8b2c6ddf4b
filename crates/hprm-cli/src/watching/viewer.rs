//! Showing values in a viewer: a Python process does that, because viewers have packages for Python.

use crate::args::{Echo, Listen};
use crate::message::Error;
use crate::python;
use crate::run::replace;

/// Becomes a Python process that shows values in Foxglove. Returns only if that fails.
pub(super) fn become_viewer(arguments: &Echo, listen: &Listen) -> Error {
    let python = match python::find(&arguments.interpreter) {
        Ok(python) => python,
        Err(error) => return error,
    };
    let mut command = python::module(&python, "view");
    command.args(["--host", &listen.host, "--port", &listen.port.to_string()]);
    if let Some(federation) = &arguments.of.federation {
        command.arg(format!("--of={federation}"));
    }
    if let Some(wait) = arguments.of.wait {
        command.args(["--wait", &wait.as_nanos().to_string()]);
    }
    command.arg("--").args(&arguments.ports);
    replace(command)
}
