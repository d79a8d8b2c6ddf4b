//! What can be typed about traces of runs.

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};
use hprm::recorder::{DEFAULT_CAPACITY, TraceRequest};

use super::numbers::whole;

/// Whether the run is traced.
#[derive(Args, Clone, PartialEq, Eq, Debug, Default)]
pub(crate) struct Tracing {
    /// Record reactions, messages, grants and waits with physical time and tag, into a file that Perfetto opens.
    #[arg(long, value_name = "FILE")]
    trace: Option<PathBuf>,
    /// How many records wait in memory for each thread until they are written; what comes then is lost, and counted.
    #[arg(long, value_name = "RECORDS", requires = "trace", default_value_t = DEFAULT_CAPACITY as u64,
          hide_default_value = true, value_parser = whole::<u64>(2, 1 << 28))]
    trace_buffer: u64,
}

impl Tracing {
    /// The file that the option names.
    pub(crate) fn file(&self) -> Option<&Path> {
        self.trace.as_deref()
    }

    /// What is asked for; without that, what the program asks for.
    pub(crate) fn request(&self, stated: Option<String>) -> Option<TraceRequest> {
        let path = self.trace.clone().or_else(|| stated.map(PathBuf::from))?;
        let capacity = match self.trace_buffer {
            0 => DEFAULT_CAPACITY,
            records => usize::try_from(records).unwrap_or(usize::MAX),
        };
        Some(TraceRequest { capacity, ..TraceRequest::file(path) })
    }
}

/// Look into a trace of a run.
#[derive(Args, Debug)]
pub(crate) struct Trace {
    #[command(subcommand)]
    pub(crate) command: TraceCommand,
}

#[derive(Subcommand, Debug)]
pub(crate) enum TraceCommand {
    Summary(Summary),
}

/// Say how long reactions took and messages travelled.
#[derive(Args, Debug)]
#[command(after_help = "\
Example:
  hprm run --trace robot.pftrace Main.lf
  hprm trace summary robot.pftrace")]
pub(crate) struct Summary {
    /// A trace, written by hprm run --trace.
    #[arg(value_name = "FILE")]
    pub(crate) file: PathBuf,
    /// Print one JSON object instead of text.
    #[arg(long)]
    pub(crate) json: bool,
}
