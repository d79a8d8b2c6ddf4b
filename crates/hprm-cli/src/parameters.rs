//! Options that a program has of its own: the parameters of its main reactor, by their names.
//!
//! Only the program tells which they are, so an `.lf` file is compiled when the words of a command line do
//! not suffice without it: because of an unknown option, or to show all options there are. A program in Python
//! is not loaded because of an unknown option: each one is a parameter of it, and it says itself if there is no
//! such one.

use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};

use clap::{Arg, ArgMatches, Command, FromArgMatches};
use hprm_declared::Declaration;
use hprm_model::{ParameterDecl, Value};

use crate::args::{self, Arguments, Interpreter};
use crate::declare;
use crate::source::{Outcome, Program};

/// The heading of these options in the help.
const HEADING: &str = "Parameters of the program";

/// Reads a command line that names a program, whose parameters it may set. None if it names none that
/// can be compiled: what is wrong without it counts then.
pub(crate) fn parse(
    command: &Command,
    words: &[OsString],
) -> Option<Result<Arguments, clap::Error>> {
    let name = words.get(1)?.to_str()?;
    let subcommand = command.find_subcommand(name)?;
    if !takes_a_program(subcommand) {
        return None;
    }
    let before_rest = words.iter().take_while(|word| *word != "--");
    let file = before_rest.skip(2).find(|word| is_program(word))?;
    if declare::is_python(Path::new(file)) {
        let mut options = words.iter().take_while(|word| *word != "--");
        if options.any(|word| word == "--help" || word == "-h") {
            let known = of_python(Path::new(file), words)?;
            let known = known.iter().filter(|(parameter, _)| !is_option(subcommand, parameter));
            let command = command.clone().mut_subcommand(name, |subcommand| {
                subcommand.args(known.map(|(name, value)| shown(name, "VALUE", Some(value))))
            });
            let parsed = command.try_get_matches_from(words);
            return Some(parsed.and_then(|matches| Arguments::from_arg_matches(&matches)));
        }
        let words = as_properties(subcommand, words)?;
        let parsed = command.clone().try_get_matches_from(words);
        return Some(parsed.and_then(|matches| Arguments::from_arg_matches(&matches)));
    }
    let (interpreter, path) = (Interpreter::default(), Path::new(file));
    let (properties, arguments) = (Vec::new(), Vec::new());
    let program = Program { path, properties, arguments, interpreter: &interpreter };
    let Outcome::Right(compiled) = program.compile().ok()? else { return None };
    let known: Vec<_> = compiled
        .main_parameters()
        .iter()
        .filter(|parameter| !is_option(subcommand, &parameter.name))
        .collect();
    let command = command.clone().mut_subcommand(name, |subcommand| {
        subcommand.args(known.iter().map(|parameter| option(parameter)))
    });
    let joined = join_times(words, &known);
    Some(command.try_get_matches_from(joined).and_then(|matches| {
        let mut arguments = Arguments::from_arg_matches(&matches)?;
        let stated = matches.subcommand().map(|(_, matches)| stated(matches, &known));
        for (name, value) in stated.into_iter().flatten() {
            arguments.set_parameter(&name, &value);
        }
        Ok(arguments)
    }))
}

/// The parameters of a program in Python, with their values if nothing is stated. If its Python fails, the
/// interpreter has said so.
fn of_python(path: &Path, words: &[OsString]) -> Option<Vec<(String, String)>> {
    let stated = words.iter().enumerate().find_map(|(at, word)| {
        match word.to_str()?.strip_prefix("--python")? {
            "" => words.get(at + 1).map(PathBuf::from),
            path => path.strip_prefix('=').map(PathBuf::from),
        }
    });
    let inherited = || std::env::var_os(args::PYTHON).filter(|path| !path.is_empty());
    let interpreter = Interpreter { python: stated.or_else(|| inherited().map(PathBuf::from)) };
    let text = declare::declare(path, &[], [], &interpreter).ok()?.ok()?;
    Some(Declaration::read(&text).ok()?.parameters())
}

