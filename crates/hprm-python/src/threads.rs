//! Running a federation in this process: a thread for each federate, and one for the RTI.
//!
//! The main thread looks after them: it alone gets Ctrl-C. It reports the first failure, once, and
//! lets the others end in order; threads that do not end by themselves end with the process.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;

use hprm::{
    Address, Clock, Failure, FederateOptions, Inbox, Kind, Reach, Report, RtiEvent, RtiHandle,
    RtiOptions, Security, ValueExchange,
};
use hprm::{FederationId, Patience};
use hprm_core::{FederateId, Nanos, PhysicalTime, Scope};
use hprm_lf::Compiled;
use pyo3::prelude::*;

use crate::console::{say, show};
use crate::failure::failure_in;
use crate::interrupt::Interrupt;
use crate::load::load;
use crate::run::{compile, exit_code, inbox};
use crate::thread::belong_to;
use crate::value::Value;

/// As much as the main thread has on most systems: Python code recurses.
const STACK: usize = 8 << 20;

/// How long the others may take to end after a failure.
const AFTER_FAILURE: Nanos = 2_000_000_000;
/// How long an orderly stop may take.
const AFTER_INTERRUPT: Nanos = 5_000_000_000;

const SECOND: Nanos = 1_000_000_000;

/// Runs a federation in this process to its end. Returns the exit code.
///
/// Each of the `properties` is a target property, `KEY=VALUE`, that overrides the program's. Each
/// federate writes its share of the logical trace to a file of its name in the folder
/// `logical_traces`.
#[pyfunction]
#[pyo3(signature = (path, properties = vec![], *, logical_traces = None))]
pub(crate) fn run_in_process(
    py: Python<'_>,
    path: &str,
    properties: Vec<String>,
    logical_traces: Option<PathBuf>,
) -> i32 {
    let outcome = compile(path, &properties, true).and_then(|compiled| {
        let (compiled, wakeups) = (Arc::new(compiled), inbox()?);
        let raised = |error| failure_in(py, error, "starting the federates");
        share_streams(py, &compiled).map_err(raised)?;
        let interrupt = Interrupt::install(py, Scope::Whole, wakeups.wakeup()).map_err(raised)?;
        let code = start(&compiled, &wakeups, logical_traces.as_deref())
            .map(|watch| watch.run(py, interrupt.get()));
        interrupt.get().end();
        interrupt.get().release(py);
        code
    });
    outcome.unwrap_or_else(|failure| exit_code(&Err(failure)))
}

/// Has what a federate prints start with its name.
fn share_streams(py: Python<'_>, compiled: &Compiled) -> PyResult<()> {
    let federates = compiled.program.federates.iter();
    let names: Vec<_> = federates.map(|(id, federate)| (id.0, federate.name.as_str())).collect();
    py.import("hprm._threads")?.call_method1("begin", (names,))?;
    Ok(())
}

/// What the threads report to the main thread.
enum ThreadEvent {
    Rti(RtiEvent),
    RtiEnded(Result<(), Failure>),
    /// A federate has ended, or its thread has panicked.
    Ended(FederateId, Result<Result<(), Failure>, Box<dyn Any + Send>>),
}

/// Reports events to the main thread.
#[derive(Clone)]
struct Reporter {
    events: Sender<ThreadEvent>,
    wakeups: Inbox<Value>,
}

impl Reporter {
    fn tell(&self, event: ThreadEvent) {
        // The receiver is gone once the process is about to end.
        let _ = self.events.send(event);
        self.wakeups.notify();
    }
}

