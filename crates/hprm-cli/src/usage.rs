//! Mistakes in the words of a command line: exit code 2, and a report as for any other failure if programs
//! read them (`--json`).
//!
//! What is wrong is clap's to say; [`variables`](crate::variables) names the variable if it stems from one.

use std::ffi::OsString;
use std::io::{ErrorKind, Write};
use std::process::ExitCode;

use clap::error::{ContextKind, ContextValue};
use hprm::{Kind, Report};
use serde_json::json;

use crate::message::{self, Error};
use crate::variables::Wrong;

/// What the command ends with if its words are wrong.
const WRONG: u8 = 2;

/// Shows what is wrong with the `words` of the command line or with the environment, or the help that they
/// ask for. Returns what the command ends with.
pub(crate) fn show(wrong: Wrong, words: &[OsString]) -> ExitCode {
    let wants_json = words.iter().take_while(|word| *word != "--").any(|word| word == "--json");
    let error = match wrong {
        Wrong::Words(error) if !error.use_stderr() || !wants_json => return print(&error),
        Wrong::Words(error) => Error::from(report(&error.to_string())),
        Wrong::Variable(error) => error.code(i32::from(WRONG)),
    };
    message::speak_json(wants_json);
    match words.get(1).and_then(|word| word.to_str()) {
        Some("verify" | "diff") if wants_json => {
            message::print_line(&json!({ "error": error.as_json() }).to_string());
        }
        _ => error.show(),
    }
    ExitCode::from(WRONG)
}

/// What clap says, with the usage, or the help.
fn print(error: &clap::Error) -> ExitCode {
    let printed = error.print().and_then(|()| std::io::stdout().flush());
    match printed {
        _ if error.use_stderr() => ExitCode::from(WRONG),
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            message::unwritable(&error).show();
            ExitCode::FAILURE
        }
        _ => ExitCode::SUCCESS,
    }
}

/// What clap says, without the usage that follows.
fn report(said: &str) -> Report {
    let said = said.strip_prefix("error: ").unwrap_or(said);
    let (message, rest) = said.split_once("\n\n").unwrap_or((said, ""));
    let message: Vec<_> = message.lines().map(str::trim).collect();
    let report =
        Report { code: i32::from(WRONG), ..Report::new(Kind::Option, message.join(" ").trim()) };
    let tips: Vec<_> = rest.lines().filter_map(|line| line.trim().strip_prefix("tip: ")).collect();
    if tips.is_empty() { report } else { report.hint(tips.join("; ")) }
}

/// Has an error name an option as it is in `words`: by its short name, if that is what was typed.
pub(crate) fn name_as_typed(error: &mut clap::Error, command: &clap::Command, words: &[OsString]) {
    let Some(ContextValue::String(named)) = error.get(ContextKind::InvalidArg) else { return };
    let (flag, value) = named.split_once(' ').unwrap_or((named, ""));
    let is = |word: &OsString, flag: &str| {
        word.to_str().is_some_and(|word| word == flag || word.starts_with(&format!("{flag}=")))
    };
    if words.iter().any(|word| is(word, flag)) {
        return;
    }
    let options = command.get_subcommands().flat_map(clap::Command::get_arguments);
    let mut options = options.filter(|option| option.get_long() == flag.strip_prefix("--"));
    if let Some(short) = options.find_map(clap::Arg::get_short) {
        let named = format!("-{short} {value}");
        error.insert(ContextKind::InvalidArg, ContextValue::String(named));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_has_what_is_wrong_and_the_tips() {
        let said = "error: unexpected argument '--fats' found\n\n  tip: a similar argument exists: '--fast'\n  \
                    tip: to pass it, use '-- --fats'\n\nUsage: hprm run <FILE.lf>\n\nFor more";
        let report = report(said);
        assert_eq!((report.kind, report.code), (Kind::Option, 2));
        assert_eq!(report.message, "unexpected argument '--fats' found");
        let hint = "a similar argument exists: '--fast'; to pass it, use '-- --fats'";
        assert_eq!(report.hint.as_deref(), Some(hint));
        let said = "error: invalid value 'x' for '--fast <true|false>'\n  [possible values: true, false]\n\nFor";
        let expected = "invalid value 'x' for '--fast <true|false>' [possible values: true, false]";
        assert_eq!(super::report(said).message, expected);
    }
}
