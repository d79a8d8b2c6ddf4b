//! `hprm sim`: federations from seeds, in a simulated network.
//!
//! `seeds.rs` runs them. Because the simulation takes long to compile, and serves the development of HPRM, it is in the
//! command only with the feature `sim`.

#[cfg(feature = "sim")]
mod seeds;

use std::process::ExitCode;

use crate::args::Sim;
use crate::message::Error;

/// Runs the seeds and shows the outcome.
///
/// # Errors
///
/// None; that something is wrong is an outcome.
#[cfg(feature = "sim")]
pub(crate) fn sim(arguments: &Sim) -> Result<ExitCode, Error> {
    seeds::sim(arguments)
}

/// Says how to get a command that can simulate.
///
/// # Errors
///
/// Always.
#[cfg(not(feature = "sim"))]
pub(crate) fn sim(_: &Sim) -> Result<ExitCode, Error> {
    Err(Error::new("this build of the command cannot simulate federations").hint(
        "in a clone of HPRM: make build, pip install ., or cargo install --path crates/hprm-cli --features sim",
    ))
}
