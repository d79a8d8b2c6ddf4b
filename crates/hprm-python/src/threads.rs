//! Running a federation in this process: a thread for each federate, and one for the RTI.
//!
//! The main thread looks after them, without the interpreter's lock, which a body may never release. What is to
//! be done is up to the [`Supervisor`], as for a federation of processes.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;
use std::time::Duration;

use hprm::recorder::TraceRequest;
use hprm::supervisor::{Driver, FederateEnding, Members, Observation, Order, Outcome, Supervisor};
use hprm::trace::TraceShare;
use hprm::{
    Address, Failure, FederateOptions, HangTimeout, Kind, Label, Reach, Report, RtiEvent,
    RtiHandle, RtiOptions, Security, ValueExchange, nanoseconds,
};
use hprm_core::{Program, Scope};
use hprm_model::Compiled;
use pyo3::prelude::*;

use crate::checked::Checked;
use crate::console::{report_output_to, say, show};
use crate::failure::failure_in;
use crate::forced_end;
use crate::interrupt::{Handled, Interrupt};
use crate::load::{Care, load, not_here};
use crate::run::{exit_code, inbox};
use crate::signals;
use crate::stalls;
use crate::thread::belong_to;
use crate::value::Value;

/// As much as the main thread has on most systems: Python code recurses.
const STACK: usize = 8 << 20;

/// How long the main thread may take to get the interpreter back, when federates have not ended.
const ATTACHING: Duration = Duration::from_secs(1);
/// How long the end of the process may take after that.
const ENDING: Duration = Duration::from_secs(2);

/// Runs a federation in this process to its end. Returns the exit code.
///
/// Each of the `properties` is a target property, `KEY=VALUE`, that overrides the program's. Each
/// federate writes its share of the logical trace to a file of its name in the folder
/// `logical_traces`; the user calls the trace `share_of`. It is a failure if they are not all loaded within `join_timeout` seconds, or if one does not
/// answer for `hang_timeout` seconds.
#[pyfunction]
#[pyo3(signature = (
    path, properties = vec![], *, logical_traces = None, share_of = None, join_timeout = None,
    hang_timeout = None
))]
pub(crate) fn run_in_process(
    py: Python<'_>,
    path: &str,
    properties: Vec<String>,
    logical_traces: Option<PathBuf>,
    share_of: Option<PathBuf>,
    join_timeout: Option<f64>,
    hang_timeout: Option<f64>,
) -> i32 {
    let outcome = Checked::load(py, path, &properties).and_then(|checked| {
        checked.show_warnings(py);
        hprm::log_to_stderr(true)?;
        let join_timeout = limit("--join-timeout", join_timeout)?.unwrap_or(Duration::MAX);
        let silence = limit("--hang-timeout", hang_timeout)?.map(nanoseconds);
        let checked = Arc::new(checked);
        let raised = |error| failure_in(py, error, "starting the federates");
        share_streams(py, &checked.compiled).map_err(raised)?;
        let (events, arrivals) = channel();
        report_output_to(Some(events.clone()));
        let signals = events.clone();
        let interrupt = Interrupt::install(py, Handled::All, |_| signals::forward(signals));
        let interrupt = interrupt.map_err(raised)?;
        let hang_timeout = HangTimeout { limit: silence };
        let plan = Plan { checked, join_timeout, hang_timeout, logical_traces, share_of };
        let run = move || plan.start(&events).map(|rti| plan.watch(&rti, &arrivals));
        let ended = py.detach(run);
        report_output_to(None);
        interrupt.get().end();
        interrupt.get().release(py);
        ended.map(Ended::attach)
    });
    outcome.unwrap_or_else(|failure| exit_code(&Err(failure)))
}

fn limit(option: &str, seconds: Option<f64>) -> Result<Option<Duration>, Failure> {
    let limit = seconds.map(Duration::try_from_secs_f64).transpose();
    limit.map_err(|error| Failure::option(format!("{option}: {error}")))
}

