//! Reports reactions that do not return, and where in their code they are.
//!
//! One thread, the monitor, serves all programs of the process: it samples which reactions run. For that it
//! does not need the interpreter's lock. To show the stack of a reaction, a second thread asks for that lock.
//! If the reaction's thread never releases the lock, because it executes code that is not Python's, the
//! monitor sends it a signal, at which `faulthandler` writes the stack. Its thread stands still meanwhile, so
//! no lock is needed. An interpreter without a lock gets that signal at once. [`StallWatch`] decides which reactions are reported, and when.

use std::fs;
use std::mem;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::channel;
use std::sync::{Arc, LazyLock, Mutex, MutexGuard, PoisonError, Weak};
use std::thread;
use std::time::{Duration, Instant};

use hprm::{Failure, LongReaction, ReactionRun, Stall, StallWatch};
use hprm_core::{FederateId, Scope, show_time};
use nix::sys::pthread::{Pthread, pthread_kill};
use nix::sys::signal::Signal;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::console::say;
use crate::places::Places;
use crate::runtime::{Runtime, SampledRun};

/// What to do about a reaction that is meant to take long.
const HINT: &str = "\n  hint: it may be meant to take long, and is reported once; HPRM_LONG_REACTION=SECONDS says \
                    after which time, or off";

/// The longest time between two samples.
const PERIOD: Duration = Duration::from_millis(500);
/// How long to wait for the interpreter's lock. A loop in Python releases it after milliseconds.
const LOCK_TIMEOUT: Duration = Duration::from_secs(1);
/// How long to wait for the stack, once the lock has been obtained.
const STACK_TIMEOUT: Duration = Duration::from_secs(10);
/// How often, and how many times, to look whether `faulthandler` has written.
const LOOKS: (Duration, u32) = (Duration::from_millis(20), 25);

/// What runs bodies, and coroutines that are bodies; the same as in `hprm._stalls`.
const CALLERS: [&str; 4] = [
    "/hprm/__main__.py\"",
    "/hprm/_launching.py\"",
    "/hprm/testing.py\"",
    "/hprm/_coroutines.py\"",
];

/// A program, or a federate of one, that runs in this process.
struct Watched {
    runtime: Weak<Runtime>,
    places: Arc<Places>,
    /// Whether other federates run in this process.
    is_thread: bool,
}

struct Monitor {
    watch: StallWatch,
    programs: Vec<Watched>,
    /// The descriptor to which `faulthandler` writes stacks, if it can.
    dump: Option<i32>,
    /// Whether the interpreter has the hooks that this needs.
    has_hooks: bool,
    /// Whether the monitor's thread has been started.
    is_started: bool,
}

static MONITOR: LazyLock<Mutex<Monitor>> = LazyLock::new(|| {
    let watch = StallWatch::new(LongReaction::DEFAULT.0);
    let programs = Vec::new();
    Mutex::new(Monitor { watch, programs, dump: None, has_hooks: false, is_started: false })
});
/// Whether a signal has asked the program to stop.
static STOP_REQUESTED: AtomicBool = AtomicBool::new(false);
/// Whether the process forks, and whether the monitor's thread may hold locks; see [`pause`].
static FORKING: AtomicBool = AtomicBool::new(false);
static SAMPLING: AtomicBool = AtomicBool::new(false);
/// Whether this process itself tells which of its bodies take long.
static IS_TOLD_ELSEWHERE: AtomicBool = AtomicBool::new(false);
/// A thread holds this lock while it reports, so that the process is not ended by force in the middle of a
/// report.
static REPORTING: Mutex<()> = Mutex::new(());
static START: LazyLock<Instant> = LazyLock::new(Instant::now);

/// The report of a stall, without the stack.
struct StallReport {
    /// What each line begins with: the federate, if others run in this process.
    prefix: String,
    title: String,
    hint: &'static str,
    /// Python's identifier of the thread.
    thread: u64,
    dump: Option<i32>,
}

