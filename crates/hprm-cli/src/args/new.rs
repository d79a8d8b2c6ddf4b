//! What can be typed after `hprm new`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

/// Make a project: a program that runs, and a test of it.
#[derive(Args, Clone, PartialEq, Eq, Debug)]
#[command(after_help = "\
Examples:
  hprm new robot                    a program in Lingua Franca, in the new folder robot
  hprm new robot --lang python      the same in plain Python, as a package
  hprm new robot --lang rust        the same in Rust, as a crate")]
pub(crate) struct New {
    /// The folder to make. Its name is that of the project: letters, digits, - and _.
    #[arg(value_name = "NAME")]
    pub(crate) folder: PathBuf,
    /// The language of the program.
    #[arg(long, value_name = "LANGUAGE", default_value = "lf")]
    pub(crate) lang: Language,
    /// For a program in Rust: a clone of HPRM's repository, whose crate it uses. Without it, the one that
    /// this command was built from.
    #[arg(long, value_name = "FOLDER")]
    pub(crate) checkout: Option<PathBuf>,
}

/// In which language a program is written.
#[derive(ValueEnum, Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Language {
    /// Lingua Franca, with bodies in Python
    Lf,
    /// Python
    Python,
    /// Rust
    Rust,
}