/// Has what a federate prints start with its name.
fn share_streams(py: Python<'_>, compiled: &Compiled) -> PyResult<()> {
    let federates = compiled.program.federates.iter();
    let names: Vec<_> = federates.map(|(id, federate)| (id.0, federate.name.as_str())).collect();
    py.import("hprm._threads")?.call_method1("begin", (names,))?;
    Ok(())
}

/// What is to be run, and how.
struct Plan {
    checked: Arc<Checked>,
    join_timeout: Duration,
    hang_timeout: HangTimeout,
    logical_traces: Option<PathBuf>,
    /// The trace that is made of them, as the user calls it.
    share_of: Option<PathBuf>,
}

impl Plan {
    /// Starts the RTI and the federates. What becomes of them is reported to `events`.
    fn start(&self, events: &Sender<Observation>) -> Result<RtiHandle, Failure> {
        let Checked { compiled, .. } = &*self.checked;
        let program = &compiled.program;
        check(program)?;
        if let Some(federate) = compiled.executables.keys().next() {
            return Err(not_here(&program.federates[*federate].name));
        }
        let exchange = ValueExchange::new();
        let fingerprint = Arc::new(program.fingerprint());
        let listen: Address = "unix:@rti".parse().expect("an abstract name is an address");
        let options = RtiOptions {
            program: Arc::clone(program),
            fingerprint: Arc::clone(&fingerprint),
            // No other process can reach these links, but what watches federations tells them apart by it.
            federation: hprm::random_federation()?,
            listen: listen.clone(),
            also_listen: Vec::new(),
            security: Security::default(),
            hang_timeout: self.hang_timeout,
        };
        let record = TraceRequest::of_this_process();
        let rti = exchange.rti(&options)?.recorded(record.as_ref())?;
        let handle = rti.handle();
        let reports = events.clone();
        let asked = Arc::clone(program);
        // The receiver of reports is gone once the process is about to end.
        spawn("rti", move || {
            // The federates ask for the same, and say so if it is refused.
            let _ = hprm::enter_realtime(&asked.properties, None);
            let outcome = rti.run(|event| drop(reports.send(Observation::Rti(event))));
            let _ = reports.send(Observation::RtiEnded(outcome));
        })?;
        for (id, federate) in program.federates.iter() {
            let traces = self.logical_traces.as_ref();
            let options = FederateOptions {
                program: Arc::clone(program),
                fingerprint: Arc::clone(&fingerprint),
                federate: id,
                rti: listen.clone(),
                federation: options.federation,
                security: Security::default(),
                reach: Reach::default(),
                store: hprm::store_limits(compiled.settings.store),
                trace: traces.map(|folder| {
                    TraceShare::new(folder.join(&federate.name), self.share_of.clone())
                }),
                record: record.clone(),
                launched: true,
                end_process: None,
            };
            let (checked, exchange) = (Arc::clone(&self.checked), exchange.clone());
            let reports = events.clone();
            spawn(&federate.name, move || {
                let run = AssertUnwindSafe(|| run_federate(&checked, &options, &exchange));
                let how = ending(&options.program.federates[id].name, catch_unwind(run));
                let _ = reports.send(Observation::Ended { federate: id, how });
            })?;
        }
        Ok(handle)
    }

    /// Looks after them until all have ended, or must. Brings events to the supervisor, and carries out its
    /// orders.
    fn watch(&self, rti: &RtiHandle, arrivals: &Receiver<Observation>) -> Ended {
        let program = &self.checked.compiled.program;
        let mut supervisor = Supervisor::new(program, Members::Threads, self.join_timeout);
        let mut launched = Launched { program, rti };
        let Outcome { code, is_traced } = supervisor.run(&mut launched, arrivals);
        if let Some(folder) = self.logical_traces.as_ref().filter(|_| !is_traced) {
            // One share is missing, so the others are of no use. The caller looks for what is left.
            let _ = std::fs::remove_dir_all(folder);
        }
        Ended::new(code, supervisor.all_ended())
    }
}

