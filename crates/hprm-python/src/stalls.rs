//! Reactions that do not return: a thread samples what runs, and says where.
//!
//! One thread serves all programs of the process. It needs no lock of the interpreter to see that a
//! reaction hangs; to show its stack, another thread asks for that lock. If the reaction never releases
//! it, because code that is not Python's holds it, a signal to that thread has `faulthandler` write the
//! stack. The thread stands still meanwhile, so no lock is needed. What is told when is decided by
//! [`StallWatch`].

use std::fs;
use std::mem;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::channel;
use std::sync::{Arc, LazyLock, Mutex, MutexGuard, PoisonError, Weak};
use std::thread;
use std::time::{Duration, Instant};

use hprm::{ReactionRun, Stall, StallWatch};
use hprm_core::{FederateId, Scope, show_time};
use nix::sys::pthread::{Pthread, pthread_kill};
use nix::sys::signal::Signal;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::console::say;
use crate::places::Places;
use crate::runtime::{Reacting, Runtime};

/// The environment variable with the seconds after which a long reaction is told.
const NAME: &str = "HPRM_LONG_REACTION";
/// Without it.
const AFTER: Duration = Duration::from_secs(5);

/// What to do about a reaction that is meant to take long.
const HINT: &str = "\n  hint: it may be meant to take long, and is told once; HPRM_LONG_REACTION=SECONDS says \
                    after which time, or off";

/// Between two samples, at most.
const PERIOD: Duration = Duration::from_millis(500);
/// How long to wait for the interpreter's lock. A loop in Python releases it after milliseconds.
const PATIENCE: Duration = Duration::from_secs(1);
/// How long the stack may take then.
const LONG_PATIENCE: Duration = Duration::from_secs(10);
/// How often, and how many times, to look whether `faulthandler` has written.
const LOOKS: (Duration, u32) = (Duration::from_millis(20), 25);

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
    /// Where `faulthandler` writes, if it does.
    dump: Option<i32>,
    runs: bool,
}

static MONITOR: LazyLock<Mutex<Monitor>> = LazyLock::new(|| {
    let watch = StallWatch::new(Some(AFTER));
    Mutex::new(Monitor { watch, programs: Vec::new(), dump: None, runs: false })
});
/// Whether the user has asked for the end.
static ASKED: AtomicBool = AtomicBool::new(false);
/// Whether the process forks, and whether the thread holds locks; see [`pause`].
static FORKING: AtomicBool = AtomicBool::new(false);
static SAMPLING: AtomicBool = AtomicBool::new(false);
/// Locked by the thread that tells, so that all is told before the process ends by force.
static TELLING: Mutex<()> = Mutex::new(());
static START: LazyLock<Instant> = LazyLock::new(Instant::now);

/// A stall, with what is to be said of it.
struct Told {
    title: String,
    hint: &'static str,
    /// As Python counts threads.
    thread: u64,
    dump: Option<i32>,
}

/// Watches the reactions of a program from now on.
///
/// # Errors
///
/// A message, if what the environment says of it means nothing.
pub(crate) fn watch(
    py: Python<'_>,
    runtime: &Arc<Runtime>,
    places: &Arc<Places>,
    is_thread: bool,
) -> Result<(), String> {
    let limit = limit()?;
    let (runtime, places) = (Arc::downgrade(runtime), Arc::clone(places));
    let is_first = {
        let mut monitor = monitor();
        monitor.programs.push(Watched { runtime, places, is_thread });
        !mem::replace(&mut monitor.runs, true)
    };
    if is_first {
        // Without it, the stack of native code is not shown.
        let dump = arm(py).ok().flatten();
        pause_for_forks(py).map_err(|error| error.to_string())?;
        let mut monitor = monitor();
        (monitor.watch, monitor.dump) = (StallWatch::new(limit), dump);
        let period = limit.map_or(PERIOD, |limit| (limit / 4).clamp(PERIOD / 25, PERIOD));
        let builder = thread::Builder::new().name("stalls".to_owned());
        // Without the thread a long reaction is not told, and nothing else is lost.
        let _ = builder.spawn(move || {
            loop {
                thread::sleep(period);
                let _turn = telling();
                for told in sampled() {
                    tell(&told);
                }
            }
        });
    }
    Ok(())
}

