//! `hprm completions` and `hprm man`: what shells and `man` need to know of this command.
//!
//! Both are made of the same declaration as the help texts.

use std::fs;
use std::io;
use std::path::Path;
use std::process::ExitCode;

use clap::CommandFactory;
use clap_complete::generate;

use crate::args::{Arguments, Completions, Man};
use crate::message::{self, Error};

/// Prints what a shell reads.
pub(crate) fn completions(wanted: &Completions) -> ExitCode {
    let mut text = Vec::new();
    generate(wanted.shell, &mut Arguments::command(), "hprm", &mut text);
    message::print_line(String::from_utf8_lossy(&text).trim_end());
    ExitCode::SUCCESS
}

/// Writes the manual pages.
///
/// # Errors
///
/// If they cannot be written.
pub(crate) fn man(wanted: &Man) -> Result<ExitCode, Error> {
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
