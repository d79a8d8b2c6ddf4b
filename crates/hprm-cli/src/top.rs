//! `hprm top`: what a running federation does, and why each of its federates waits.
//!
//! It reads boards (`hprm::board`), so no process of the federation knows that it is watched. `collect` reads them,
//! `why` explains, `text`, `json` and `screen` show.

mod collect;
mod federation;
mod json;
mod rates;
#[cfg(feature = "screen")]
mod screen;
mod text;
mod why;
mod words;

use std::io::{self, IsTerminal};
use std::process::ExitCode;
use std::thread;

use self::collect::Boards;
use self::federation::Federation;
pub(crate) use self::words::{are_sized, bytes};
use crate::args::Top;
use crate::message::{self, Error, print_line};

/// Shows a federation.
///
/// # Errors
///
/// If there is no such federation, or no such federate in it.
pub(crate) fn top(wanted: &Top) -> Result<ExitCode, Error> {
    message::or_json(wanted.json, show(wanted))
}

fn show(wanted: &Top) -> Result<ExitCode, Error> {
    let boards = Boards::find(wanted.federation.as_deref())?;
    let before = boards.read();
    let only = number_of(&before, wanted.federate.as_deref())?;
    let is_terminal = io::stdout().is_terminal() && io::stdin().is_terminal();
    if is_terminal && !wanted.once && !wanted.json {
        return screen(boards, only, wanted);
    }
    thread::sleep(wanted.interval);
    // Processes may have joined or ended; the boards of those that have ended are still there.
    let now = boards.again().unwrap_or(boards).read();
    match wanted.json {
        true => print_line(&json::object(Some(&before), &now, only).to_string()),
        false => text::lines(Some(&before), &now, only).iter().for_each(|line| print_line(line)),
    }
    Ok(ExitCode::SUCCESS)
}

/// Shows a federation on the screen.
#[cfg(feature = "screen")]
fn screen(boards: Boards, only: Option<usize>, wanted: &Top) -> Result<ExitCode, Error> {
    screen::screen(boards, only, wanted.interval).map(|()| ExitCode::SUCCESS)
}

/// Says how to get a command that has a screen.
#[cfg(not(feature = "screen"))]
fn screen(_: Boards, _: Option<usize>, _: &Top) -> Result<ExitCode, Error> {
    Err(Error::new("this build of the command has no screen").hint(
        "--once prints the state; in a clone of HPRM: make build, pip install ., or cargo install --path \
         crates/hprm-cli --features screen",
    ))
}

/// The number of a federate, if one is named.
fn number_of(federation: &Federation, name: Option<&str>) -> Result<Option<usize>, Error> {
    let Some(name) = name else { return Ok(None) };
    let names: Vec<_> = federation.members.iter().map(|member| member.name.as_str()).collect();
    match names.iter().position(|it| *it == name) {
        Some(number) => Ok(Some(number)),
        None => Err(Error::new(format!("{} has no federate {name}", federation.name))
            .hint(format!("its federates are {}", names.join(", ")))),
    }
}