/// A signal has asked the program to stop.
pub(crate) fn ask() {
    ASKED.store(true, Ordering::Relaxed);
}

/// Another signal breaks into the bodies that run: says into which.
pub(crate) fn break_in(py: Python<'_>) {
    for told in untold() {
        show(&told, &stack(py, told.thread).unwrap_or_default());
    }
}

/// The process is about to end by force: says which bodies run, without the interpreter's lock.
pub(crate) fn tell_of_all() {
    // What is being told at this moment is told to its end.
    let _turn = telling();
    for told in untold() {
        tell(&told);
    }
}

/// The federates that run a reaction at this moment, the one that has been running for the longest time first.
/// One that waits for the interpreter in order to begin a reaction does not run it yet.
pub(crate) fn running_federates() -> Vec<FederateId> {
    let monitor = monitor();
    let mut running = monitor.runs();
    running.sort_by_key(|(run, _)| monitor.watch.since(*run));
    let federate = |(run, _): &(ReactionRun, Reacting)| match monitor.programs[run.program]
        .runtime
        .upgrade()?
        .scope()
    {
        Scope::Federate(federate) => Some(federate),
        Scope::Whole => None,
    };
    running.iter().filter_map(federate).collect()
}

/// What has not been told since the program was asked to stop, of all that runs.
fn untold() -> Vec<Told> {
    // A copy of the process runs no reaction.
    if FORKING.load(Ordering::SeqCst) {
        return Vec::new();
    }
    let mut monitor = monitor();
    let runs = monitor.runs();
    let stalls = monitor.watch.break_in(START.elapsed(), runs.iter().map(|(run, _)| *run));
    monitor.told(&stalls, &runs)
}

/// What to tell now; nothing while the process forks.
fn sampled() -> Vec<Told> {
    SAMPLING.store(true, Ordering::SeqCst);
    let told = if FORKING.load(Ordering::SeqCst) { Vec::new() } else { look() };
    SAMPLING.store(false, Ordering::SeqCst);
    told
}

/// Before a fork: the copy must find no lock that the thread here holds.
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

fn look() -> Vec<Told> {
    let mut monitor = monitor();
    let runs = monitor.runs();
    let (now, asked) = (START.elapsed(), ASKED.load(Ordering::Relaxed));
    let stalls = monitor.watch.look(now, runs.iter().map(|(run, _)| *run), asked);
    monitor.told(&stalls, &runs)
}

impl Monitor {
    /// What runs now.
    fn runs(&self) -> Vec<(ReactionRun, Reacting)> {
        let mut runs = Vec::new();
        for (program, watched) in self.programs.iter().enumerate() {
            let Some(runtime) = watched.runtime.upgrade() else { continue };
            runs.extend(runtime.sample().into_iter().map(|reacting| {
                let Reacting { reaction, number, .. } = reacting;
                (ReactionRun { program, reaction, number }, reacting)
            }));
        }
        runs
    }

    fn told(&self, stalls: &[Stall], runs: &[(ReactionRun, Reacting)]) -> Vec<Told> {
        let find = |stall: &Stall| runs.iter().find(|(run, _)| *run == stall.run);
        let told = |stall: &Stall| {
            let (run, reacting) = find(stall)?;
            let watched = &self.programs[run.program];
            let runtime = watched.runtime.upgrade()?;
            let title = title(stall, reacting, watched, &runtime);
            let hint = if stall.keeps { "" } else { HINT };
            Some(Told { title, hint, thread: reacting.thread, dump: self.dump })
        };
        stalls.iter().filter_map(told).collect()
    }
}

