//! What can be typed after `hprm machines` and `hprm agent`.

use std::convert::Infallible;
use std::ffi::OsString;
use std::path::PathBuf;

use clap::Args;
use hprm::agent::is_name;
use hprm_core::federate_name;

/// Names the file with a fleet key for all programs.
pub(crate) const FLEET_KEY: &str = "HPRM_FLEET_KEY";

/// List the machines whose agents see one another.
///
/// The agent of this machine asks those of all others: for the version of HPRM, processors, memory, what their clocks
/// show beside that of this machine, the names of the federations that run there, and whether limits of programs that the agent starts
/// count for all processes of a program together.
#[derive(Args, Clone, PartialEq, Eq, Debug)]
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

/// Which federates run on other machines.
#[derive(Args, Clone, PartialEq, Eq, Debug, Default)]
pub(crate) struct At {
    /// Run a federate, or all members of a bank, on a machine that `hprm machines` lists, or on this one (localhost),
    /// instead of where the program says. May be repeated. The program's files travel there.
    #[arg(long, value_name = "FEDERATE=MACHINE", conflicts_with_all = ["in_process", "debug"], value_parser = at)]
    pub(crate) at: Vec<(String, String)>,
    /// The file with a fleet key that the agents of those machines know. With it, federates also run where the program
    /// says (at).
    #[arg(long, value_name = "FILE", env = FLEET_KEY, hide_env_values = true)]
    pub(crate) fleet_key: Option<PathBuf>,
}

/// The name of a federate, which may be written as Lingua Franca writes a member of a bank.
pub(crate) fn federate(text: &str) -> Result<String, Infallible> {
    Ok(federate_name(text).into_owned())
}

fn at(text: &str) -> Result<(String, String), String> {
    let stated =
        text.split_once('=').filter(|(federate, machine)| !federate.is_empty() && is_name(machine));
    let stated = stated.map(|(federate, machine)| (federate.to_owned(), machine.to_owned()));
    stated.ok_or_else(|| "write FEDERATE=MACHINE, as in --at camera=robot1".to_owned())
}

/// Start a federate for a stand-in, as the agent of this machine asks.
#[derive(Args, Clone, PartialEq, Eq, Debug)]
pub(crate) struct Starter {
    /// The process of the agent.
    #[arg(long)]
    pub(crate) agent: i32,
    /// This machine.
    #[arg(long)]
    pub(crate) machine: String,
    /// The file with the keys of those that may start programs here.
    #[arg(long)]
    pub(crate) keys: PathBuf,
    /// Whether programs may run as root.
    #[arg(long)]
    pub(crate) allow_root: bool,
    /// How many bytes a process may allocate.
    #[arg(long)]
    pub(crate) memory: u64,
    /// How many processes and threads this user may have.
    #[arg(long)]
    pub(crate) processes: u64,
    /// How many files a process may have open.
    #[arg(long)]
    pub(crate) files: u64,
    /// The control group in which the program is to run, with limits for all of it together.
    #[arg(long)]
    pub(crate) group: Option<PathBuf>,
}
