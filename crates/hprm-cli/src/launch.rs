//! Running a federation of Python federates on this machine: what the launcher of the library does not know.
//!
//! These are the command lines, the surroundings of the processes, and where others find a federation with
//! transient federates.

use std::ffi::OsString;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

use hprm::Descriptions;
use hprm::launch::{Launch, Launching, Membership};
use hprm::recorder::TraceRequest;
use hprm::supervisor::Advice;
use hprm::{
    Failure, FederationId, HangTimeout, Report, STAGE, Security, THROUGH_AGENT, random_bytes,
    random_federation,
};
use hprm_core::FederateId;
use hprm_model::Compiled;

use crate::args::{PYTHON, Properties};
use crate::launcher::{self, Commands};
use crate::message::{self, Error};
use crate::registry::{self, Entry, Record};
use crate::remote::{Errands, Places};
use crate::{executable, python, signals, trace};

/// Where a process finds the secret of its federation. On the command line, all users could see it.
pub(crate) const FEDERATION_ID: &str = "HPRM_FEDERATION_ID";

/// Where a federate that another one starts finds the target properties that override the program's, one
/// a line.
pub(crate) const PROPERTIES: &str = "HPRM_PROPERTIES";

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
    pub(crate) trace: Option<TraceRequest>,
    /// Where the files of the program lie side by side, if not beside it.
    pub(crate) stage: Option<PathBuf>,
    pub(crate) security: Security,
    /// Federates that are to run on other machines.
    pub(crate) places: Option<Places>,
}

/// Runs a federation to its end, and returns the exit code.
///
/// # Errors
///
/// If it cannot be started; nothing is left of it then.
pub(crate) fn launch(compiled: &Compiled, plan: &Plan) -> Result<i32, Error> {
    let program = &compiled.program;
    let federation = random_federation()?;
    let places = plan.places.as_ref();
    let elsewhere = places.map(|places| places.listener(random_name())).into_iter();
    let launching = Launch {
        program: Arc::clone(program),
        fingerprint: Arc::new(compiled.fingerprint()),
        federation,
        also_listen: elsewhere.clone().collect(),
        security: plan.security.clone(),
        join_timeout: plan.join_timeout,
        hang_timeout: plan.hang_timeout,
        debugged: plan.debugged,
        logical_trace: plan.logical_trace.clone(),
        trace: plan.trace.clone(),
        advice: Advice::COMMAND,
    }
    .start()?;
    signals::outlive()?;
    let is_transient = program.federates.values().any(|federate| federate.transient);
    let visible = || Visible::new(plan, &launching, federation);
    let _visible = is_transient.then(visible).transpose()?;
    let descriptions = Descriptions::of(compiled).map_err(|error| {
        Error::new(format!("cannot hand the declarations of executables to federates: {error}"))
    })?;
    let mut errands = elsewhere.map(|rti| Errands::new(compiled, &plan.file, rti.to_string()));
    let errands = errands.next().transpose()?;
    let command = |membership: &Membership<'_>| {
        if let Some((places, errands)) = places.zip(errands.as_ref())
            && let Some(machine) = places.machine_of(membership.federate)
        {
            let where_to = (membership, machine);
            let command = errands.command((plan, places), where_to, federation);
            return command.map_err(|error| Failure::command(error.report().message.clone()));
        }
        let meeting = (federation, &plan.security);
        if let Some(command) = executable::launched(compiled, membership, meeting)? {
            return Ok(command);
        }
        let mut command = plan.command(membership, federation);
        descriptions.iter().for_each(|known| known.hand_to(&mut command));
        Ok(command)
    };
    let mut tell = |label, report: Report| {
        let known = errands.iter().fold(report, |report, errands| errands.explained(report));
        message::tell(label, known);
    };
    Ok(launching.run(command, &mut tell)?)
}

/// A name that no other listener of this machine has.
fn random_name() -> String {
    format!("run-{:016x}", random_bytes().map(u64::from_le_bytes).unwrap_or_default())
}

/// That the transient federates of a running federation can be started again by others, for as long as this lives: by
/// the commands of Lingua Franca, and by name from anywhere.
struct Visible {
    entry: Option<Entry>,
    commands: Option<Commands>,
}

impl Visible {
    fn new(plan: &Plan, launching: &Launching, federation: FederationId) -> Result<Self, Error> {
        let (file, program) = (&plan.file, launching.program());
        // Without this, of two federations of the program that start at once, both made the commands, or none.
        let _alone = registry::alone();
        let is_left = registry::sweep(file);
        let others = registry::of_program(file);
        let inherits = is_left || others.iter().any(|other| other.made);
        let commands = launcher::write(program, file, inherits)?;
        let properties = plan.properties.stated();
        let mut record = Record::new(file, launching.rti(), federation, properties, &plan.python);
        record.made = !commands.is_empty();
        record.shares = launching.shares().map(|shares| (shares.file, shares.trace));
        // The program itself runs without.
        let entry = registry::enter(&record).map_err(|error| {
            error
                .hint("other processes find the federation by --rti and --federation only")
                .show_as_warning();
        });
        Ok(Self { entry: entry.ok(), commands: Some(commands) })
    }
}

impl Drop for Visible {
    fn drop(&mut self) {
        let _alone = registry::alone();
        // In this order: the commands look whether another federation needs them.
        self.entry.take();
        self.commands.take();
    }
}

impl Plan {
    fn command(&self, membership: &Membership<'_>, federation: FederationId) -> Command {
        let mut command = python::module(&self.python, "federate");
        command.arg("--rti").arg(membership.rti.to_string());
        command.args(membership.share.iter().flat_map(trace::share_options));
        command.args(self.properties.options());
        // It leaves the words on its failure to this process, and never outlives it.
        if self.places.is_some() {
            command.arg("--advertise").arg(THROUGH_AGENT);
        }
        command.arg("--launched");
        command.arg("--die-with-parent").arg(std::process::id().to_string());
        command.arg("--").arg(&self.file).arg(membership.name).args(&self.arguments);
        if self.debugged != Some(membership.federate) {
            command.stdin(Stdio::null());
        }
        command.env(FEDERATION_ID, federation.to_string());
        if let Some(stage) = &self.stage {
            command.env(STAGE, stage);
        }
        command.env(PROPERTIES, self.properties.stated().join("\n"));
        command.env(PYTHON, &self.python);
        command
    }
}
