//! Launching a federation in Rust: its federates are processes of this executable, with the same arguments.

use std::env;
use std::path::PathBuf;
use std::process::Command;
use std::sync::Arc;
use std::time::Duration;

use hprm_core::{Program, StoreOptions};

use crate::handover::{Handover, Meeting, Which};
use crate::launch::{Launch, Membership};
use crate::recorder::TraceRequest;
use crate::supervisor::Advice;
use crate::{Failure, HangTimeout, Label, Security, console, random_federation};

/// How a federation is launched.
pub(super) struct Launching {
    /// How long the federates may take to join and load.
    pub(super) join_timeout: Duration,
    pub(super) hang_timeout: HangTimeout,
    pub(super) logical_trace: Option<PathBuf>,
    pub(super) trace: Option<PathBuf>,
    /// The object store of each federate.
    pub(super) store: StoreOptions,
}

impl Default for Launching {
    fn default() -> Self {
        Self {
            join_timeout: Duration::from_secs(60),
            hang_timeout: HangTimeout::default(),
            logical_trace: None,
            trace: None,
            store: StoreOptions::default(),
        }
    }
}

impl Launching {
    /// Launches all federates of a program, and supervises them to their end.
    /// `which` tells the federates which one it is of those of its name.
    pub(super) fn launch(self, program: &Arc<Program>, which: &Which) -> Result<(), Failure> {
        let unable = |what: &str, error: &std::io::Error| Failure::system(what, error);
        let executable =
            executable().map_err(|error| unable("cannot find this executable", &error))?;
        let (federation, security) = (random_federation()?, Security::default());
        let fingerprint = Arc::new(program.fingerprint());
        let launch = Launch {
            program: Arc::clone(program),
            fingerprint: Arc::clone(&fingerprint),
            federation,
            also_listen: Vec::new(),
            security: security.clone(),
            join_timeout: self.join_timeout,
            hang_timeout: self.hang_timeout,
            debugged: None,
            logical_trace: self.logical_trace,
            trace: self.trace.map(TraceRequest::file),
            advice: Advice::PROGRAM,
        };
        let command = |member: &Membership<'_>| {
            let meeting = Meeting { rti: member.rti, federation, security: &security };
            let mut handover = Handover::new(member.name, program, &fingerprint, &meeting);
            handover.which = Some(which.clone());
            handover.store = self.store;
            let share = member.share.as_ref();
            handover.logical_trace = share.map(|it| (it.file.clone(), Some(it.trace.clone())));
            let mut command = Command::new(&executable);
            command.args(env::args_os().skip(1));
            let attached = handover.attach(&mut command);
            attached.map_err(|error| unable("cannot hand the program to a federate", &error))?;
            Ok(command)
        };
        let mut failed = None;
        let mut tell = |label, report| match (label, &failed) {
            // The caller gets the first one.
            (Label::Error, None) => failed = Some(report),
            _ => console::show(label, &report),
        };
        let code = launch.run(command, &mut tell)?;
        match (code, failed) {
            (0, _) => Ok(()),
            (_, Some(report)) => Err(Failure::FederateFailed(Box::new(report))),
            (code, None) if code > 128 => Err(Failure::Interrupted { signal: code - 128 }),
            (code, None) => Err(Failure::Exited { code }),
        }
    }
}

/// This executable, even if its file has been deleted or replaced since it was started.
fn executable() -> std::io::Result<PathBuf> {
    let path = env::current_exe()?;
    // Where the file is there, it gives the processes its name.
    Ok(if path.exists() { path } else { "/proc/self/exe".into() })
}
