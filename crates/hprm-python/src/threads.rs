//! Running a federation in this process: a thread for each federate, and one for the RTI.
//!
//! The main thread looks after them: it alone gets Ctrl-C. What is to be done is up to the
//! [`Supervisor`], as for a federation of processes.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;
use std::time::{Duration, Instant};

use hprm::supervisor::{FederateEnding, Members, Observation, Order, Signal, Supervisor};
use hprm::{
    Address, Clock, Failure, FederateOptions, FederationId, Inbox, Kind, Label, Patience, Reach,
    Report, RtiHandle, RtiOptions, Security, ValueExchange, nanoseconds,
};
use hprm_core::Scope;
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

/// Runs a federation in this process to its end. Returns the exit code.
///
/// Each of the `properties` is a target property, `KEY=VALUE`, that overrides the program's. Each
/// federate writes its share of the logical trace to a file of its name in the folder
/// `logical_traces`. If they are not all loaded within `join_timeout` seconds, that is a failure.
#[pyfunction]
#[pyo3(signature = (path, properties = vec![], *, logical_traces = None, join_timeout = None))]
pub(crate) fn run_in_process(
    py: Python<'_>,
    path: &str,
    properties: Vec<String>,
    logical_traces: Option<PathBuf>,
    join_timeout: Option<f64>,
) -> i32 {
    let outcome = compile(path, &properties, true).and_then(|compiled| {
        hprm::log_to_stderr(true)?;
        let limit = join_timeout.map_or(Ok(Duration::MAX), Duration::try_from_secs_f64);
        let limit = limit.map_err(|error| Failure::option(format!("--join-timeout: {error}")))?;
        let (compiled, wakeups) = (Arc::new(compiled), inbox()?);
        let raised = |error| failure_in(py, error, "starting the federates");
        share_streams(py, &compiled).map_err(raised)?;
        let interrupt = Interrupt::install(py, Scope::Whole, wakeups.wakeup()).map_err(raised)?;
        let outcome = start(&compiled, &wakeups, logical_traces.as_deref(), limit)
            .map(|watch| watch.run(py, interrupt.get()));
        interrupt.get().end();
        interrupt.get().release(py);
        let Outcome { code, is_traced } = outcome?;
        if let Some(folder) = logical_traces.filter(|_| !is_traced) {
            // One share is missing, so the others are of no use. The caller looks for what is left.
            let _ = std::fs::remove_dir_all(folder);
        }
        Ok(code)
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

/// Reports events to the main thread.
#[derive(Clone)]
struct Reporter {
    events: Sender<Observation>,
    wakeups: Inbox<Value>,
}

impl Reporter {
    fn tell(&self, event: Observation) {
        // The receiver is gone once the process is about to end.
        let _ = self.events.send(event);
        self.wakeups.notify();
    }
}

fn start(
    compiled: &Arc<Compiled>,
    wakeups: &Inbox<Value>,
    logical_traces: Option<&Path>,
    join_timeout: Duration,
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
    let supervisor = Supervisor::new(program, Members::Threads, join_timeout);
    let watch = Watch { supervisor, arrivals, wakeups: wakeups.clone(), rti: rti.handle() };
    let reports = reporter.clone();
    let asked = Arc::clone(program);
    spawn("rti", move || {
        // The federates ask for the same, and say so if it is refused.
        let _ = hprm::enter_realtime(&asked.properties, None);
        let outcome = rti.run(|event| reports.tell(Observation::Rti(event)));
        reports.tell(Observation::RtiEnded(outcome));
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
            let how = ending(&compiled.program.federates[id].name, catch_unwind(run));
            reports.tell(Observation::Ended { federate: id, how });
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

/// How a federate has ended whose thread has come to this, or has panicked.
fn ending(name: &str, outcome: thread::Result<Result<(), Failure>>) -> FederateEnding {
    let report = match outcome {
        Ok(Ok(())) => return FederateEnding::Code(0),
        Ok(Err(failure @ Failure::Interrupted { .. })) => {
            return FederateEnding::Code(failure.exit_code());
        }
        // It names the one that has failed.
        Ok(Err(Failure::Abandoned(report))) => *report,
        Ok(Err(failure)) => failure.report().of(name),
        Err(_) => Report::new(Kind::Lost, "its thread panicked, which is a bug").of(name),
    };
    FederateEnding::Failed(Box::new(report))
}

/// How a federation has ended.
struct Outcome {
    code: i32,
    /// Whether no federate has failed because it could not write its share of the logical trace.
    is_traced: bool,
}

/// The loop of the main thread: it brings events to the supervisor, and carries out its orders.
struct Watch {
    supervisor: Supervisor,
    arrivals: Receiver<Observation>,
    wakeups: Inbox<Value>,
    rti: RtiHandle,
}

impl Watch {
    /// Waits until all has ended, or must.
    fn run(mut self, py: Python<'_>, interrupt: &Interrupt) -> Outcome {
        let launched = Instant::now();
        let mut is_traced = true;
        loop {
            while let Ok(event) = self.arrivals.try_recv() {
                self.supervisor.handle(launched.elapsed(), event);
            }
            if interrupt.take(py) {
                let signal = Observation::Signal(Signal(interrupt.signal()));
                self.supervisor.handle(launched.elapsed(), signal);
            }
            let now = launched.elapsed();
            self.supervisor.tick(now);
            while let Some(order) = self.supervisor.poll() {
                is_traced &= !matches!(&order, Order::Report(report) if report.kind == Kind::Trace);
                self.carry_out(order);
            }
            if let Some(code) = self.supervisor.outcome(now) {
                return Outcome { code, is_traced };
            }
            let patience = self.supervisor.next_wakeup(now).map(|at| at.saturating_sub(now));
            let until = patience.map(|patience| Clock::now().plus(nanoseconds(patience)));
            let wakeups = &self.wakeups;
            py.detach(|| wakeups.sleep(until));
        }
    }

    fn carry_out(&self, order: Order) {
        match order {
            Order::RequestStop => self.rti.request_stop(),
            Order::Report(report) => show(&report),
            Order::Warn(report) => say(&report.text(Label::Warning, false)),
            Order::Send { .. } => unreachable!("no thread can be sent a signal"),
        }
    }
}