/// What is told, without the stack.
fn title(stall: &Stall, reacting: &Reacting, watched: &Watched, runtime: &Runtime) -> String {
    let program = runtime.program();
    let federate = runtime.federate_name();
    let prefix = federate.filter(|_| watched.is_thread).map(|name| format!("[{name}] "));
    let prefix = prefix.unwrap_or_default();
    let of = federate.map_or_else(String::new, |name| format!(" of federate {name}"));
    let name = program.reaction_name(reacting.reaction);
    let place = watched.places.of_reaction(reacting.reaction);
    let place = place.map_or_else(String::new, |place| format!(" ({place})"));
    let (time, microstep) = (show_time(reacting.tag.time), reacting.tag.microstep);
    let at = format!("at tag ({time}, {microstep})");
    let lasts = match stall.lasts.as_secs_f64() {
        seconds if seconds < 1.0 => "less than a second".to_owned(),
        seconds => format!("{seconds:.0} s"),
    };
    let what = format!("reaction {name}{of}{place} has been running for {lasts} {at}");
    match stall.keeps {
        true => format!("{prefix}warning: {what}, and the end waits for it"),
        false => format!("{prefix}warning: {what}"),
    }
}

/// Says it, with the stack if that is to be had.
fn tell(told: &Told) {
    let (sender, answer) = channel();
    let thread = told.thread;
    let asks = thread::Builder::new().name("stack".to_owned()).spawn(move || {
        Python::attach(|py| {
            // The channel is closed if that took too long.
            if sender.send(None).is_ok() {
                let _ = sender.send(Some(stack(py, thread).unwrap_or_default()));
            }
        });
    });
    let attached = asks.ok().and_then(|_| answer.recv_timeout(PATIENCE).ok());
    let is_attached = attached.is_some();
    match attached.and_then(|_| answer.recv_timeout(LONG_PATIENCE).ok()) {
        Some(stack) => show(told, &stack.unwrap_or_default()),
        None if is_attached => show(told, ""),
        None => {
            let native =
                "  it holds the interpreter inside of code that is not Python's, called in:";
            let frames = told.dump.and_then(|dump| dumped(dump, thread)).unwrap_or_default();
            match frames.is_empty() {
                true => show(told, native.trim_end_matches(", called in:")),
                false => show(told, &format!("{native}\n{frames}")),
            }
        }
    }
}

fn show(told: &Told, stack: &str) {
    let (title, hint) = (&told.title, told.hint);
    let end = if stack.is_empty() { "" } else { "\n" };
    say(&format!("{title}{end}{}{hint}", stack.trim_end()));
}

/// The stack of a thread, if it runs Python code.
fn stack(py: Python<'_>, thread: u64) -> Option<String> {
    let stalls = py.import("hprm._stalls").ok()?;
    stalls.call_method1("stack", (thread,)).ok()?.extract().ok()?
}

/// Has `faulthandler` write the stack of a thread when the signal comes that nothing else uses. Returns where to.
fn arm(py: Python<'_>) -> PyResult<Option<i32>> {
    let number = Signal::SIGSTKFLT as i32;
    py.import("hprm._stalls")?.call_method1("arm", (number,))?.extract()
}

/// What `faulthandler` writes of a thread, whichever holds the interpreter's lock.
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
    let frames = written.lines().filter(|line| line.starts_with("  File"));
    let mut frames: Vec<_> = frames.filter(|line| !line.contains("/hprm/_")).collect();
    // The outermost first, as in a traceback, and from the body on.
    frames.reverse();
    let first = frames.iter().position(|line| line.contains(".lf\"")).unwrap_or(0);
    Some(frames[first..].join("\n"))
}

/// When to tell.
fn limit() -> Result<Option<Duration>, String> {
    let Some(text) = std::env::var_os(NAME).filter(|text| !text.is_empty()) else {
        return Ok(Some(AFTER));
    };
    let text = text.to_string_lossy();
    if text == "off" {
        return Ok(None);
    }
    let seconds = text.parse().ok().and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
    seconds.filter(|limit| !limit.is_zero()).map(Some).ok_or_else(|| {
        format!("{NAME}={text} means nothing; it is a number of seconds, as in 30, or off")
    })
}

fn telling() -> MutexGuard<'static, ()> {
    TELLING.lock().unwrap_or_else(PoisonError::into_inner)
}

fn monitor() -> MutexGuard<'static, Monitor> {
    MONITOR.lock().unwrap_or_else(PoisonError::into_inner)
}
