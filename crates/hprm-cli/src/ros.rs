//! `hprm ros` and `hprm launch`: programs of rclpy, which Python runs.

use std::process::{Command, ExitCode};
use std::time::Duration;

use crate::args::{Launch, Ros, RosCommand, Running};
use crate::message::Error;
use crate::python;
use crate::run::replace;

/// Becomes the Python process that does it. Returns only if that fails.
///
/// # Errors
///
/// If there is no Python, or it cannot be started.
pub(crate) fn ros(arguments: &Ros) -> Result<ExitCode, Error> {
    let RosCommand::Run(run) = &arguments.command;
    let mut command = Command::new(python::find(&run.interpreter)?);
    command.args(["-m", "hprm.ros", "run"]);
    options(&mut command, &run.running);
    command.args(&run.scripts);
    Err(replace(command))
}

/// Becomes the Python process that starts the nodes of a launch file. Returns only if that fails.
///
/// # Errors
///
/// If there is no Python, or it cannot be started.
pub(crate) fn launch(arguments: &Launch) -> Result<ExitCode, Error> {
    let mut command = Command::new(python::find(&arguments.interpreter)?);
    command.args(["-m", "hprm.ros", "launch"]);
    options(&mut command, &arguments.running);
    if arguments.show_args {
        command.arg("--show-args");
    }
    if arguments.print_description {
        command.arg("--print-description");
    }
    command.arg("--").arg(&arguments.file).args(&arguments.arguments);
    Err(replace(command))
}

fn options(command: &mut Command, running: &Running) {
    if let Some(path) = &running.logical_trace {
        command.arg("--logical-trace").arg(path);
    }
    let start = running.start_time.iter().map(Duration::as_secs_f64);
    command.args(start.map(|it| format!("--start-time={it}")));
    let wanted = &running.bridging;
    command.args(wanted.zenoh.iter().map(|it| format!("--zenoh={it}")));
    command.args(wanted.domain_id.iter().map(|it| format!("--domain-id={it}")));
    command.args(wanted.zenoh_only.iter().map(|it| format!("--zenoh-only={it}")));
    let wait = wanted.zenoh_align_stamp.iter().map(Duration::as_secs_f64);
    command.args(wait.map(|it| format!("--zenoh-align-stamp={it}")));
    if running.fast == Some(true) {
        command.arg("--fast");
    }
}
