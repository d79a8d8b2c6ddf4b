//! `hprm trace`: what a trace of a run says, without a browser.

mod read;
mod statistics;
mod table;

use std::process::ExitCode;

use crate::args::{Summary, Trace, TraceCommand};
use crate::message::{self, Error, print_line};

/// Looks into a trace.
///
/// # Errors
///
/// If it is none.
pub(crate) fn trace(arguments: &Trace) -> Result<ExitCode, Error> {
    let TraceCommand::Summary(arguments) = &arguments.command;
    message::or_json(arguments.json, summary(arguments))
}

fn summary(arguments: &Summary) -> Result<ExitCode, Error> {
    let read = read::read(&arguments.file)?;
    let statistics = statistics::Statistics::of(&read);
    if arguments.json {
        print_line(&statistics.as_json().to_string());
    } else {
        table::show(&statistics);
    }
    Ok(ExitCode::SUCCESS)
}
