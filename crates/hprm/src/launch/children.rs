//! The processes of a federation: starting, signalling and reaping them.
//!
//! Each federate leads a process group of its own: a Ctrl-C at the terminal reaches only the launcher,
//! and what a federate has started can be ended with it. Nothing is left when this is dropped.

use std::collections::BTreeMap;
use std::io;
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};

use hprm_core::FederateId;
use rustix::process::{Pid, kill_process, kill_process_group};

use super::follow::Followed;
use super::leftovers;
use super::limits::unstarted;
use super::terminal::Lent;
use crate::supervisor::{Observation, Signal};
use crate::{Failure, console};

/// Where a federate reads and writes.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Console {
    /// Its lines are shown behind its name. Its standard input is up to its command.
    Lines,
    /// It writes where this process does.
    Terminal,
}

/// The processes that have been started, and which of them are still to be reaped.
#[derive(Debug, Default)]
pub(super) struct Children {
    processes: BTreeMap<FederateId, Child>,
    /// The federate that has the terminal.
    terminal: Option<(FederateId, Lent)>,
    /// Threads that end what failed federates have left.
    ending: Vec<JoinHandle<()>>,
}

impl Children {
    /// Starts the process of a federate, and reports what becomes of it.
    ///
    /// # Errors
    ///
    /// If it cannot be started.
    pub(super) fn start(
        &mut self,
        (id, name): (FederateId, &str),
        mut command: Command,
        console: Console,
        report: impl Fn(Observation) + Send + 'static,
    ) -> Result<(), Failure> {
        if console == Console::Lines {
            command.stdout(Stdio::piped()).stderr(Stdio::piped());
        }
        command.process_group(0);
        let what = format!("cannot start federate {name} with {}", command.get_program().display());
        let unstarted = |error: io::Error| unstarted(&what, &error);
        let mut child = command.spawn().map_err(unstarted)?;
        if console == Console::Terminal {
            self.terminal = Lent::to(child.id()).map(|lent| (id, lent));
        }
        let pipes = (child.stdout.take(), child.stderr.take());
        let followed = Followed::new(pid(&child), name, pipes);
        self.processes.insert(id, child);
        let followed = followed.map_err(unstarted)?;
        let follow = move || {
            let how = followed.follow(|error| match error.kind() {
                io::ErrorKind::BrokenPipe => report(Observation::Signal(Signal::BROKEN_PIPE)),
                _ => report(Observation::Unwritable(Box::new(console::unwritable(error).report()))),
            });
            report(Observation::Ended { federate: id, how });
        };
        thread::Builder::new().name(name.to_owned()).spawn(follow).map_err(unstarted)?;
        Ok(())
    }

    /// Sends a signal to a process and, unless it is Ctrl-C, to what it has started.
    pub(super) fn send(&self, signal: Signal, to: FederateId) {
        if let Some(child) = self.processes.get(&to) {
            if signal == Signal::INTERRUPT {
                // It may have ended.
                let _ = kill_process(pid(child), rustix::process::Signal::INT);
            } else {
                signal_group(child, signal);
            }
        }
    }

    /// Forgets a process that has ended. What it has started ends too if it did not end `well`.
    pub(super) fn reap(&mut self, id: FederateId, well: bool) {
        self.terminal.take_if(|(debugged, _)| *debugged == id);
        if let Some(mut child) = self.processes.remove(&id) {
            if well {
                // Its status is known already.
                let _ = child.wait();
            } else {
                self.end(child);
            }
        }
    }

    /// Reaps a process and ends what it has started, on a thread of its own if the system has one.
    fn end(&mut self, child: Child) {
        let shared = Arc::new(Mutex::new(Some(child)));
        let taken = Arc::clone(&shared);
        let end = move || {
            let child = taken.lock().unwrap_or_else(PoisonError::into_inner).take();
            child.into_iter().for_each(leftovers::end);
        };
        match thread::Builder::new().name("ending".to_owned()).spawn(end.clone()) {
            Ok(ending) => self.ending.push(ending),
            Err(_) => end(),
        }
    }
}

impl Drop for Children {
    fn drop(&mut self) {
        let left: Vec<_> = self.processes.keys().copied().collect();
        for id in left {
            self.send(Signal::KILL, id);
            self.reap(id, false);
        }
        for ending in self.ending.drain(..) {
            // It has nothing to tell.
            let _ = ending.join();
        }
    }
}

fn pid(child: &Child) -> Pid {
    Pid::from_child(child)
}

/// A process that has not been reaped keeps its number, so this reaches no other process.
fn signal_group(child: &Child, signal: Signal) {
    let signal = match signal {
        Signal::KILL => rustix::process::Signal::KILL,
        _ => rustix::process::Signal::TERM,
    };
    // There may be no process left in the group.
    let _ = kill_process_group(pid(child), signal);
}
