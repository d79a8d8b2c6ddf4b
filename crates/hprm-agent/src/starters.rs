//! Starters: processes that start programs here for other machines, one for each link to [`STARTERS`].
//!
//! The agent only leads their links. What they do, and for whom, is the business of `hprm starter`. The kernel ends them when the
//! thread ends that has started them, so that is one which is there as long as the agent is ([`Spawns`]).

use std::env;
use std::io;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

use hprm::Clock;
use hprm::agent::{Limited, STARTERS};
use hprm::console::reason;
use hprm::launch::Group;
use hprm_core::{Nanos, PhysicalTime};

use crate::groups::Groups;
use crate::options::Programs;
use crate::threads;

/// How many programs may run at the same time.
const LIMIT: usize = 64;

/// How soon it is noticed that a starter has ended, whose program is to end with it.
const LOOK: Nanos = 250_000_000;

/// How long processes may take to be gone that were killed.
const GONE: Duration = Duration::from_secs(1);

/// A process that is to be started, and where it goes.
type Spawn = (Command, Sender<io::Result<Child>>);

/// Processes that are to be started.
pub(crate) struct Spawns(Receiver<Spawn>);

/// See the module.
pub(crate) struct Starters {
    machine: String,
    programs: Option<Programs>,
    running: Vec<(Child, Option<Group>)>,
    /// Those of programs whose starters have ended, and that are not gone yet.
    ending: Vec<Group>,
    /// After those in it.
    groups: Option<Groups>,
    /// Why there are none, if programs are started without.
    ungrouped: Option<String>,
    spawns: Sender<Spawn>,
}

impl Spawns {
    /// Starts what is to be started, until the agent has ended.
    pub(crate) fn start(self) {
        for (mut command, started) in self.0 {
            // The agent waits for it.
            let _ = started.send(command.spawn());
        }
    }
}

impl Starters {
    /// None yet. If there may be any, the agent gets control groups, where the system lets it.
    pub(crate) fn new(machine: &str, programs: Option<Programs>) -> (Self, Spawns) {
        let groups = programs.is_some().then(Groups::open);
        let (groups, ungrouped) = match groups {
            Some(Ok(groups)) => (Some(groups), None),
            Some(Err(why)) => (None, Some(why)),
            None => (None, None),
        };
        let (running, ending) = (Vec::new(), Vec::new());
        let (machine, (spawns, spawned)) = (machine.to_owned(), channel());
        let starters = Self { machine, programs, running, ending, groups, ungrouped, spawns };
        (starters, Spawns(spawned))
    }

    /// For what the limits of programs count, if the agent starts any.
    pub(crate) fn limited(&self) -> Option<Limited> {
        let groups = self.groups.as_ref().map(|_| Limited::Program);
        groups.or_else(|| self.ungrouped.as_ref().map(|_| Limited::Process))
    }

    /// The same for people.
    pub(crate) fn limited_text(&self) -> Option<String> {
        let together = "limits count for all processes of a program together, by cgroups";
        let each = |why| {
            format!("limits count for each process of a program, as there are no cgroups: {why}")
        };
        let groups = self.groups.as_ref().map(|_| together.to_owned());
        groups.or_else(|| self.ungrouped.as_ref().map(each))
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
        self.reap();
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
        let group = self.groups.as_mut().map(|groups| groups.make(programs.limits.of_group()));
        let group = group.transpose().map_err(|error| {
            format!("the agent of {machine} cannot limit a program: {}", reason(&error))
        })?;
        if let Some(group) = &group {
            command.arg("--group").arg(group.path());
        }
        threads::forget(&mut command);
        command.stdin(Stdio::from(std::os::fd::OwnedFd::from(socket))).stdout(Stdio::null());
        match self.spawn(command) {
            Ok(starter) => self.running.push((starter, group)),
            Err(error) => {
                self.ending.extend(group);
                return Err(failed(error));
            }
        }
        Ok(())
    }

    fn spawn(&self, command: Command) -> io::Result<Child> {
        let (started, starts) = channel();
        let gone = || io::Error::other("the agent ends");
        self.spawns.send((command, started)).map_err(|_| gone())?;
        starts.recv().map_err(|_| gone())?
    }

    /// Takes note of those that have ended, and ends what is left of their programs.
    pub(crate) fn reap(&mut self) {
        let ended = self.running.extract_if(.., |(it, _)| matches!(it.try_wait(), Ok(Some(_))));
        self.ending.extend(ended.filter_map(|(_, group)| group));
        // What was killed takes a moment.
        self.ending.retain(|group| !group.end(Duration::ZERO));
    }

    /// When to do that again, even if nothing else happens.
    pub(crate) fn next_wakeup(&self) -> Option<PhysicalTime> {
        let is_awaited = !self.ending.is_empty() || !self.running.is_empty();
        is_awaited.then(|| Clock::local().plus(LOOK))
    }
}

impl Drop for Starters {
    /// The kernel ends them with the agent; they leave no groups behind if they end before.
    fn drop(&mut self) {
        for (starter, _) in &mut self.running {
            // It may have ended.
            let _ = starter.kill();
            let _ = starter.wait();
        }
        for group in
            self.running.drain(..).filter_map(|(_, group)| group).chain(self.ending.drain(..))
        {
            // What is left then, the next agent removes.
            let _ = group.end(GONE);
        }
    }
}

/// The command `hprm`: beside this program, or on the PATH.
fn hprm() -> PathBuf {
    let beside = env::current_exe().ok().map(|this| this.with_file_name("hprm"));
    beside.filter(|path| path.is_file()).unwrap_or_else(|| PathBuf::from("hprm"))
}