/// Watches the reactions of a program from now on.
///
/// # Errors
///
/// If the environment variable has no valid value, or the interpreter takes no hook.
pub(crate) fn watch(
    py: Python<'_>,
    runtime: &Arc<Runtime>,
    places: &Arc<Places>,
    is_thread: bool,
) -> Result<(), Failure> {
    let LongReaction(limit) = LongReaction::from_environment()?;
    if IS_TOLD_ELSEWHERE.load(Ordering::Relaxed) {
        return Ok(());
    }
    let (runtime, places) = (Arc::downgrade(runtime), Arc::clone(places));
    let (has_hooks, is_started) = {
        let mut monitor = monitor();
        if monitor.programs.iter().all(|watched| watched.runtime.strong_count() == 0) {
            // Nothing is left of programs that this process has run before.
            monitor.programs.clear();
            monitor.watch = StallWatch::new(limit);
            STOP_REQUESTED.store(false, Ordering::Relaxed);
        }
        monitor.programs.push(Watched { runtime, places, is_thread });
        (mem::replace(&mut monitor.has_hooks, true), mem::replace(&mut monitor.is_started, true))
    };
    if !has_hooks {
        // If `faulthandler` cannot be armed, reports lack the stack of native code.
        let dump = arm(py).ok().flatten();
        pause_for_forks(py).map_err(|error| Failure::option(error.to_string()))?;
        monitor().dump = dump;
    }
    if !is_started {
        let period = limit.map_or(PERIOD, |limit| (limit / 4).clamp(PERIOD / 25, PERIOD));
        let builder = thread::Builder::new().name("stalls".to_owned());
        // If the thread cannot be started, long reactions are not reported, and nothing else is lost.
        let _ = builder.spawn(move || {
            loop {
                thread::sleep(period);
                let _turn = reporting();
                for due in due_reports() {
                    report(&due);
                }
            }
        });
    }
    Ok(())
}

/// Reports no reactions of programs that begin from now on: this process itself tells what takes long, in words of
/// its users.
#[pyfunction]
pub(crate) fn leave_out_long_reactions() {
    IS_TOLD_ELSEWHERE.store(true, Ordering::Relaxed);
}

/// Watches the reactions of a program no more: it has ended, even if its objects keep its runtime.
pub(crate) fn unwatch(runtime: &Arc<Runtime>) {
    let ended = Arc::as_ptr(runtime);
    for watched in &mut monitor().programs {
        if watched.runtime.as_ptr() == ended {
            watched.runtime = Weak::new();
        }
    }
}

/// In a forked process that runs a program of its own: it has no monitor's thread yet.
pub(crate) fn start_again() {
    FORKING.store(false, Ordering::SeqCst);
    let mut monitor = monitor();
    monitor.is_started = false;
    monitor.programs.clear();
}

/// Notes that a signal has asked the program to stop.
pub(crate) fn note_stop_request() {
    STOP_REQUESTED.store(true, Ordering::Relaxed);
}

/// A second signal is about to interrupt the bodies that run: reports which they are.
pub(crate) fn report_interrupted(py: Python<'_>) {
    // The monitor may have begun a report, and needs the interpreter's lock for the stack. Once the body is
    // interrupted, its stack is gone.
    py.detach(|| drop(reporting()));
    for due in unreported() {
        show(&due, &stack(py, due.thread).unwrap_or_default());
    }
}

/// The process is about to end by force: reports which bodies run, without the interpreter's lock.
pub(crate) fn report_all() {
    // The monitor's thread may be writing a report: waits for its end.
    let _turn = reporting();
    for due in unreported() {
        report(&due);
    }
}

/// The federates that run a reaction at this moment. The federate whose reaction has been running for the
/// longest time is first. A federate that waits for the interpreter's lock does not run its reaction yet.
pub(crate) fn running_federates() -> Vec<FederateId> {
    let monitor = monitor();
    let mut running = monitor.runs();
    running.sort_by_key(|(run, _)| monitor.watch.since(*run));
    let federate = |(run, _): &(ReactionRun, SampledRun)| match monitor.programs[run.program]
        .runtime
        .upgrade()?
        .scope()
    {
        Scope::Federate(federate) => Some(federate),
        Scope::Whole => None,
    };
    running.iter().filter_map(federate).collect()
}

/// The running reactions that have not been reported since the program was asked to stop.
fn unreported() -> Vec<StallReport> {
    // A forked process runs no reaction.
    if FORKING.load(Ordering::SeqCst) {
        return Vec::new();
    }
    let mut monitor = monitor();
    let runs = monitor.runs();
    let stalls = monitor.watch.interrupt(START.elapsed(), runs.iter().map(|(run, _)| *run));
    monitor.reports(&stalls, &runs)
}

/// What to report now; nothing while the process forks.
fn due_reports() -> Vec<StallReport> {
    SAMPLING.store(true, Ordering::SeqCst);
    let due = if FORKING.load(Ordering::SeqCst) { Vec::new() } else { sample() };
    SAMPLING.store(false, Ordering::SeqCst);
    due
}

