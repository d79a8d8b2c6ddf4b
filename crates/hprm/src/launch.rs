//! Running a federation on this machine: an RTI in a thread, and a process for each federate.
//!
//! This is the loop around the [`Supervisor`]: it brings events and carries out orders. What a federate's
//! process is, and how reports are shown, is up to the caller. The thread that calls starts the processes,
//! because they ask the system to die with the thread that did ([`die_with_parent`]).

mod children;
mod follow;
mod group;
mod leftovers;
mod limits;
mod output;
mod parent;
mod rti;
pub mod signals;
mod terminal;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::Command;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;
use std::time::Duration;

use hprm_core::{FederateId, Fingerprint, Program};

use self::children::{Children, Console};
use self::rti::RtiThread;
use self::signals::Watch;
use crate::recorder::{Shares, TRACE, TraceRequest};
use crate::supervisor::{
    Advice, Driver, FederateEnding, Members, Observation, Order, Outcome, Supervisor,
};
use crate::trace::{Parts, TraceShare};
use crate::{
    Address, Failure, FederationId, HangTimeout, Label, Report, RtiEvent, RtiHandle, Security,
};
pub use group::{GROUP_HOME, Group, GroupLimits};
pub(crate) use limits::{allow_boards, raise_for_federate};
pub use limits::{need_files, unstarted};
pub use parent::die_with_parent;
pub(crate) use signals::watch;

/// Events that may wait for the loop, which never takes long. More of them wait where they arise.
const EVENTS: usize = 64;

/// What is to be launched, and how.
#[derive(Clone, Debug)]
pub struct Launch {
    /// The program of the federation.
    pub program: Arc<Program>,
    /// The fingerprint that all federates must have.
    pub fingerprint: Arc<Fingerprint>,
    /// The secret of the federation, which its processes must be given in private.
    pub federation: FederationId,
    /// Where its RTI listens as well, for federates of other machines.
    pub also_listen: Vec<Address>,
    /// How its links are protected.
    pub security: Security,
    /// How long the federates may take to join and load.
    pub join_timeout: Duration,
    /// For how long a federate may be silent.
    pub hang_timeout: HangTimeout,
    /// The federate that gets the terminal.
    pub debugged: Option<FederateId>,
    /// The file of its logical trace, if it is recorded.
    pub logical_trace: Option<PathBuf>,
    /// The file of its trace, if the run is traced.
    pub trace: Option<TraceRequest>,
    /// What is advised if federates do not join, or do not answer.
    pub advice: Advice,
}

/// What the process of a federate must know of its federation, apart from the secret.
#[derive(Clone, Debug)]
pub struct Membership<'a> {
    /// The federate.
    pub federate: FederateId,
    /// Its name.
    pub name: &'a str,
    /// Where the RTI listens.
    pub rti: &'a Address,
    /// What it writes of the logical trace.
    pub share: Option<TraceShare>,
    /// How often it was started before.
    pub restarts: u32,
}

/// A federation whose RTI runs, and whose federates do not run yet. When this is dropped, nothing of it is
/// left, and signals do what they did before.
#[derive(Debug)]
pub struct Launching {
    launch: Launch,
    events: SyncSender<Observation>,
    // What follows goes away in this order: no thread waits for room among the events, no process writes to the
    // folder of shares that has gone, and Ctrl-C does not disturb all that.
    arrivals: Receiver<Observation>,
    rti: RtiThread,
    parts: Option<Parts>,
    shares: Option<Shares>,
    _watch: Watch,
}

impl Launch {
    /// Runs a federation to its end, and returns the exit code. `command` makes the command of the process of
    /// a federate; `tell` shows each report that the user should see, for example by
    /// [`console::show`](crate::console::show).
    ///
    /// # Errors
    ///
    /// If it cannot be started; nothing is left of it then. Or if its logical trace cannot be written.
    pub fn run(
        self,
        command: impl FnMut(&Membership<'_>) -> Result<Command, Failure>,
        tell: &mut dyn FnMut(Label, Report),
    ) -> Result<i32, Failure> {
        self.start()?.run(command, tell)
    }

    /// Starts the RTI. From now on, signals that ask this process to stop are for the federation ([`signals`]).
    ///
    /// # Errors
    ///
    /// If the RTI cannot be started, or this process may not have enough descriptors for all federates.
    pub fn start(self) -> Result<Launching, Failure> {
        limits::check_files(self.program.federates.len())?;
        let (events, receiver) = sync_channel(EVENTS);
        let asked = events.clone();
        let watch = watch(move |signal| asked.send(Observation::Signal(signal)).is_ok())
            .map_err(|error| Failure::command(format!("cannot watch for Ctrl-C: {error}")))?;
        // Dropped before the watch, which would wait for room among the events.
        let arrivals = receiver;
        let parts = self.logical_trace.as_deref().map(Parts::of).transpose()?;
        let wanted = self.trace.as_ref();
        let shares =
            wanted.map(|it| Shares::of(&it.path).map(|shares| shares.with_capacity(it.capacity)));
        let shares = shares.transpose()?;
        let request = shares.as_ref().map(Shares::request);
        let rti = RtiThread::start(&self, events.clone(), request.as_ref())?;
        Ok(Launching { launch: self, events, arrivals, rti, parts, shares, _watch: watch })
    }
}

impl Launching {
    /// Where the RTI listens.
    #[must_use]
    pub fn rti(&self) -> &Address {
        self.rti.address()
    }

    /// The program of the federation.
    #[must_use]
    pub fn program(&self) -> &Arc<Program> {
        &self.launch.program
    }

