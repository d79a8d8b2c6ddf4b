//! What can be typed after `hprm compose`.

use std::path::PathBuf;

use clap::Args;

use crate::args::{Interpreter, Properties, program};
use crate::source::Program;

/// Write the files for running a program in containers: Dockerfiles and a docker-compose.yml.
///
/// The RTI and each federate are a service of their own, which find one another by name. Nothing is
/// built or started.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  hprm compose Main.lf --wheel hprm-0.1.0-cp312-cp312-manylinux_2_28_x86_64.whl
  docker compose --file Main-containers/docker-compose.yml up --build

The target property docker of the program says what images start from, and more.")]
pub(crate) struct Compose {
    /// The program: FILE.lf, FILE.py, or FILE.py:NAME for one of several main reactors.
    #[arg(value_name = "FILE")]
    pub(crate) file: PathBuf,
    /// The folder for the files, which is made if it is missing. Without it, NAME-containers beside the
    /// program.
    #[arg(long, value_name = "FOLDER")]
    pub(crate) output: Option<PathBuf>,
    /// The folder that becomes part of the images; it must have all files of the program. Without it, the
    /// program's.
    #[arg(long, value_name = "FOLDER")]
    pub(crate) context: Option<PathBuf>,
    /// A wheel of HPRM to install into the images. Without it, their base must have HPRM: the option
    /// runner-base of the target property docker.
    #[arg(long, value_name = "FILE")]
    pub(crate) wheel: Option<PathBuf>,
    /// Replace files that are there already. The secret of the federation stays.
    #[arg(long)]
    pub(crate) force: bool,
    #[command(flatten)]
    pub(crate) properties: Properties,
    #[command(flatten)]
    pub(crate) interpreter: Interpreter,
}

impl Compose {
    /// The program that is meant.
    pub(crate) fn program(&self) -> Program<'_> {
        program(&self.file, &self.properties, &self.interpreter, [])
    }
}