/// Whether a command runs a program, and so has target properties and arguments of the program.
fn takes_a_program(subcommand: &Command) -> bool {
    subcommand.get_arguments().any(|arg| arg.get_long() == Some(args::PROPERTY))
}

fn is_program(word: &OsStr) -> bool {
    let path = declare::file_of(Path::new(word));
    path.extension().is_some_and(|extension| extension == "lf" || extension == "py")
        && path.is_file()
}

/// The words with `--property main.NAME=VALUE` in the place of each option with a value that the command does
/// not know; none if all are known.
fn as_properties(subcommand: &Command, words: &[OsString]) -> Option<Vec<OsString>> {
    let mut all = Vec::new();
    let mut rest = words;
    while let [word, following @ ..] = rest {
        if word == "--" {
            break;
        }
        rest = following;
        let Some((name, stated)) = word.to_str().and_then(|word| unknown(subcommand, word)) else {
            all.push(word.clone());
            continue;
        };
        let value = match (stated, following) {
            (Some(value), _) => value.to_owned(),
            (None, [next, following @ ..]) if is_value(next) => {
                rest = following;
                let number = next.to_str()?.to_owned();
                // Programs of Lingua Franca take `--period 500 ms`.
                match following.first().and_then(|unit| unit.to_str()) {
                    Some(unit) if number.parse::<i64>().is_ok() && hprm_lf::is_unit(unit) => {
                        rest = &following[1..];
                        format!("{number} {unit}")
                    }
                    _ => number,
                }
            }
            _ => {
                all.push(word.clone());
                continue;
            }
        };
        all.push(format!("--{}={}{name}={value}", args::PROPERTY, hprm_lf::PARAMETER).into());
    }
    let is_changed = all.len() + rest.len() < words.len() || all[..] != words[..all.len()];
    all.extend_from_slice(rest);
    is_changed.then_some(all)
}

/// The name of a parameter that a word sets, and the value if it is in the same word; none if it is an option of
/// the command, or no option with a long name.
fn unknown<'w>(subcommand: &Command, word: &'w str) -> Option<(String, Option<&'w str>)> {
    let (name, value) = match word.strip_prefix("--")?.split_once('=') {
        Some((name, value)) => (name, Some(value)),
        None => (word.strip_prefix("--")?, None),
    };
    let is_long = |arg: &Arg| {
        let aliases = arg.get_all_aliases().unwrap_or_default();
        arg.get_long() == Some(name) || aliases.contains(&name)
    };
    let is_known = name == "help" || name == "version" || subcommand.get_arguments().any(is_long);
    let is_name = name.starts_with(|c: char| c.is_alphabetic() || c == '_')
        && name.chars().all(|c| c.is_alphanumeric() || c == '_' || c == '-');
    (is_name && !is_known).then(|| (name.replace('-', "_"), value))
}

/// Whether a word can be the value of the option before it. A mistyped flag may stand before the program.
fn is_value(word: &OsStr) -> bool {
    let Some(text) = word.to_str() else { return false };
    let is_option = text.starts_with('-') && text.parse::<f64>().is_err();
    !is_option && !is_program(word)
}

/// Whether a name is taken by an option of the command. The parameter can be stated as a property
/// then: `--property main.NAME=VALUE`.
fn is_option(subcommand: &Command, name: &str) -> bool {
    let name = long(name);
    name == "help" || subcommand.get_arguments().any(|arg| arg.get_long() == Some(&name))
}

/// As it is written on the command line: an underscore may be a dash.
fn long(name: &str) -> String {
    name.replace('_', "-")
}

fn option(parameter: &ParameterDecl) -> Arg {
    let (kind, default) = described(&parameter.default);
    shown(&parameter.name, kind, default.as_deref())
}

/// The option for a parameter, with what stands for its value in the help.
fn shown(name: &str, kind: &'static str, default: Option<&str>) -> Arg {
    let help = match default {
        Some(default) => format!("[default: {default}]"),
        None => "[default: computed in Python]".to_owned(),
    };
    let long = long(name);
    let arg = Arg::new(id(name))
        .value_name(kind)
        .help(help)
        .help_heading(HEADING)
        .allow_hyphen_values(true);
    match long == name {
        true => arg.long(long),
        false => arg.long(long).alias(name.to_owned()),
    }
}

