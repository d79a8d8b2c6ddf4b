//! Signals: how the command watches those that ask it to stop, and what becomes of them while it starts an
//! interpreter, or waits for one.

use std::io;
use std::mem;
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, ExitStatus};
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use hprm::launch::signals::{self, is_ignored};
use hprm::supervisor::{self, SIGNAL_DEBOUNCE};
use nix::sys::signal::{SigSet, SigmaskHow, Signal, kill};
use nix::sys::signalfd::{SfdFlags, SignalFd, siginfo};
use nix::unistd::Pid;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ};
use signal_hook::flag;

use crate::message::Error;

/// The signals that ask a process to stop.
const ASKING: [i32; 3] = [SIGHUP, SIGINT, SIGTERM];

/// How often to look whether a process has ended.
const PATIENCE: Duration = Duration::from_millis(2);

/// Starts an interpreter by `start` in such a way that Ctrl-C cannot stop it before it is ready for that: the
/// signal waits until the package unblocks it, which it does first of all.
pub(crate) fn without_ctrl_c<T>(start: impl FnOnce() -> T) -> T {
    let mut ctrl_c = SigSet::empty();
    ctrl_c.add(Signal::SIGINT);
    // Without it, a Ctrl-C that comes very early shows a traceback.
    let before = ctrl_c.thread_swap_mask(SigmaskHow::SIG_BLOCK);
    let started = start();
    if let Ok(before) = before {
        let _ = before.thread_set_mask();
    }
    started
}

/// For as long as this process lives, Ctrl-C, SIGTERM and the end of the terminal do not end it but call
/// `report`, until it returns false.
///
/// # Errors
///
/// If the system refuses.
pub(crate) fn watch(
    report: impl Fn(supervisor::Signal) -> bool + Send + 'static,
) -> io::Result<()> {
    // When the work is done, nothing must disturb what tidies up.
    signals::watch(report).map(mem::forget)
}

/// For as long as this process lives, the signals that a launcher watches do not end it, also when the launcher
/// is done.
///
/// # Errors
///
/// If the system refuses.
pub(crate) fn outlive() -> Result<(), Error> {
    watch(|_| true).map_err(|error| Error::new(format!("cannot watch for Ctrl-C: {error}")))
}

/// From now on, a file that grows beyond its limit (`ulimit -f`) is an error of the write, and does not
/// end this process. Processes that this one starts, or becomes, decide for themselves.
///
/// # Errors
///
/// If the system refuses.
pub(crate) fn survive_long_files() -> io::Result<()> {
    // A handler, unlike an ignored signal, is not inherited.
    flag::register(SIGXFSZ, Arc::default()).map(drop)
}

/// How a process has ended to which signals were forwarded.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ended {
    pub(crate) status: ExitStatus,
    /// The signal that asked this process to stop meanwhile. The other one may have been at its end by then, or have
    /// taken it for a mistake.
    pub(crate) asked: Option<i32>,
}

/// Runs a process to its end. Meanwhile the signals that ask this process to stop go to that one, and a second
/// one kills it.
///
/// Nothing is left of that afterwards: the signals do what they did before.
///
/// # Errors
///
/// If it cannot be started, or the system refuses.
pub(crate) fn run_to_end(mut command: Command) -> io::Result<Ended> {
    let mut asking = SigSet::empty();
    for signal in ASKING.into_iter().filter(|signal| !is_ignored(*signal)) {
        asking.add(Signal::try_from(signal)?);
    }
    // A group of its own, so that a Ctrl-C at the terminal does not reach it twice.
    let command = command.process_group(0);
    let mut process = without_ctrl_c(|| command.spawn())?;
    // Only now, because a process inherits what is blocked. The command has no other threads yet.
    let before = asking.thread_swap_mask(SigmaskHow::SIG_BLOCK)?;
    let ended = forward(&asking, &mut process);
    before.thread_set_mask()?;
    ended
}

/// Forwards these signals, which are blocked, to a process until it ends.
fn forward(asking: &SigSet, process: &mut Child) -> io::Result<Ended> {
    let signals = SignalFd::with_flags(asking, SfdFlags::SFD_NONBLOCK | SfdFlags::SFD_CLOEXEC)?;
    let mut asked: Option<(Instant, i32)> = None;
    loop {
        if let Some(status) = process.try_wait()? {
            // One that came at the end asks for the end all the same. This process ends by it, not of it.
            let number = |came: siginfo| i32::try_from(came.ssi_signo).unwrap_or_default();
            while let Some(came) = signals.read_signal()? {
                asked.get_or_insert((Instant::now(), number(came)));
            }
            return Ok(Ended { status, asked: asked.map(|(_, number)| number) });
        }
        if let Some(came) = signals.read_signal()? {
            // What a terminal sends to all of its processes may come once more from the one that started this.
            if asked.is_some_and(|(at, _)| at.elapsed() < SIGNAL_DEBOUNCE) {
                continue;
            }
            let pid = Pid::from_raw(i32::try_from(process.id()).unwrap_or_default());
            let number = i32::try_from(came.ssi_signo).unwrap_or_default();
            let signal = if asked.is_some() { Signal::SIGKILL } else { Signal::try_from(number)? };
            // It is this one's child, and has not been waited for, so the number is its own.
            let _ = kill(pid, signal);
            asked.get_or_insert((Instant::now(), number));
        }
        thread::sleep(PATIENCE);
    }
}

/// Whether a signal asks a process to stop.
pub(crate) fn asks_to_stop(signal: i32) -> bool {
    ASKING.contains(&signal)
}
