//! What can be typed after `hprm diagram`.

// A command that cannot draw reads none of it, and knows it for its help.
#![cfg_attr(not(feature = "diagram"), allow(dead_code))]

use std::ffi::OsStr;
use std::path::PathBuf;

use clap::Args;

use crate::args::numbers::at_least;
use crate::args::{Interpreter, ProgramArguments, Properties, program};
use crate::source::Program;

/// Draw a program: its reactors, their reactions, and how they are connected.
///
/// Diagrams follow the conventions of Lingua Franca. No reaction runs; a program in Python is imported and makes its
/// reactors, and an executable declares what it is. A program with a causality loop is drawn too, with the loop in
/// red.
#[derive(Args, Debug)]
// That is the letter of a timeout elsewhere, which no diagram shows.
#[command(mut_arg("timeout", |timeout| timeout.short(None)))]
#[command(after_help = "\
Examples:
  hprm diagram Main.lf                        writes Main.svg
  hprm diagram Main.lf -o Main.html           a page whose reactors open and close
  hprm diagram app.py -o app.png

The exit code is 1 if the program has an error, even if there is a diagram of it.")]
pub(crate) struct Diagram {
    /// The program: FILE.lf, FILE.py, FILE.py:NAME for one of several main reactors, or an executable: a program in Rust,
    /// or a federate of another program.
    #[arg(value_name = "FILE")]
    pub(crate) file: PathBuf,
    /// The picture: its name ends in .svg, .png or .html. Without it, NAME.svg in the current directory, where
    /// NAME is that of the program.
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: Option<PathBuf>,
    /// How deep reactors are open: with 1, the contents of the main reactor are drawn, and reactors in it are
    /// closed. Without it, all are open. In a page, that is how it begins.
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = at_least::<u32>(1))]
    pub(crate) depth: Option<u32>,
    #[command(flatten)]
    pub(crate) properties: Properties,
    #[command(flatten)]
    pub(crate) interpreter: Interpreter,
    #[command(flatten)]
    pub(crate) arguments: ProgramArguments,
}

impl Diagram {
    /// The program that is meant.
    pub(crate) fn program(&self) -> Program<'_> {
        program(&self.file, &self.properties, &self.interpreter, self.arguments.all())
    }

    /// How the name of the picture ends, in lower case.
    pub(crate) fn ending(&self) -> Option<String> {
        let ending =
            |path: &PathBuf| path.extension().and_then(OsStr::to_str).map(str::to_lowercase);
        match &self.output {
            Some(path) => ending(path),
            None => Some("svg".to_owned()),
        }
    }
}