fn start(
    compiled: &Arc<Compiled>,
    wakeups: &Inbox<Value>,
    logical_traces: Option<&Path>,
) -> Result<Watch, Failure> {
    let program = &compiled.program;
    if !program.is_federated() {
        let message = format!("{} is not federated, so it has no federates", program.name);
        return Err(Failure::option(message));
    }
    if let Some(federate) = program.federates.values().find(|federate| federate.transient) {
        let message = format!(
            "federate {} is transient, and needs a process of its own to come and go",
            federate.name
        );
        return Err(Failure::Option {
            message,
            hint: Some("run the program without --in-process"),
        });
    }
    let (events, arrivals) = channel();
    let reporter = Reporter { events, wakeups: wakeups.clone() };
    let exchange = ValueExchange::new();
    let fingerprint = Arc::new(program.fingerprint());
    let listen: Address = "unix:@rti".parse().expect("an abstract name is an address");
    let options = RtiOptions {
        program: Arc::clone(program),
        fingerprint: Arc::clone(&fingerprint),
        // It keeps other processes out, and no other process can reach these links.
        federation: FederationId(0),
        listen: listen.clone(),
        also_listen: Vec::new(),
        security: Security::default(),
        patience: Patience::default(),
    };
    let rti = exchange.rti(&options)?;
    let watch = Watch::new(compiled, arrivals, wakeups.clone(), rti.handle());
    let reports = reporter.clone();
    let asked = Arc::clone(program);
    spawn("rti", move || {
        // The federates ask for the same, and say so if it is refused.
        let _ = hprm::enter_realtime(&asked.properties, None);
        let outcome = rti.run(|event| reports.tell(ThreadEvent::Rti(event)));
        reports.tell(ThreadEvent::RtiEnded(outcome));
    })?;
    for (id, federate) in program.federates.iter() {
        let options = FederateOptions {
            program: Arc::clone(program),
            fingerprint: Arc::clone(&fingerprint),
            federate: id,
            rti: listen.clone(),
            federation: options.federation,
            security: Security::default(),
            reach: Reach::default(),
            store: hprm::store_limits(compiled.settings.store),
            trace: logical_traces.map(|folder| folder.join(&federate.name)),
        };
        let (compiled, exchange, reports) =
            (Arc::clone(compiled), exchange.clone(), reporter.clone());
        spawn(&federate.name, move || {
            let run = AssertUnwindSafe(|| run_federate(&compiled, &options, &exchange));
            reports.tell(ThreadEvent::Ended(id, catch_unwind(run)));
        })?;
    }
    Ok(watch)
}

fn spawn(name: &str, run: impl FnOnce() + Send + 'static) -> Result<(), Failure> {
    let builder = thread::Builder::new().name(name.to_owned()).stack_size(STACK);
    let spawned = builder.spawn(run);
    spawned.map_err(|error| Failure::system("cannot start a thread", &error))?;
    Ok(())
}

fn run_federate(
    compiled: &Compiled,
    options: &FederateOptions,
    exchange: &ValueExchange<Value>,
) -> Result<(), Failure> {
    belong_to(options.federate);
    let inbox = inbox()?;
    // Known to the interpreter all the time, so that it keeps what is the thread's, but with its lock
    // only where there is Python code to run: the loop itself does not stop other threads.
    Python::attach(|py| {
        py.detach(|| {
            hprm::run_federate_in(options, exchange, &inbox, || {
                let scope = Scope::Federate(options.federate);
                Python::attach(|py| load(py, compiled, scope, &inbox))
            })
        })
    })
}

/// The state of the federation, as the main thread knows it.
struct Watch {
    compiled: Arc<Compiled>,
    arrivals: Receiver<ThreadEvent>,
    wakeups: Inbox<Value>,
    rti: RtiHandle,
    /// The federates that have not ended.
    running: Vec<FederateId>,
    started: bool,
    rti_ended: bool,
    /// Set by the first failure, or by Ctrl-C.
    code: Option<i32>,
    reported: bool,
    /// The first federate that has failed, of which the RTI may not know.
    suspect: Option<(FederateId, Failure)>,
    /// When the process ends, also if threads have not ended.
    until: Option<PhysicalTime>,
}

impl Watch {
    fn new(
        compiled: &Arc<Compiled>,
        arrivals: Receiver<ThreadEvent>,
        wakeups: Inbox<Value>,
        rti: RtiHandle,
    ) -> Self {
        Self {
            compiled: Arc::clone(compiled),
            arrivals,
            wakeups,
            rti,
            running: compiled.program.federates.ids().collect(),
            started: false,
            rti_ended: false,
            code: None,
            reported: false,
            suspect: None,
            until: None,
        }
    }