    /// Where processes that join write their shares of the logical trace, if it is recorded.
    #[must_use]
    pub fn shares(&self) -> Option<TraceShare> {
        self.parts.as_ref().map(Parts::shares)
    }

    /// Starts the federates, and runs the federation to its end, as [`Launch::run`] does.
    ///
    /// # Errors
    ///
    /// If a federate cannot be started, or the logical trace cannot be written.
    pub fn run(
        mut self,
        mut command: impl FnMut(&Membership<'_>) -> Result<Command, Failure>,
        tell: &mut dyn FnMut(Label, Report),
    ) -> Result<i32, Failure> {
        let program = Arc::clone(&self.launch.program);
        let children = self.start_federates(&mut command)?;
        let join_timeout = self.launch.join_timeout;
        let supervisor = Supervisor::new(&program, Members::Processes, join_timeout);
        let mut supervisor = supervisor.with_advice(self.launch.advice);
        if let Some(debugged) = self.launch.debugged {
            // Its user has ended it.
            supervisor.leave(debugged);
        }
        let started = Started { launching: &self, command: &mut command, again: BTreeMap::new() };
        let (rti, took_part) = (self.rti.handle().clone(), BTreeMap::new());
        let mut launched = Launched { children, rti, started, took_part, tell };
        let Outcome { code, is_traced } = supervisor.run(&mut launched, &self.arrivals);
        launched.rti.abort();
        let took_part = std::mem::take(&mut launched.took_part);
        drop(launched);
        // The RTI records as long as it runs. It may wait for room among the events.
        drop(self.arrivals);
        drop(self.rti);
        if let Some(report) = self.shares.take().map_or(Ok(None), Shares::merge)? {
            tell(Label::Warning, report);
        }
        if let Some(parts) = self.parts.take().filter(|_| is_traced) {
            let parts = parts.of_processes(took_part);
            parts.merge(&program, supervisor.is_interrupted(), code, tell)?;
        }
        Ok(code)
    }

    fn start_federates(&self, command: CommandOf<'_>) -> Result<Children, Failure> {
        let mut children = Children::default();
        let mut federates: Vec<_> = self.launch.program.federates.iter().collect();
        // First: the start does not wait for transient federates, and most programs want them to take part.
        federates.sort_by_key(|(_, federate)| !federate.transient);
        for (id, _) in federates {
            self.start_federate(id, 0, command, &mut children)?;
        }
        Ok(children)
    }

    /// Starts the process of a federate that was started so many times before.
    fn start_federate(
        &self,
        federate: FederateId,
        restarts: u32,
        command: CommandOf<'_>,
        children: &mut Children,
    ) -> Result<(), Failure> {
        let name = &self.launch.program.federates[federate].name;
        let share = self.parts.as_ref().map(|parts| parts.share(name, restarts));
        let membership = Membership { federate, name, rti: self.rti(), share, restarts };
        let mut command = command(&membership)?;
        if let Some(shares) = &self.shares {
            command.env(TRACE, shares.request().variable());
        }
        let is_debugged = self.launch.debugged == Some(federate);
        let console = if is_debugged { Console::Terminal } else { Console::Lines };
        let events = self.events.clone();
        // Once the receiver is gone, the run is over.
        let report = move |event| drop(events.send(event));
        children.start((federate, name), command, console, report)
    }
}

/// Makes the command of the process of a federate.
type CommandOf<'a> = &'a mut dyn FnMut(&Membership<'_>) -> Result<Command, Failure>;

/// What starts federates again.
struct Started<'a> {
    launching: &'a Launching,
    command: CommandOf<'a>,
    /// How often each was.
    again: BTreeMap<FederateId, u32>,
}

/// The processes of the federation and its RTI.
struct Launched<'a> {
    children: Children,
    rti: RtiHandle,
    started: Started<'a>,
    /// How many processes of each federate took part, also of those that others have started.
    took_part: BTreeMap<FederateId, u32>,
    tell: &'a mut dyn FnMut(Label, Report),
}

impl Launched<'_> {
    /// Starts a federate again. If that cannot be, its process has ended at once.
    fn start_again(&mut self, federate: FederateId) {
        let Started { launching, command, again } = &mut self.started;
        let restarts = again.entry(federate).or_default();
        *restarts += 1;
        self.rti.note_restart(federate);
        let started = launching.start_federate(federate, *restarts, command, &mut self.children);
        if let Err(failure) = started {
            let report = failure.report().of(&launching.launch.program.federates[federate].name);
            let how = FederateEnding::Failed(Box::new(report));
            // On a thread of its own: this one takes the events.
            let events = launching.events.clone();
            thread::spawn(move || drop(events.send(Observation::Ended { federate, how })));
        }
    }
}

impl Driver for Launched<'_> {
    fn observe(&mut self, event: Observation, has_not_failed: bool) -> Observation {
        match &event {
            Observation::Ended { federate, how } => {
                self.children.reap(*federate, *how == FederateEnding::Code(0) && has_not_failed);
            }
            Observation::Rti(RtiEvent::Loaded(federate) | RtiEvent::Entered(federate)) => {
                *self.took_part.entry(*federate).or_default() += 1;
            }
            _ => {}
        }
        event
    }

    fn carry_out(&mut self, order: Order) {
        match order {
            Order::RequestStop => self.rti.request_stop(),
            Order::Send { signal, to } => self.children.send(signal, to),
            Order::Start(federate) => self.start_again(federate),
            Order::Report(report) => (self.tell)(Label::Error, *report),
            Order::Warn(report) => (self.tell)(Label::Warning, *report),
        }
    }
}
