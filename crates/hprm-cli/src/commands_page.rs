//! The page of the handbook that has all commands, made of the same declaration as the help texts.
//!
//! It is committed, so that it can be read without a build; the test here fails while it differs.

use std::fmt::Write as _;
use std::path::Path;

use clap::{Arg, Command, CommandFactory};

use crate::args::Arguments;

const HEADER: &str = "\
# Commands

<!-- Made of the declaration of the commands: UPDATE=1 cargo test -p hprm-cli commands_page -->

This page has every command and every option of `hprm`, as `hprm COMMAND --help` shows them, with defaults and environment variables.
How parameters, properties and arguments of a program are given is under [the command line](command-line.md); the
variables that are no options, and the exit codes, are under [environment](environment.md).
";

fn page() -> String {
    let mut root = Arguments::command();
    root.build();
    let commands: Vec<_> = root.get_subcommands().filter(|it| is_shown(it)).collect();
    let mut page = HEADER.to_owned();
    page.push_str("\n| command | what it does |\n|---|---|\n");
    for command in &commands {
        let (name, about) = (command.get_name(), command.get_about().unwrap_or_default());
        let _ = writeln!(page, "| [`hprm {name}`](#hprm-{name}) | {} |", cell(&about.to_string()));
    }
    for command in commands {
        section(&mut page, command, command.get_name());
        for inner in command.get_subcommands().filter(|it| is_shown(it)) {
            let name = format!("{} {}", command.get_name(), inner.get_name());
            section(&mut page, inner, &name);
        }
    }
    page
}

fn is_shown(command: &Command) -> bool {
    !command.is_hide_set() && command.get_name() != "help"
}

fn section(page: &mut String, command: &Command, name: &str) {
    let about = command.get_long_about().or(command.get_about()).unwrap_or_default();
    let about: Vec<_> = about.to_string().split("\n\n").map(words).collect();
    let usage = command.clone().render_usage().to_string();
    let usage = usage.trim_start_matches("Usage: ").trim();
    let _ = write!(page, "\n## hprm {name}\n\n{}\n", about.join("\n\n"));
    let _ = match usage.contains('\n') {
        true => write!(page, "\n```\n{usage}\n```\n"),
        false => write!(page, "\n`{usage}`\n"),
    };
    let arguments: Vec<_> =
        command.get_arguments().filter(|it| !it.is_hide_set() && it.get_id() != "help").collect();
    let (positional, options): (Vec<_>, Vec<_>) =
        arguments.into_iter().partition(|it| it.is_positional());
    // One table for both keeps the page short.
    let what = match (positional.is_empty(), options.is_empty()) {
        (false, false) => "argument, option",
        (false, true) => "argument",
        _ => "option",
    };
    table(page, what, &[positional, options].concat());
    if let Some(examples) = command.get_after_help() {
        let _ = write!(page, "\n```\n{}\n```\n", examples.to_string().trim());
    }
}

fn table(page: &mut String, what: &str, arguments: &[&Arg]) {
    if arguments.is_empty() {
        return;
    }
    let _ = write!(page, "\n| {what} | meaning | default | variable |\n|---|---|---|---|\n");
    for argument in arguments {
        let help = argument.get_long_help().or(argument.get_help()).unwrap_or_default();
        // Of a flag, clap has a default, too.
        let stated = argument.get_action().takes_values();
        let defaults: Vec<_> = argument
            .get_default_values()
            .iter()
            .filter(|_| stated)
            .map(|it| it.to_string_lossy())
            .collect();
        let variable = argument.get_env().map(|it| it.to_string_lossy()).unwrap_or_default();
        let values = possible(argument);
        let _ = writeln!(
            page,
            "| {} | {}{values} | {} | {} |",
            spellings(argument),
            cell(&help.to_string()),
            code(&defaults.join(" ")),
            code(&variable)
        );
    }
}

/// All ways to write an option, or what a positional argument is called.
fn spellings(argument: &Arg) -> String {
    let value: Vec<_> =
        argument.get_value_names().unwrap_or_default().iter().map(|it| &**it).collect();
    let takes_value = argument.get_action().takes_values();
    let value = if takes_value { value.join(" ") } else { String::new() };
    if argument.is_positional() {
        return code(&value);
    }
    let optional = argument.get_num_args().is_some_and(|range| range.min_values() == 0);
    let with = |name: String, gap: &str| match (value.as_str(), optional && takes_value) {
        ("", _) => code(&name),
        (value, true) => code(&format!("{name}[={value}]")),
        (value, false) => code(&format!("{name}{gap}{value}")),
    };
    let short = argument.get_short().map(|it| with(format!("-{it}"), " "));
    let long = argument.get_long().map(|it| with(format!("--{it}"), " "));
    let aliases = argument.get_visible_aliases().unwrap_or_default();
    let aliases = aliases.into_iter().map(|it| with(format!("--{it}"), " "));
    let all: Vec<_> = short.into_iter().chain(long).chain(aliases).collect();
    all.join(", ")
}

/// The words that an option takes, if there are only some and they are not among its value's name.
fn possible(argument: &Arg) -> String {
    if argument.is_hide_possible_values_set() || !argument.get_action().takes_values() {
        return String::new();
    }
    let values: Vec<_> = argument.get_possible_values();
    let values: Vec<_> = values.iter().map(|it| code(it.get_name())).collect();
    if values.is_empty() { String::new() } else { format!(" One of {}.", values.join(", ")) }
}

fn code(text: &str) -> String {
    if text.is_empty() { String::new() } else { format!("`{}`", text.replace('|', "\\|")) }
}

/// A text for a cell of a table: one line, a sentence.
fn cell(text: &str) -> String {
    let text = words(text).replace('|', "\\|");
    if text.ends_with('.') || text.is_empty() { text } else { format!("{text}.") }
}

/// A text in one line, with what is typed as code.
fn words(text: &str) -> String {
    let shown = |word: &str| {
        let end = word.trim_end_matches([',', '.', ';', ':']).len();
        let (bare, rest) = word.split_at(end);
        let typed = bare.starts_with("--")
            || bare.contains("()")
            || bare.contains('=')
            || bare.contains('<');
        if typed && !bare.contains('`') { format!("`{bare}`{rest}") } else { word.to_owned() }
    };
    let all: Vec<_> = text.split_whitespace().map(shown).collect();
    // What is typed one after the other is one piece of code.
    all.join(" ").replace("` `", " ")
}

#[test]
fn the_page_is_that_of_the_command() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/reference/commands.md");
    let page = page();
    if std::env::var_os("UPDATE").is_some() {
        std::fs::write(&path, &page).unwrap();
    }
    let committed = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(
        committed == page,
        "docs/reference/commands.md is not that of the command: UPDATE=1 cargo test -p hprm-cli commands_page"
    );
}
