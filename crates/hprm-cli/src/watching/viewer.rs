//! Showing values in a viewer, or sending them over Zenoh: a Python process does that, because viewers and Zenoh have
//! packages for Python, and programs in Python do not compile them.

use std::process::Command;

use clap::ValueEnum;

use crate::args::{Echo, Interpreter, Listen, Mirror, Of};
use crate::message::Error;
use crate::python;
use crate::run::replace;

/// Becomes a Python process that shows values in Foxglove. Returns only if that fails.
pub(super) fn become_viewer(arguments: &Echo, listen: &Listen) -> Error {
    become_watcher("view", (&arguments.interpreter, &arguments.of), |command| {
        command.args(["--host", &listen.host, "--port", &listen.port.to_string()]);
        command.arg("--").args(&arguments.ports);
    })
}

/// Becomes a Python process that sends values over Zenoh. Returns only if that fails.
pub(crate) fn become_mirror(arguments: &Mirror) -> Error {
    become_watcher("mirror", (&arguments.interpreter, &arguments.of), |command| {
        if let Some(form) = arguments.form.to_possible_value() {
            command.arg(format!("--as={}", form.get_name()));
        }
        command.arg(format!("--zenoh={}", arguments.zenoh));
        let options = [
            ("key", &arguments.key),
            ("topic", &arguments.topic),
            ("type", &arguments.type_),
            ("domain-id", &arguments.domain_id),
        ];
        let stated = options.into_iter().filter_map(|(name, value)| Some((name, value.as_ref()?)));
        command.args(stated.map(|(name, value)| format!("--{name}={value}")));
        command.arg("--").arg(&arguments.port);
    })
}

/// Becomes a Python process that watches a federation. `say` adds the words that are its own, the ports last.
fn become_watcher(
    word: &str,
    (interpreter, of): (&Interpreter, &Of),
    say: impl FnOnce(&mut Command),
) -> Error {
    let python = match python::find(interpreter) {
        Ok(python) => python,
        Err(error) => return error,
    };
    let mut command = python::module(&python, word);
    if let Some(federation) = &of.federation {
        command.arg(format!("--of={federation}"));
    }
    if let Some(wait) = of.wait {
        command.args(["--wait", &wait.as_nanos().to_string()]);
    }
    say(&mut command);
    replace(command)
}