/// A name that none of the other options has.
fn id(name: &str) -> String {
    format!("{}{name}", hprm_lf::PARAMETER)
}

/// The parameters that the words set, with their values.
fn stated(matches: &ArgMatches, known: &[&ParameterDecl]) -> Vec<(String, String)> {
    let value = |parameter: &&ParameterDecl| {
        let value: &String = matches.get_one(&id(&parameter.name))?;
        Some((parameter.name.clone(), value.clone()))
    };
    known.iter().filter_map(value).collect()
}

/// What stands for a value in the help, and a default as the program states it, if it is short enough.
fn described(default: &Value) -> (&'static str, Option<String>) {
    const NANOS: [(&str, i64); 4] =
        [("s", 1_000_000_000), ("ms", 1_000_000), ("us", 1_000), ("ns", 1)];
    match default {
        Value::Int(number) => ("NUMBER", Some(number.to_string())),
        Value::Float(number) => ("NUMBER", Some(format!("{number:?}"))),
        Value::Bool(truth) => ("true|false", Some(truth.to_string())),
        Value::Str(text) => ("TEXT", Some(format!("{text:?}"))),
        Value::Char(character) => ("TEXT", Some(format!("{character:?}"))),
        Value::Time(i64::MAX) => ("TIME", Some("forever".to_owned())),
        Value::Time(i64::MIN) => ("TIME", Some("never".to_owned())),
        Value::Time(nanos) => {
            let whole = NANOS.iter().find(|(_, unit)| nanos % unit == 0);
            ("TIME", whole.map(|(name, unit)| format!("{} {name}", nanos / unit)))
        }
        Value::List(_) => ("LIST", None),
        Value::Tuple(_) => ("TUPLE", None),
        _ => ("VALUE", None),
    }
}

/// Joins a number with the unit that follows it, behind an option whose value is a time: programs of
/// Lingua Franca take `--period 500 ms`.
fn join_times(words: &[OsString], known: &[&ParameterDecl]) -> Vec<OsString> {
    let times = known.iter().filter(|parameter| matches!(parameter.default, Value::Time(_)));
    let times: Vec<_> = times
        .flat_map(|parameter| [parameter.name.clone(), long(&parameter.name)])
        .map(|name| format!("--{name}"))
        .collect();
    args::join_times(words, |word| times.iter().any(|time| word == time.as_str()))
}

#[cfg(test)]
mod tests {

    use clap::CommandFactory;
    use clap::error::ErrorKind;

    use super::*;
    use crate::args::Command as Parsed;

    fn in_a_folder<R>(words: &[&str], look: impl FnOnce(Result<Arguments, clap::Error>) -> R) -> R {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("Main.lf");
        let text = "target Python\nmain reactor(rate = 30, frame_size = \"vga\", workers = 2, \
                    period = 50 ms, model = {= None =}) { }";
        std::fs::write(&path, text).unwrap();
        let words = words.iter().map(|word| match *word {
            "Main.lf" => OsString::from(&path),
            word => word.into(),
        });
        let words: Vec<_> = words.collect();
        look(parse(&Arguments::command(), &words).expect("a program is named"))
    }

    fn stated(words: &[&str]) -> Vec<String> {
        in_a_folder(words, |parsed| properties(parsed.unwrap()))
    }

    fn properties(parsed: Arguments) -> Vec<String> {
        match parsed.command {
            Parsed::Run(run) => run.properties.stated(),
            Parsed::Federate(federate) => federate.properties.stated(),
            Parsed::Verify(verify) => verify.properties.stated(),
            other => panic!("{other:?}"),
        }
    }

