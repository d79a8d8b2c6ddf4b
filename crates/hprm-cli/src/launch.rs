//! Running a federation on this machine: an RTI in a thread, and a process for each federate.
//!
//! This is the loop around the [`Supervisor`]: it brings events and carries out orders. The main
//! thread starts the processes, because they ask the system to die with the thread that did.

use std::ffi::OsString;
use std::path::PathBuf;
use std::process::Command;
use std::sync::Arc;
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread;
use std::time::Duration;

use hprm::supervisor::{Driver, FederateEnding, Members, Observation, Order, Outcome, Supervisor};
use hprm::{Address, Rti, RtiHandle, RtiOptions, STAGE, Security, enter_realtime};
use hprm::{FederationId, HangTimeout};
use hprm_core::{FederateId, Program};
use hprm_model::Compiled;

use crate::args::{PYTHON, Properties};
use crate::children::{Children, Console};
use crate::launcher::{self, Commands};
use crate::limits;
use crate::message::Error;
use crate::python;
use crate::registry::{self, Entry, Record};
use crate::secret;
use crate::signals;
use crate::trace::Parts;

/// Where a process finds the secret of its federation. On the command line, all users could see it.
pub(crate) const FEDERATION_ID: &str = "HPRM_FEDERATION_ID";

/// Where a federate that another one starts finds the target properties that override the program's, one
/// a line.
pub(crate) const PROPERTIES: &str = "HPRM_PROPERTIES";

/// Events that may wait for the loop, which never takes long. More of them wait where they arise.
const EVENTS: usize = 64;

/// How a federation is to be run.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Plan {
    pub(crate) python: PathBuf,
    pub(crate) file: PathBuf,
    pub(crate) arguments: Vec<OsString>,
    pub(crate) properties: Properties,
    pub(crate) join_timeout: Duration,
    /// The federate that gets the terminal.
    pub(crate) debugged: Option<FederateId>,
    pub(crate) hang_timeout: HangTimeout,
    pub(crate) logical_trace: Option<PathBuf>,
    /// Where the files of the program lie side by side, if not beside it.
    pub(crate) stage: Option<PathBuf>,
    pub(crate) security: Security,
}

/// Runs a federation to its end, and returns the exit code.
///
/// # Errors
///
/// If it cannot be started; nothing is left of it then.
pub(crate) fn launch(compiled: &Compiled, plan: &Plan) -> Result<i32, Error> {
    let program = &compiled.program;
    limits::check_files(program.federates.len(), false)?;
    let (events, arrivals) = sync_channel(EVENTS);
    let signals = events.clone();
    signals::watch(move |signal| signals.send(Observation::Signal(signal)).is_ok())
        .map_err(|error| Error::new(format!("cannot watch for Ctrl-C: {error}")))?;
    let parts = plan.logical_trace.as_deref().map(Parts::of).transpose()?;
    let federation = secret::random()?;
    let (rti, address) = start_rti(compiled, federation, plan, events.clone())?;

    let _visible = program
        .federates
        .values()
        .any(|federate| federate.transient)
        .then(|| plan.become_visible(program, &address, federation))
        .transpose()?;
    let mut children = Children::default();
    let mut federates: Vec<_> = program.federates.iter().collect();
    // First: the start does not wait for transient federates, and most programs want them to take part.
    federates.sort_by_key(|(_, federate)| !federate.transient);
    for (id, federate) in federates {
        let share = parts.as_ref().map(|parts| parts.options(&parts.share(&federate.name)));
        let mut command = plan.command(&federate.name, &address, share);
        command.env(FEDERATION_ID, federation.to_string());
        if let Some(stage) = &plan.stage {
            command.env(STAGE, stage);
        }
        command.env(PROPERTIES, plan.properties.stated().join("\n"));
        let events = events.clone();
        command.env(PYTHON, &plan.python);
        let console = if plan.debugged == Some(id) { Console::Terminal } else { Console::Lines };
        // Once the receiver is gone, the command is about to end.
        let report = move |event| drop(events.send(event));
        children.start((id, &federate.name), command, console, report)?;
    }
    let mut supervisor = Supervisor::new(program, Members::Processes, plan.join_timeout);
    let mut launched = Launched { children, rti };
    let Outcome { code, is_traced } = supervisor.run(&mut launched, &arrivals);
    launched.rti.abort();
    if let Some(parts) = parts.filter(|_| is_traced) {
        parts.merge(program, supervisor.is_interrupted(), code)?;
    }
    Ok(code)
}