    /// Waits until all has ended, or must. Returns the exit code.
    fn run(mut self, py: Python<'_>, interrupt: &Interrupt) -> i32 {
        loop {
            while let Ok(event) = self.arrivals.try_recv() {
                self.hear(event);
            }
            if interrupt.take(py) {
                let code = Failure::Interrupted { signal: interrupt.signal() }.exit_code();
                if self.code.is_some() || !self.started {
                    return code;
                }
                self.code = Some(code);
                self.until = Some(Clock::now().plus(AFTER_INTERRUPT));
                self.rti.request_stop();
            }
            if self.running.is_empty() && self.rti_ended {
                self.accuse();
                return self.code.unwrap_or(0);
            }
            if self.until.is_some_and(|until| Clock::now() >= until) {
                self.accuse();
                let names: Vec<_> = self.running.iter().map(|id| self.name(*id)).collect();
                if !names.is_empty() {
                    say(&format!("warning: did not end by itself: {}", names.join(", ")));
                }
                return self.code.unwrap_or(1);
            }
            let (wakeups, until) = (&self.wakeups, self.until);
            py.detach(|| wakeups.sleep(until));
        }
    }

    fn hear(&mut self, event: ThreadEvent) {
        match event {
            ThreadEvent::Rti(RtiEvent::Started(_)) => self.started = true,
            ThreadEvent::Rti(RtiEvent::Silent { federate, silence }) => {
                let (name, seconds) = (self.name(federate), silence / SECOND);
                say(&format!("warning: federate {name} has not answered for {seconds} s"));
            }
            ThreadEvent::Rti(RtiEvent::Answers { federate, .. }) => {
                say(&format!("warning: federate {} answers again", self.name(federate)));
            }
            // None is transient.
            ThreadEvent::Rti(
                RtiEvent::Dropped { report, .. } | RtiEvent::Failed { report, .. },
            ) => {
                self.fail(report.named());
            }
            // No process can join this federation.
            ThreadEvent::Rti(
                RtiEvent::Joined(_) | RtiEvent::Left(_) | RtiEvent::Refused { .. },
            ) => {}
            ThreadEvent::RtiEnded(outcome) => {
                self.rti_ended = true;
                if let Err(failure) = outcome {
                    self.fail(failure.report());
                }
            }
            ThreadEvent::Ended(federate, outcome) => {
                self.running.retain(|running| *running != federate);
                match outcome {
                    Ok(Ok(())) => {}
                    // The RTI, which knows which failure was first, has been told or soon notices.
                    Ok(Err(failure)) => {
                        self.until.get_or_insert_with(|| Clock::now().plus(AFTER_FAILURE));
                        self.suspect.get_or_insert((federate, failure));
                    }
                    Err(_) => {
                        let report = Report::new(
                            Kind::Lost,
                            format!(
                                "federate {}: its thread panicked, which is a bug",
                                self.name(federate)
                            ),
                        );
                        self.fail(report.of(self.name(federate)));
                    }
                }
            }
        }
    }

    /// Reports the failure of a federate if the RTI has reported none.
    fn accuse(&mut self) {
        if let Some((federate, failure)) = self.suspect.take().filter(|_| self.code.is_none()) {
            let report = failure.report();
            let report = match failure {
                // It names the one that has failed.
                Failure::Abandoned(_) => report,
                _ => report.of(self.name(federate)),
            };
            self.fail(report.named());
        }
    }

    /// The first failure decides; what it leads to is not told.
    fn fail(&mut self, report: Report) {
        self.until.get_or_insert_with(|| Clock::now().plus(AFTER_FAILURE));
        self.code.get_or_insert(hprm::exit_code(report.code));
        if !self.reported {
            self.reported = true;
            show(&report);
        }
    }

    fn name(&self, federate: FederateId) -> &str {
        &self.compiled.program.federates[federate].name
    }
}
