//! A federate that was started by hand ends within a bounded time after it was asked to.
//!
//! To stop in order it needs the RTI and perhaps other federates, which may never answer, and the
//! reaction that runs has to return. The federates of `hprm run` have a launcher that stops waiting
//! after a timeout; here a thread does so, which sleeps until the interpreter writes that a signal has come.

use std::io;
use std::os::fd::OwnedFd;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread;
use std::time::Duration;

use hprm::Inbox;
use rustix::io::read;
use rustix::pipe::{PipeFlags, pipe_with};
use rustix::process::{Signal, getpid, kill_process};
use signal_hook::low_level::emulate_default_handler;

use hprm::{Kind, Report};

use crate::console::show;
use crate::interrupt::Progress;
use crate::value::Value;

/// How long an orderly stop may take; as long as for a federation that `hprm run` has launched.
const ORDERLY: Duration = Duration::from_secs(5);
/// How long the federate may take to end after that, when it need not wait for others any more.
const AT_ONCE: Duration = Duration::from_secs(3);

/// Starts a thread that watches for signals of these numbers. Returns where the interpreter is to
/// write the number of each signal; the `inbox` rings then. It watches until that is closed.
///
/// # Errors
///
/// If the system has no pipe or no thread left.
pub(crate) fn watch(
    federate: &str,
    numbers: Vec<u8>,
    inbox: Inbox<Value>,
    progress: Arc<Progress>,
) -> io::Result<OwnedFd> {
    let (reader, writer) = pipe_with(PipeFlags::CLOEXEC)?;
    // A signal handler writes, and must not wait.
    rustix::io::ioctl_fionbio(&writer, true)?;
    let mut federate = Some(federate.to_owned());
    spawn(move || {
        let mut numbers_read = [0; 64];
        while let Ok(count @ 1..) = read(&reader, &mut numbers_read) {
            inbox.notify();
            let first = numbers_read[..count].iter().find(|number| numbers.contains(number));
            if let Some(number) = first
                && let Some(federate) = federate.take()
            {
                let (number, progress) = (i32::from(*number), Arc::clone(&progress));
                // Without one, it takes a second signal.
                let _ = spawn(move || end_after_timeouts(&federate, number, &progress));
            }
        }
    })?;
    Ok(writer)
}

fn spawn(run: impl FnOnce() + Send + 'static) -> io::Result<()> {
    thread::Builder::new().name("signals".to_owned()).spawn(run).map(drop)
}

/// Waits for an orderly end. Then the process gets the signal again, which breaks into whatever it does
/// or waits for; and if even that does not help, because code that is not Python's never returns, the
/// signal ends the process.
fn end_after_timeouts(federate: &str, number: i32, progress: &Progress) {
    thread::sleep(ORDERLY);
    if progress.over.load(Ordering::Relaxed) {
        return;
    }
    let reason = match progress.noticed.load(Ordering::Relaxed) {
        false => "a reaction does not return",
        true => "the RTI, another federate or a reaction takes too long, or does not answer at all",
    };
    let limit = ORDERLY.as_secs();
    let message =
        format!("federate {federate} has not stopped in order within {limit} s: it ends now");
    show(&Report::new(Kind::Unfinished, message).of(federate).hint(reason));
    // To the process, so that the main thread gets it, whatever that waits for.
    let signal = Signal::from_named_raw(number);
    let _ = signal.map(|signal| kill_process(getpid(), signal));
    thread::sleep(AT_ONCE);
    if !progress.over.load(Ordering::Relaxed) {
        let _ = emulate_default_handler(number);
    }
}