/// Before a fork: waits until the monitor's thread holds no lock, because the child could never take that lock.
#[pyfunction]
fn pause() {
    FORKING.store(true, Ordering::SeqCst);
    while SAMPLING.load(Ordering::SeqCst) {
        thread::yield_now();
    }
}

/// After a fork, in the parent.
#[pyfunction]
fn resume() {
    FORKING.store(false, Ordering::SeqCst);
}

fn pause_for_forks(py: Python<'_>) -> PyResult<()> {
    let hooks = PyDict::new(py);
    hooks.set_item("before", wrap_pyfunction!(pause, py)?)?;
    hooks.set_item("after_in_parent", wrap_pyfunction!(resume, py)?)?;
    py.import("os")?.call_method("register_at_fork", (), Some(&hooks))?;
    Ok(())
}

fn sample() -> Vec<StallReport> {
    let mut monitor = monitor();
    let runs = monitor.runs();
    let (now, stop_requested) = (START.elapsed(), STOP_REQUESTED.load(Ordering::Relaxed));
    let stalls = monitor.watch.sample(now, runs.iter().map(|(run, _)| *run), stop_requested);
    monitor.reports(&stalls, &runs)
}

impl Monitor {
    /// The reactions that run now.
    fn runs(&self) -> Vec<(ReactionRun, SampledRun)> {
        let mut runs = Vec::new();
        for (program, watched) in self.programs.iter().enumerate() {
            let Some(runtime) = watched.runtime.upgrade() else { continue };
            runs.extend(runtime.sample().into_iter().map(|sampled| {
                let SampledRun { reaction, number, .. } = sampled;
                (ReactionRun { program, reaction, number }, sampled)
            }));
        }
        runs
    }

    fn reports(&self, stalls: &[Stall], runs: &[(ReactionRun, SampledRun)]) -> Vec<StallReport> {
        let find = |stall: &Stall| runs.iter().find(|(run, _)| *run == stall.run);
        let report = |stall: &Stall| {
            let (run, sampled) = find(stall)?;
            let watched = &self.programs[run.program];
            let runtime = watched.runtime.upgrade()?;
            let federate = runtime.federate_name().filter(|_| watched.is_thread);
            let prefix = federate.map_or_else(String::new, |name| format!("[{name}] "));
            let title = title(stall, sampled, watched, &runtime);
            let hint = if stall.delays_stop { "" } else { HINT };
            Some(StallReport { prefix, title, hint, thread: sampled.thread, dump: self.dump })
        };
        stalls.iter().filter_map(report).collect()
    }
}

/// What a report says, without the stack.
fn title(stall: &Stall, sampled: &SampledRun, watched: &Watched, runtime: &Runtime) -> String {
    let program = runtime.program();
    let federate = runtime.federate_name();
    let of = federate.map_or_else(String::new, |name| format!(" of federate {name}"));
    let name = program.reaction_label(sampled.reaction);
    let place = watched.places.of_reaction(sampled.reaction);
    let place = place.map_or_else(String::new, |place| format!(" ({place})"));
    let (time, microstep) = (show_time(sampled.tag.time), sampled.tag.microstep);
    let at = format!("at tag ({time}, {microstep})");
    let lasts = match stall.lasts.as_secs_f64() {
        seconds if seconds < 1.0 => "less than a second".to_owned(),
        seconds => format!("{seconds:.0} s"),
    };
    let what = format!("reaction {name}{of}{place} has been running for {lasts} {at}");
    match stall.delays_stop {
        true => format!("warning: {what}, and the end waits for it"),
        false => format!("warning: {what}"),
    }
}

/// Writes a report, with the stack if it can be obtained.
fn report(due: &StallReport) {
    let thread = due.thread;
    if let Some(dump) = due.dump.filter(|_| cfg!(Py_GIL_DISABLED)) {
        // Without a global lock, the interpreter tells the frames of another thread only once all threads stand still, those
        // in code that is not Python's, too.
        let frames = dumped(dump, thread).unwrap_or_default();
        let lines = frames.clone();
        let stack = match ask(move |py| with_code(py, &lines)) {
            Asked::Told(stack) => stack,
            Asked::Busy | Asked::Silent => frames,
        };
        return show(due, &stack);
    }
    match ask(move |py| stack(py, thread)) {
        Asked::Told(stack) => show(due, &stack),
        Asked::Silent => show(due, ""),
        Asked::Busy => {
            let native =
                "  it holds the interpreter inside of code that is not Python's, called in:";
            let frames = due.dump.and_then(|dump| dumped(dump, thread)).unwrap_or_default();
            match frames.is_empty() {
                true => show(due, native.trim_end_matches(", called in:")),
                false => show(due, &format!("{native}\n{frames}")),
            }
        }
    }
}