    /// Parses words in which `app.py` is a program in Python, which is not run.
    fn parsed_of_python(words: &[&str]) -> Option<Result<Arguments, clap::Error>> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("app.py");
        std::fs::write(&path, "raise SystemExit\n").unwrap();
        let words = words.iter().map(|word| match word.strip_prefix("app.py") {
            Some(name) => OsString::from(format!("{}{name}", path.display())),
            None => word.into(),
        });
        parse(&Arguments::command(), &words.collect::<Vec<_>>())
    }

    #[test]
    fn options_of_a_program_in_python_are_its_parameters() {
        let words =
            ["hprm", "run", "--rate", "-3", "app.py:Vision", "--frame-size=full", "-w", "1"];
        let parsed = parsed_of_python(&words).unwrap().unwrap();
        assert_eq!(properties(parsed), ["main.rate=-3", "main.frame_size=full", "workers=1"]);
        let words = ["hprm", "run", "app.py", "--period", "20", "ms", "x", "--", "--rounds", "3"];
        let parsed = parsed_of_python(&words).unwrap().unwrap();
        let Parsed::Run(run) = &parsed.command else { panic!() };
        assert_eq!(run.arguments.all().collect::<Vec<_>>(), ["x", "--rounds", "3"]);
        assert_eq!(properties(parsed), ["main.period=20 ms"]);
        let words = ["hprm", "federate", "app.py", "a", "--rti", "unix:@x", "--federation-id=1"];
        assert!(parsed_of_python(&words).is_none(), "all are known");
    }

    #[test]
    fn a_mistyped_flag_is_no_parameter() {
        for words in [
            &["hprm", "run", "--in-proces", "app.py"][..],
            &["hprm", "run", "app.py", "--in-proces"],
            &["hprm", "run", "app.py", "--in-proces", "--workers", "2"],
        ] {
            assert!(parsed_of_python(words).is_none(), "{words:?}");
        }
    }

    #[test]
    fn parameters_are_options() {
        let words =
            ["hprm", "run", "--rate", "-3", "Main.lf", "--frame-size=full", "--workers", "1"];
        assert_eq!(stated(&words), ["main.rate=-3", "main.frame_size=full", "workers=1"]);
        let words = ["hprm", "verify", "Main.lf", "--runs", "2", "--frame_size", "full"];
        assert_eq!(stated(&words), ["main.frame_size=full"]);
        let words =
            ["hprm", "federate", "Main.lf", "a", "--rti", "unix:@x", "--rate=1", "--", "--rate"];
        assert_eq!(stated(&words), ["main.rate=1"]);
    }

    #[test]
    fn a_time_may_be_two_words() {
        let words = ["hprm", "run", "Main.lf", "--period", "20", "ms", "x", "-o", "2", "sec"];
        assert_eq!(stated(&words), ["main.period=20 ms", "timeout=2 sec"]);
        assert_eq!(stated(&["hprm", "run", "Main.lf", "--period", "20 ms"]), ["main.period=20 ms"]);
        assert_eq!(stated(&["hprm", "run", "Main.lf", "--rate", "20", "ms"]), ["main.rate=20"]);
    }

    #[test]
    fn what_is_no_parameter_is_an_error_that_knows_them() {
        in_a_folder(&["hprm", "run", "Main.lf", "--rat", "3"], |parsed| {
            let error = parsed.unwrap_err();
            assert_eq!(error.kind(), ErrorKind::UnknownArgument);
            assert!(error.to_string().contains("'--rate'"), "{error}");
        });
    }

    #[test]
    fn the_help_of_a_program_shows_its_parameters() {
        in_a_folder(&["hprm", "run", "Main.lf", "--help"], |parsed| {
            let text = parsed.unwrap_err().to_string();
            for expected in [
                "Parameters of the program:",
                "--rate <NUMBER>",
                "[default: 30]",
                "--frame-size <TEXT>",
                "[default: \"vga\"]",
                "--period <TIME>",
                "[default: 50 ms]",
                "--model <VALUE>",
            ] {
                assert!(text.contains(expected), "{expected}: {text}");
            }
        });
    }

    #[test]
    fn commands_without_a_program_are_left_alone() {
        let words = ["hprm", "doctor", "--rate", "3"].map(OsString::from);
        assert!(parse(&Arguments::command(), &words).is_none());
        let words = ["hprm", "run", "/nowhere/Main.lf", "--rate", "3"].map(OsString::from);
        assert!(parse(&Arguments::command(), &words).is_none());
        assert!(!is_program(OsStr::new("/")));
    }
}
