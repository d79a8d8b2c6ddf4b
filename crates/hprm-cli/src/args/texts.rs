//! Commands that need no program: they print what HPRM knows of itself.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

/// Say what a code of a diagnostic means: why it is a mistake, an example, and its cure.
///
/// Without a code, all are listed.
#[derive(Args, Clone, PartialEq, Eq, Debug)]
#[command(after_help = "\
Examples:
  hprm explain LF0503
  hprm explain lf503                  the same
  hprm explain LF05                   all codes that begin with it
  hprm explain | grep port            the codes whose titles speak of ports")]
pub(crate) struct Explain {
    /// The codes, as `hprm check` prints them.
    #[arg(value_name = "CODE")]
    pub(crate) codes: Vec<String>,
    /// Print one JSON object a line, with the examples' files.
    #[arg(long)]
    pub(crate) json: bool,
    /// Print Markdown, as in the handbook.
    #[arg(long, conflicts_with = "json")]
    pub(crate) markdown: bool,
}

/// A shell that completes words.
#[derive(ValueEnum, Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Shell {
    Bash,
    Elvish,
    Fish,
    Powershell,
    Zsh,
}

/// Print what a shell needs to complete the words of this command.
#[derive(Args, Clone, PartialEq, Eq, Debug)]
#[command(
    after_help = "For bash: hprm completions bash > ~/.local/share/bash-completion/completions/hprm"
)]
pub(crate) struct Completions {
    /// The shell.
    pub(crate) shell: Shell,
}

/// Write the manual pages: hprm.1, and one for each command.
#[derive(Args, Clone, PartialEq, Eq, Debug)]
#[command(after_help = "hprm man ~/.local/share/man/man1, then: man hprm-run")]
pub(crate) struct Man {
    /// The folder for them, which is made if it is missing.
    pub(crate) folder: PathBuf,
}
