//! `hprm completions` and `hprm man`: what shells and `man` need to know of this command.
//!
//! Both are made of the same declaration as the help texts, only with the feature `completions`: people install them
//! once, and what writes them takes time to compile.

use std::process::ExitCode;

use crate::args::{Completions, Man};
use crate::message::Error;

/// Prints what a shell reads.
///
/// # Errors
///
/// None, in this build.
#[cfg(feature = "completions")]
pub(crate) fn completions(wanted: &Completions) -> Result<ExitCode, Error> {
    written::completions(wanted);
    Ok(ExitCode::SUCCESS)
}

/// Writes the manual pages.
///
/// # Errors
///
/// If they cannot be written.
#[cfg(feature = "completions")]
pub(crate) fn man(wanted: &Man) -> Result<ExitCode, Error> {
    written::man(wanted)
}

/// Says how to get a command that prints them.
///
/// # Errors
///
/// Always.
#[cfg(not(feature = "completions"))]
pub(crate) fn completions(_: &Completions) -> Result<ExitCode, Error> {
    Err(missing())
}

/// Says how to get a command that writes them.
///
/// # Errors
///
/// Always.
#[cfg(not(feature = "completions"))]
pub(crate) fn man(_: &Man) -> Result<ExitCode, Error> {
    Err(missing())
}

#[cfg(not(feature = "completions"))]
fn missing() -> Error {
    Error::new("this build of the command has neither completions nor manual pages").hint(
        "in a clone of HPRM: make build, pip install ., or cargo install --path crates/hprm-cli",
    )
}

#[cfg(feature = "completions")]
mod written {
    use std::fs;
    use std::io;
    use std::path::Path;
    use std::process::ExitCode;

    use clap::CommandFactory;
    use clap_complete::{Shell as Target, generate};

    use crate::args::{Arguments, Completions, Man, Shell};
    use crate::message::{self, Error};

    pub(super) fn completions(wanted: &Completions) {
        let shell = match wanted.shell {
            Shell::Bash => Target::Bash,
            Shell::Elvish => Target::Elvish,
            Shell::Fish => Target::Fish,
            Shell::Powershell => Target::PowerShell,
            Shell::Zsh => Target::Zsh,
        };
        let mut text = Vec::new();
        generate(shell, &mut Arguments::command(), "hprm", &mut text);
        message::print_line(String::from_utf8_lossy(&text).trim_end());
    }

    pub(super) fn man(wanted: &Man) -> Result<ExitCode, Error> {
        let folder = &wanted.folder;
        write(folder).map_err(|error| {
            Error::new(format!(
                "cannot write manual pages in {}: {}",
                folder.display(),
                message::reason(&error)
            ))
        })?;
        Ok(ExitCode::SUCCESS)
    }

    fn write(folder: &Path) -> io::Result<()> {
        fs::create_dir_all(folder)?;
        clap_mangen::generate_to(Arguments::command(), folder)
    }
}
