//! Environment variables that stand for options: an empty one is as good as none, and an error
//! about a wrong one has its name, not that of an option that was not given.

use std::env;
use std::error::Error as _;
use std::ffi::{OsStr, OsString};

use clap::builder::Resettable;
use clap::error::{ContextKind, ContextValue};
use clap::{Arg, Command, CommandFactory, FromArgMatches};

use crate::args::{Arguments, Command as Chosen, join_times};
use crate::message::Error;
use crate::{parameters, usage};

/// What keeps the command from being obeyed.
pub(crate) enum Wrong {
    /// Its words, or a wish for help.
    Words(clap::Error),
    /// An environment variable.
    Variable(Error),
}

/// Checks the variables that are no options, before anything starts, and opens the log that one of them asks for.
///
/// # Errors
///
/// What is wrong with one of them.
pub(crate) fn obey(chosen: &Chosen) -> Result<(), Wrong> {
    let checked = hprm::log_to_stderr(false).and_then(|()| match chosen {
        Chosen::Run(_) | Chosen::Federate(_) | Chosen::Verify(_) => hprm::check_variables(),
        _ => Ok(()),
    });
    checked.map_err(|failure| Wrong::Variable(Error::from(&failure)))
}

/// What was typed, which are the `words`, and what the environment says.
///
/// # Errors
///
/// What is wrong with it, or the help that was asked for.
pub(crate) fn parse(words: &[OsString]) -> Result<Arguments, Wrong> {
    let command = Arguments::command()
        .mut_subcommands(|subcommand| subcommand.mut_args(without_an_empty_variable));
    let words = join_times(words, |_| false);
    let parsed = command.clone().try_get_matches_from(&words);
    let arguments = parsed.and_then(|matches| Arguments::from_arg_matches(&matches));
    let arguments = match arguments {
        Err(error) => parameters::parse(&command, &words).unwrap_or(Err(error)),
        arguments => arguments,
    };
    arguments.map_err(|mut error| match blamed(&command, &error) {
        Some(message) => Wrong::Variable(Error::option(message)),
        None => {
            usage::name_as_typed(&mut error, &command, &words);
            Wrong::Words(error)
        }
    })
}

fn without_an_empty_variable(arg: Arg) -> Arg {
    match value_of(&arg).is_some_and(|value| value.is_empty()) {
        true => arg.env(Resettable::Reset),
        false => arg,
    }
}

fn value_of(arg: &Arg) -> Option<OsString> {
    env::var_os(arg.get_env()?)
}

/// What to say of an error about the value of an option, if that stems from a variable.
fn blamed(command: &Command, error: &clap::Error) -> Option<String> {
    let told = |kind| match error.get(kind) {
        Some(ContextValue::String(text)) => Some(text.as_str()),
        _ => None,
    };
    let (option, value) = (told(ContextKind::InvalidArg)?, told(ContextKind::InvalidValue)?);
    let mut args = command.get_subcommands().flat_map(Command::get_arguments);
    let flag = option.strip_prefix("--")?.split([' ', '=']).next();
    let arg = args.find(|arg| arg.get_long() == flag && arg.get_env().is_some())?;
    // What is typed overrides the environment.
    if is_typed(arg) || value_of(arg)? != OsStr::new(value) {
        return None;
    }
    let name = arg.get_env()?.to_string_lossy();
    let value = if arg.is_hide_env_values_set() { String::new() } else { format!("={value}") };
    let reason = error.source().map(|source| format!(": {source}")).unwrap_or_default();
    Some(format!("the environment variable {name}{value} is wrong{reason}"))
}

/// Whether an option is among the words of the command line.
fn is_typed(arg: &Arg) -> bool {
    let long = arg.get_long().map(|long| format!("--{long}"));
    let short = arg.get_short().map(|short| format!("-{short}"));
    env::args_os().any(|word| {
        let word = word.to_string_lossy();
        let is_long = long.as_deref() == word.split('=').next();
        is_long || short.as_ref().is_some_and(|short| word.starts_with(short.as_str()))
    })
}
