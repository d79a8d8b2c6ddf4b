//! Showing values in a viewer, or sending them over Zenoh: a Python process does that, because viewers and Zenoh have
//! packages for Python, and programs in Python do not compile them.

use std::process::Command;

use crate::args::{Echo, Listen, Mirror, Of};
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
    say_which(&mut command, &arguments.of);
    command.arg("--").args(&arguments.ports);
    replace(command)
}

/// Becomes a Python process that sends values over Zenoh. Returns only if that fails.
pub(crate) fn become_mirror(arguments: &Mirror) -> Error {
    let python = match python::find(&arguments.interpreter) {
        Ok(python) => python,
        Err(error) => return error,
    };
    let mut command = python::module(&python, "mirror");
    command.arg(format!("--as={}", arguments.form.name()));
    command.arg(format!("--zenoh={}", arguments.zenoh));
    let options = [
        ("key", &arguments.key),
        ("topic", &arguments.topic),
        ("type", &arguments.type_),
        ("domain-id", &arguments.domain_id),
    ];
    let stated = options.into_iter().filter_map(|(name, value)| Some((name, value.as_ref()?)));
    command.args(stated.map(|(name, value)| format!("--{name}={value}")));
    say_which(&mut command, &arguments.of);
    command.arg("--").arg(&arguments.port);
    replace(command)
}

/// Says which federation is meant.
fn say_which(command: &mut Command, of: &Of) {
    if let Some(federation) = &of.federation {
        command.arg(format!("--of={federation}"));
    }
    if let Some(wait) = of.wait {
        command.args(["--wait", &wait.as_nanos().to_string()]);
    }
}
