//! `hprm bag`: a Python process does it, because the library for bags is one of Python.

use std::process::{Command, ExitCode};

use clap::ValueEnum;

use crate::args::{Bag, BagCommand, Interpreter, Play, Record, Storage};
use crate::message::Error;
use crate::python;
use crate::run::replace;

/// Becomes the Python process that does it.
///
/// # Errors
///
/// If there is no interpreter with HPRM, or it cannot be started.
pub(crate) fn bag(wanted: &Bag) -> Result<ExitCode, Error> {
    let mut command;
    match &wanted.command {
        BagCommand::Info(info) => {
            command = process(&info.interpreter, "info")?;
            command.args(info.json.then_some("--json")).arg("--").args(&info.bags);
        }
        BagCommand::Convert(convert) => {
            command = process(&convert.interpreter, "convert")?;
            storage(&mut command, convert.storage);
            command.arg("--").arg(&convert.source).arg(&convert.destination);
        }
        BagCommand::Play(play) => command = player(play)?,
        BagCommand::Record(record) => command = recorder(record)?,
    }
    Err(replace(command))
}

fn process(interpreter: &Interpreter, name: &str) -> Result<Command, Error> {
    let mut command = python::module(&python::find(interpreter)?, "bag");
    command.arg(name);
    Ok(command)
}

/// A program that runs together with scripts; its words are what the user typed.
fn program(interpreter: &Interpreter, name: &str) -> Result<Command, Error> {
    let mut command = Command::new(python::find(interpreter)?);
    command.args(["-m", "hprm.ros._bags", name]);
    Ok(command)
}

fn player(play: &Play) -> Result<Command, Error> {
    let mut command = program(&play.interpreter, "play")?;
    let numbers = [("--rate", play.rate), ("--start-offset", play.start_offset)];
    for (option, number) in numbers {
        command.args(number.map(|it| format!("{option}={it}")));
    }
    command.args(play.is_loop.then_some("--loop"));
    command.args(play.topic.iter().map(|it| format!("--topic={it}")));
    command.args(play.remap.iter().map(|it| format!("--remap={it}")));
    command.arg("--").arg(&play.bag).args(&play.scripts);
    Ok(command)
}

fn recorder(record: &Record) -> Result<Command, Error> {
    let mut command = program(&record.interpreter, "record")?;
    if let Some(bag) = &record.output {
        command.arg("--output").arg(bag);
    }
    storage(&mut command, record.storage);
    command.args(record.wait.then_some("--wait")).arg("--").args(&record.words);
    Ok(command)
}

fn storage(command: &mut Command, wanted: Option<Storage>) {
    if let Some(format) = wanted.and_then(|it| it.to_possible_value()) {
        command.args(["--storage", format.get_name()]);
    }
}
