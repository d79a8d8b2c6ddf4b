//! What can be typed after `hprm machines` and `hprm agent`.

use std::ffi::OsString;

use clap::Args;

/// List the machines whose agents see one another.
///
/// The agent of this machine asks those of all others: for the version of HPRM, processors, memory, what their clocks
/// show beside that of this machine, and the names of the federations that run there.
#[derive(Args, Clone, PartialEq, Eq, Debug)]
#[command(after_help = "\
Examples:
  hprm machines
  hprm machines --json | jq '.machines[] | select(.about == null) | .name'")]
pub(crate) struct Machines {
    /// Print one JSON object.
    #[arg(long)]
    pub(crate) json: bool,
}

/// Start the agent of this machine, which leads links to other machines.
///
/// It is the program hprm-agent, beside this command or on the PATH; `hprm agent --help` shows its options.
#[derive(Args, Clone, PartialEq, Eq, Debug)]
#[command(disable_help_flag = true)]
pub(crate) struct Agent {
    /// What hprm-agent is given.
    #[arg(value_name = "OPTIONS", trailing_var_arg = true, allow_hyphen_values = true)]
    pub(crate) options: Vec<OsString>,
}
