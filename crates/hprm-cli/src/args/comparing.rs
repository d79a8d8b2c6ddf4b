//! What can be typed to compare runs.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;

use super::numbers::at_least;
use super::{Interpreter, ProgramArguments, Properties, program, seconds};
use crate::source::Program;

/// Compare two logical traces, and say where they part.
///
/// What a program reads from the physical world, and what follows from it, is left out.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  hprm run --logical-trace A.trace Main.lf
  hprm run --logical-trace B.trace --workers 8 Main.lf
  hprm diff A.trace B.trace

The exit code is 0 if they are equal, and 3 if they are not.")]
pub(crate) struct Diff {
    /// A trace, written by hprm run --logical-trace.
    #[arg(value_name = "A")]
    pub(crate) a: PathBuf,
    /// Another one of the same program.
    #[arg(value_name = "B")]
    pub(crate) b: PathBuf,
    #[command(flatten)]
    pub(crate) verdict: VerdictArguments,
}

/// How two traces are compared, and how the result is shown.
#[derive(Args, Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct VerdictArguments {
    /// Also compare what stems from the physical world.
    #[arg(long)]
    pub(crate) physical: bool,
    /// Print one JSON object instead of text.
    #[arg(long)]
    pub(crate) json: bool,
}

/// Run a program several times, each time in another way, and compare what it did.
///
/// The runs differ in the seed of Python's hashes, the number of workers and the load of the
/// machine; those of a federated program also in the coordination, and in whether federates are
/// processes, threads of one, or parts of one program. What an option or --property states does not
/// differ.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  hprm verify Main.lf
  hprm verify --runs 20 --keep traces Main.lf    then: hprm diff traces/1.trace traces/7.trace

The exit code is 0 if all runs did the same, and 3 if two did not.")]
pub(crate) struct Verify {
    /// The program: FILE.lf, FILE.py, or FILE.py:NAME for one of several main reactors.
    #[arg(value_name = "FILE")]
    pub(crate) file: PathBuf,
    /// How often to run it.
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value = "6", value_parser = at_least::<u32>(2))]
    pub(crate) runs: u32,
    /// Seconds that a run may take.
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, default_value = "300", value_parser = seconds)]
    pub(crate) run_timeout: Duration,
    /// A folder for the traces, which are deleted otherwise.
    #[arg(long, value_name = "FOLDER")]
    pub(crate) keep: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) verdict: VerdictArguments,
    #[command(flatten)]
    pub(crate) properties: Properties,
    #[command(flatten)]
    pub(crate) interpreter: Interpreter,
    #[command(flatten)]
    pub(crate) arguments: ProgramArguments,
}

impl Verify {
    /// The program that is meant.
    pub(crate) fn program(&self) -> Program<'_> {
        program(&self.file, &self.properties, &self.interpreter, self.arguments.all())
    }
}