/// The federates, which are threads, and their RTI.
struct Launched<'a> {
    program: &'a Program,
    rti: &'a RtiHandle,
}

impl Driver for Launched<'_> {
    fn observe(&mut self, event: Observation, _has_not_failed: bool) -> Observation {
        blame_the_holder(self.program, event)
    }

    fn carry_out(&mut self, order: Order) {
        match order {
            Order::RequestStop => self.rti.request_stop(),
            Order::Report(report) => show(&report),
            Order::Warn(report) => say(&report.text(Label::Warning, false)),
            Order::Send { .. } => unreachable!("no thread can be sent a signal"),
            Order::Start(_) => unreachable!("no thread is transient"),
        }
    }
}

/// All federates need the interpreter, which one of them may hold. Those that wait for it do not answer
/// either, so a report about one of them is a report about the one that runs.
fn blame_the_holder(program: &Program, event: Observation) -> Observation {
    let Observation::Rti(RtiEvent::Failed { federate, mut report }) = event else { return event };
    let running = stalls::running_federates();
    if report.kind != Kind::Lost || running.contains(&federate) {
        return Observation::Rti(RtiEvent::Failed { federate, report });
    }
    let holder = running.first().copied().unwrap_or(federate);
    let [said, meant] = [federate, holder].map(|id| &program.federates[id].name);
    let names = [said, meant].map(|name| format!("federate {name} "));
    report.message = report.message.replacen(&names[0], &names[1], 1);
    Observation::Rti(RtiEvent::Failed { federate: holder, report: report.of(meant) })
}

fn check(program: &Program) -> Result<(), Failure> {
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
    Ok(())
}

fn spawn(name: &str, run: impl FnOnce() + Send + 'static) -> Result<(), Failure> {
    let builder = thread::Builder::new().name(name.to_owned()).stack_size(STACK);
    let spawned = builder.spawn(run);
    spawned.map_err(|error| Failure::system("cannot start a thread", &error))?;
    Ok(())
}

fn run_federate(
    Checked { compiled, declared }: &Checked,
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
                Python::attach(|py| {
                    let declared = declared.as_ref().map(|declared| declared.of_federate(py));
                    let declared = declared.transpose()?;
                    load(py, (compiled, declared.as_ref()), scope, &inbox, Care::Launcher)
                })
            })
        })
    })
}

/// How a federate has ended whose thread has come to this, or has panicked.
fn ending(name: &str, outcome: thread::Result<Result<(), Failure>>) -> FederateEnding {
    let report = match outcome {
        Ok(Ok(())) => return FederateEnding::Code(0),
        Ok(Err(failure @ Failure::Interrupted { .. })) => {
            return FederateEnding::Code(failure.exit_code());
        }
        // It names the one that has failed.
        Ok(Err(Failure::OtherFederateFailed(report))) => *report,
        Ok(Err(failure)) => failure.report().of(name),
        Err(_) => Report::new(Kind::Lost, "its thread panicked, which is a bug").of(name),
    };
    FederateEnding::Failed(Box::new(report))
}

/// The end of a federation, which may have left threads behind that run code of the program.
struct Ended {
    code: i32,
    /// Whether the main thread has the interpreter again.
    is_attached: Arc<AtomicBool>,
}

impl Ended {
    /// Unless `all` threads have ended, the process ends in time whatever they do: they may hold the interpreter,
    /// which the main thread needs in order to end the process as Python does.
    fn new(code: i32, all: bool) -> Self {
        let is_attached = Arc::new(AtomicBool::new(false));
        if !all {
            stalls::report_all();
            let attached = Arc::clone(&is_attached);
            let guard = move || {
                thread::sleep(ATTACHING);
                if attached.load(Ordering::Relaxed) {
                    thread::sleep(ENDING);
                }
                forced_end::end(code)
            };
            if spawn("end", guard).is_err() {
                forced_end::end(code);
            }
        }
        Self { code, is_attached }
    }

    fn attach(self) -> i32 {
        self.is_attached.store(true, Ordering::Relaxed);
        self.code
    }
}