impl Plan {
    /// Lets transient federates be started again by others: by the commands of Lingua Franca, and by
    /// name from anywhere, while the result lives.
    fn become_visible(
        &self,
        program: &Program,
        rti: &Address,
        federation: FederationId,
    ) -> Result<(Option<Entry>, Commands), Error> {
        let is_left = registry::sweep(&self.file);
        let others = registry::of_program(&self.file);
        let inherits = is_left || others.iter().any(|other| other.made);
        let commands = launcher::write(program, &self.file, inherits)?;
        let properties = self.properties.stated();
        let mut record = Record::new(&self.file, rti, federation, properties, &self.python);
        record.made = !commands.is_empty();
        // The program itself runs without.
        let entry = registry::enter(&record).map_err(|error| {
            error
                .hint("other processes find the federation by --rti and --federation only")
                .show_as_warning();
        });
        // In this order they go: the commands look whether another federation needs them.
        Ok((entry.ok(), commands))
    }

    fn command(&self, name: &str, rti: &Address, share: Option<Vec<OsString>>) -> Command {
        let mut command = python::module(&self.python, "federate");
        command.arg("--rti").arg(rti.to_string());
        command.args(share.into_iter().flatten());
        command.args(self.properties.options());
        // It leaves the words on its failure to this process, and never outlives it.
        command.arg("--launched");
        command.arg("--die-with-parent").arg(std::process::id().to_string());
        command.arg("--").arg(&self.file).arg(name).args(&self.arguments);
        command
    }
}

/// Every user of the machine can see the name of a socket, so it must not contain the secret.
fn private_address() -> Result<Address, Error> {
    let name = u64::from_ne_bytes(secret::random_bytes()?);
    Ok(format!("unix:@hprm-{name:016x}-rti").parse().expect("an abstract name is an address"))
}

fn start_rti(
    compiled: &Compiled,
    federation: FederationId,
    plan: &Plan,
    events: SyncSender<Observation>,
) -> Result<(RtiHandle, Address), Error> {
    let options = RtiOptions {
        program: Arc::clone(&compiled.program),
        fingerprint: Arc::new(compiled.fingerprint()),
        federation,
        listen: private_address()?,
        also_listen: Vec::new(),
        security: plan.security.clone(),
        hang_timeout: plan.hang_timeout,
    };
    let rti = Rti::bind(&options).map_err(|failure| Error::from(&failure))?;
    let (handle, address) = (rti.handle(), rti.address().clone());
    let (entered, is_entered) = sync_channel(1);
    let program = Arc::clone(&compiled.program);
    let run = move || {
        let allowed = enter_realtime(&program.properties, None);
        let refused = allowed.is_err();
        if entered.send(allowed).is_err() || refused {
            return;
        }
        let outcome = rti.run(|event| drop(events.send(Observation::Rti(event))));
        drop(events.send(Observation::RtiEnded(outcome)));
    };
    thread::Builder::new()
        .name("rti".to_owned())
        .spawn(run)
        .map_err(|error| Error::new(format!("cannot start the RTI: {error}")))?;
    // Before any federate is started, which would be refused the same.
    let allowed = is_entered.recv().expect("the thread says so first of all");
    allowed.map_err(|failure| Error::from(&failure))?;
    Ok((handle, address))
}

/// The processes of the federation and its RTI.
struct Launched {
    children: Children,
    rti: RtiHandle,
}

impl Driver for Launched {
    fn observe(&mut self, event: Observation, has_not_failed: bool) -> Observation {
        if let Observation::Ended { federate, how } = &event {
            self.children.reap(*federate, *how == FederateEnding::Code(0) && has_not_failed);
        }
        event
    }

    fn carry_out(&mut self, order: Order) {
        match order {
            Order::RequestStop => self.rti.request_stop(),
            Order::Send { signal, to } => self.children.send(signal, to),
            Order::Report(report) => Error::from(*report).show(),
            Order::Warn(report) => Error::from(*report).show_as_warning(),
        }
    }
}
