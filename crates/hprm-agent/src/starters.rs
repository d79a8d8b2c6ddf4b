//! Starters: processes that start programs here for other machines, one for each link to [`STARTERS`].
//!
//! The agent only leads their links. What they do, and for whom, is the business of `hprm starter`.

use std::env;
use std::io;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};

use hprm::agent::STARTERS;

use crate::options::Programs;
use crate::threads;

/// How many programs may run at the same time.
const LIMIT: usize = 64;

/// See the module.
pub(crate) struct Starters {
    machine: String,
    programs: Option<Programs>,
    running: Vec<Child>,
}

impl Starters {
    /// None yet.
    pub(crate) fn new(machine: &str, programs: Option<Programs>) -> Self {
        Self { machine: machine.to_owned(), programs, running: Vec::new() }
    }

    /// Whether a link to a listener of that name is for a starter.
    pub(crate) fn is_meant(name: &str) -> bool {
        name == STARTERS
    }

    /// Starts a starter, which has `connection` from then on.
    ///
    /// # Errors
    ///
    /// Why not.
    pub(crate) fn start(&mut self, connection: &UnixStream) -> Result<(), String> {
        let machine = &self.machine;
        let Some(programs) = &self.programs else {
            return Err(format!(
                "the agent of {machine} starts no programs: start it with --fleet-keys FILE"
            ));
        };
        if self.running.len() >= LIMIT {
            return Err(format!("{LIMIT} programs run on {machine} already"));
        }
        let failed =
            |error: io::Error| format!("the agent of {machine} cannot start hprm: {error}");
        let socket = connection.try_clone().map_err(failed)?;
        let mut command = Command::new(hprm());
        command.arg("starter").arg("--agent").arg(std::process::id().to_string());
        command.arg("--machine").arg(machine).arg("--keys").arg(&programs.keys);
        command.args(programs.allow_root.then_some("--allow-root"));
        command.args(programs.limits.arguments());
        threads::forget(&mut command);
        command.stdin(Stdio::from(std::os::fd::OwnedFd::from(socket))).stdout(Stdio::null());
        self.running.push(command.spawn().map_err(failed)?);
        Ok(())
    }

    /// Takes note of those that have ended.
    pub(crate) fn reap(&mut self) {
        self.running.retain_mut(|starter| !matches!(starter.try_wait(), Ok(Some(_))));
    }
}

/// The command `hprm`: beside this program, or on the PATH.
fn hprm() -> PathBuf {
    let beside = env::current_exe().ok().map(|this| this.with_file_name("hprm"));
    beside.filter(|path| path.is_file()).unwrap_or_else(|| PathBuf::from("hprm"))
}