/// What comes of a question to the interpreter.
enum Asked {
    /// Another thread holds its lock.
    Busy,
    /// There is no answer in time.
    Silent,
    Told(String),
}

/// Asks on a thread of its own, which may never get an answer.
fn ask(question: impl FnOnce(Python<'_>) -> Option<String> + Send + 'static) -> Asked {
    let (sender, answer) = channel();
    let asker = thread::Builder::new().name("stack".to_owned()).spawn(move || {
        Python::attach(|py| {
            // The receiver is gone if the lock took too long.
            if sender.send(None).is_ok() {
                let _ = sender.send(Some(question(py).unwrap_or_default()));
            }
        });
    });
    match asker.ok().and_then(|_| answer.recv_timeout(LOCK_TIMEOUT).ok()) {
        None => Asked::Busy,
        Some(_) => match answer.recv_timeout(STACK_TIMEOUT).ok().flatten() {
            Some(text) => Asked::Told(text),
            None => Asked::Silent,
        },
    }
}

fn show(due: &StallReport, stack: &str) {
    let StallReport { prefix, title, hint, .. } = due;
    let end = if stack.is_empty() { "" } else { "\n" };
    let text = format!("{title}{end}{}{hint}", stack.trim_end());
    say(&format!("{prefix}{}", text.replace('\n', &format!("\n{prefix}"))));
}

/// The stack of a thread, if it runs Python code.
fn stack(py: Python<'_>, thread: u64) -> Option<String> {
    let stalls = py.import("hprm._stalls").ok()?;
    stalls.call_method1("stack", (thread,)).ok()?.extract().ok()?
}

/// Lines that `faulthandler` has written as a traceback shows them, with the code.
fn with_code(py: Python<'_>, lines: &str) -> Option<String> {
    let stalls = py.import("hprm._stalls").ok()?;
    stalls.call_method1("with_code", (lines,)).ok()?.extract().ok()
}

/// Has `faulthandler` write the stack of a thread that gets `SIGSTKFLT`, a signal that nothing else uses.
/// Returns the descriptor to which it writes.
fn arm(py: Python<'_>) -> PyResult<Option<i32>> {
    let number = Signal::SIGSTKFLT as i32;
    py.import("hprm._stalls")?.call_method1("arm", (number,))?.extract()
}

/// The stack of a thread as `faulthandler` writes it, whichever thread holds the interpreter's lock.
fn dumped(dump: i32, thread: u64) -> Option<String> {
    let path = format!("/proc/self/fd/{dump}");
    let before = fs::read(&path).ok()?.len();
    pthread_kill(thread as Pthread, Signal::SIGSTKFLT).ok()?;
    let mut written = Vec::new();
    for _ in 0..LOOKS.1 {
        thread::sleep(LOOKS.0);
        let now = fs::read(&path).ok()?.split_off(before);
        if !now.is_empty() && now.len() == written.len() {
            break;
        }
        written = now;
    }
    let written = String::from_utf8_lossy(&written).into_owned();
    let mut frames: Vec<_> = written.lines().filter(|line| line.starts_with("  File")).collect();
    // The outermost first, as in a traceback.
    frames.reverse();
    Some(of_body(&frames).join("\n"))
}

/// The frames from the body on, without those of the package.
fn of_body<'t>(frames: &[&'t str]) -> Vec<&'t str> {
    let calls_bodies = |line: &&str| CALLERS.iter().any(|caller| line.contains(caller));
    let first = frames
        .iter()
        .position(|line| line.contains(".lf\""))
        .unwrap_or_else(|| frames.iter().rposition(calls_bodies).map_or(0, |caller| caller + 1));
    frames[first..].iter().filter(|line| !line.contains("/hprm/_")).copied().collect()
}

fn reporting() -> MutexGuard<'static, ()> {
    REPORTING.lock().unwrap_or_else(PoisonError::into_inner)
}

fn monitor() -> MutexGuard<'static, Monitor> {
    MONITOR.lock().unwrap_or_else(PoisonError::into_inner)
}
