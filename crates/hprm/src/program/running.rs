//! The process of a federate whose reactors are in Rust: from the handover of its launcher to its end.

use std::process;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI32, Ordering};

use hprm_core::Program;

use super::bodies::Bodies;
use super::sender::{self, Entrances};
use super::value::Value;
use crate::handover::Handover;
use crate::launch::{die_with_parent, watch};
use crate::supervisor::Signal;
use crate::{Failure, Inbox, Label, console, log_to_stderr};

/// A signal by which the user has asked this process to stop.
pub(super) struct Asked {
    /// Whether one has come since the loop last looked.
    is_new: AtomicBool,
    signal: AtomicI32,
}

impl Asked {
    pub(super) fn take(&self) -> bool {
        self.is_new.load(Ordering::Relaxed) && self.is_new.swap(false, Ordering::Relaxed)
    }

    pub(super) fn signal(&self) -> i32 {
        self.signal.load(Ordering::Relaxed)
    }
}

/// Runs a federate to its end, and ends this process.
pub(super) fn run_federate(
    handover: &Handover,
    built: Result<(Arc<Program>, Bodies, Entrances), Failure>,
) -> ! {
    let mut joined = false;
    let outcome = run(handover, built, &mut joined);
    let code = match outcome {
        Ok(()) => 0,
        Err(failure) => {
            // The RTI tells the launcher, or the launcher has ended the RTI.
            let is_told = handover.launched && (joined || matches!(failure, Failure::NoRti { .. }));
            if !is_told && failure.needs_report() {
                console::show(Label::Error, &failure.report());
            }
            failure.exit_code()
        }
    };
    end(code)
}

/// Ends this process: it is a federate, or was asked what it declares, and the rest of `main` is the launcher's.
#[allow(clippy::exit, reason = "the rest of `main` must not run once for each federate")]
pub(super) fn end(code: i32) -> ! {
    process::exit(code)
}

fn run(
    handover: &Handover,
    built: Result<(Arc<Program>, Bodies, Entrances), Failure>,
    joined: &mut bool,
) -> Result<(), Failure> {
    if handover.launched {
        let launcher = rustix::process::getppid().map_or(0, |pid| pid.as_raw_nonzero().get());
        let lives = die_with_parent(launcher);
        if !lives.map_err(|error| Failure::system("cannot end with the launcher", &error))? {
            return Ok(());
        }
    }
    log_to_stderr(false)?;
    let (program, built) = match built {
        Ok((program, bodies, entrances)) => (program, Ok((bodies, entrances))),
        // It joins nevertheless, so that the federation learns why there is no such federate.
        Err(failure) => (Arc::new(handover.program.clone()), Err(failure)),
    };
    let options = handover.options(program)?;
    let (inbox, built) = match built {
        Ok((bodies, mut entrances)) => (entrances.ready()?, Ok((bodies, entrances))),
        Err(failure) => (no_inbox()?, Err(failure)),
    };
    let asked = Arc::new(Asked { is_new: AtomicBool::new(false), signal: AtomicI32::new(0) });
    let _watch = {
        let (asked, inbox) = (Arc::clone(&asked), inbox.clone());
        watch(move |Signal(signal)| {
            asked.signal.store(signal, Ordering::Relaxed);
            asked.is_new.store(true, Ordering::Relaxed);
            inbox.notify();
            true
        })
        .map_err(|error| Failure::system("cannot watch for Ctrl-C", &error))?
    };
    let program = Arc::clone(&options.program);
    sender::running_reactions(|| {
        crate::run_federate(&options, &inbox, || {
            *joined = true;
            let (bodies, entrances) = built?;
            Ok(bodies.federated(&program, asked, entrances))
        })
    })
}

fn no_inbox() -> Result<Inbox<Value>, Failure> {
    Inbox::new().map_err(|error| Failure::system("no descriptor is left", &error))
}
