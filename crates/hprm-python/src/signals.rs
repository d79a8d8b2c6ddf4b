//! Signals that ask for the end, on a thread of their own: they are noticed even while code that is not
//! Python's holds the interpreter.
//!
//! The interpreter's handler in C writes the number of each signal to a pipe, on whichever thread it comes,
//! and this thread reads them. [`stop_in_time`] makes sure that a process ends some time after the first of
//! them; what the program itself notices of a signal is in [`interrupt`](crate::interrupt).

use std::io;
use std::os::fd::OwnedFd;
use std::sync::Arc;
use std::sync::mpsc::Sender;
use std::thread;
use std::time::{Duration, Instant};

use hprm::recorder::cut_recordings;
use hprm::supervisor::{Observation, Signal};
use hprm::trace::cut_traces;
use hprm::{Inbox, Kind, Report, StopStep, StopTimer};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::read;
use rustix::pipe::{PipeFlags, pipe_with};
use rustix::process::{getpid, kill_process};

use crate::console::show;
use crate::forced_end;
use crate::interrupt::Progress;
use crate::stalls;
use crate::value::Value;

/// What the thread has received.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum SignalEvent {
    /// A signal that asks for the end.
    StopRequest(Signal),
    /// Another signal, for which the program has a handler.
    Other,
    /// No signal for as long as the thread was to wait.
    Timeout,
}

/// Starts the thread. It calls `on_event`, which returns for how long to wait for the next signal. Signals of these
/// `numbers` ask for the end. Returns where the interpreter is to write; the thread ends when that is closed.
///
/// # Errors
///
/// If the system has no pipe or no thread left.
pub(crate) fn listen(
    numbers: Vec<u8>,
    mut on_event: impl FnMut(SignalEvent) -> Option<Duration> + Send + 'static,
) -> io::Result<OwnedFd> {
    let (reader, writer) = pipe_with(PipeFlags::CLOEXEC)?;
    // A signal handler writes, and must not wait.
    rustix::io::ioctl_fionbio(&writer, true)?;
    let run = move || {
        let mut timeout = None;
        let mut read_numbers = [0; 64];
        loop {
            if !is_readable(&reader, timeout) {
                timeout = on_event(SignalEvent::Timeout);
                continue;
            }
            let Ok(count @ 1..) = read(&reader, &mut read_numbers) else { return };
            for number in &read_numbers[..count] {
                timeout = on_event(match numbers.contains(number) {
                    true => SignalEvent::StopRequest(Signal(i32::from(*number))),
                    false => SignalEvent::Other,
                });
            }
        }
    };
    thread::Builder::new().name("signals".to_owned()).spawn(run)?;
    Ok(writer)
}

/// Whether there is something to read, or the end, before the `timeout`.
fn is_readable(pipe: &OwnedFd, timeout: Option<Duration>) -> bool {
    let timeout = timeout.and_then(|timeout| Timespec::try_from(timeout).ok());
    poll(&mut [PollFd::new(pipe, PollFlags::IN)], timeout.as_ref()).is_ok_and(|ready| ready > 0)
}

/// For a process that another one looks after: its launcher ends it, and it has only to notice that it is
/// asked to stop.
pub(crate) fn notice(inbox: Inbox<Value>) -> impl FnMut(SignalEvent) -> Option<Duration> {
    move |event| {
        if matches!(event, SignalEvent::StopRequest(_)) {
            stalls::note_stop_request();
        }
        inbox.notify();
        None
    }
}

/// For a process whose federates are threads: the thread sends each signal to their supervisor.
pub(crate) fn forward(events: Sender<Observation>) -> impl FnMut(SignalEvent) -> Option<Duration> {
    move |event| {
        if let SignalEvent::StopRequest(signal) = event {
            stalls::note_stop_request();
            // The receiver is gone once the process is about to end.
            let _ = events.send(Observation::Signal(signal));
        }
        None
    }
}

/// For a process that looks after itself: it stops in order, or ends at the latest when the [`StopTimer`]
/// says so. `what` it runs is named to the user. One that `ends` not by itself, because its caller goes on, as a script
/// or a notebook, has its reactions interrupted in time, and no more.
pub(crate) fn stop_in_time(
    what: String,
    inbox: Inbox<Value>,
    progress: Arc<Progress>,
    ends: bool,
) -> impl FnMut(SignalEvent) -> Option<Duration> {
    let start = Instant::now();
    let mut timer = StopTimer::default();
    let mut reported = false;
    move |event| {
        let now = start.elapsed();
        if let SignalEvent::StopRequest(signal) = event {
            stalls::note_stop_request();
            timer.signal(now, signal);
        }
        if event != SignalEvent::Timeout {
            inbox.notify();
        }
        match timer.tick(now, progress.steps()) {
            None => {}
            Some(StopStep::Interrupt(signal)) => {
                reported = true;
                show(&unfinished(&what, &progress));
                // To the process, so that the main thread gets it, whatever that waits for.
                if let Some(signal) = rustix::process::Signal::from_named_raw(signal.0) {
                    let _ = kill_process(getpid(), signal);
                }
            }
            Some(StopStep::End { .. }) if !ends => {}
            Some(StopStep::End { signal, after }) => {
                stalls::report_all();
                // That takes a moment.
                if !progress.steps().over {
                    let code = signal.exit_code();
                    if !reported {
                        show(&Report { code, ..stubborn(&what, after) });
                    }
                    cut_traces();
                    cut_recordings();
                    forced_end::end(code);
                }
            }
        }
        timer.next_wakeup().map(|at| at.saturating_sub(now))
    }
}

fn unfinished(what: &str, progress: &Progress) -> Report {
    let reason = match progress.is_noticed() {
        false => "a reaction does not return",
        true => "the RTI, another federate or a reaction takes too long, or does not answer at all",
    };
    let limit = StopTimer::ORDERLY.as_secs();
    let said = format!("{what} has not stopped in order within {limit} s: it ends now");
    Report::new(Kind::Unfinished, said).hint(reason)
}

fn stubborn(what: &str, after: Duration) -> Report {
    let seconds = after.as_secs();
    let said =
        format!("{what} has not ended within {seconds} s after a second signal: it ends now");
    Report::new(Kind::Unfinished, said).hint("a reaction does not return")
}
