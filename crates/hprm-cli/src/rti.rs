//! `hprm rti`: an RTI without federates, which are started by hand.
//!
//! It prints what they must know and what becomes of them.

use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI32, Ordering};
use std::thread;
use std::time::Duration;

use hprm::supervisor::{Signal, Verdict, on_answer, on_silent};
use hprm::{Address, Kind, RtiEvent, RtiHandle, RtiOptions, Security};
use hprm_core::{FederateId, Program};

use crate::args::RtiArguments;
use crate::message::{self, Error};
use crate::roster::Roster;
use crate::{check, frames, outputs, secret, signals};

/// How long an orderly stop may take. Federates that do not come to it give up a little earlier, so
/// that the RTI can still tell the others.
const ORDERLY: Duration = Duration::from_secs(6);
/// How long the other federates may take to end after a failure.
const AFTER_FAILURE: Duration = Duration::from_secs(5);

/// Coordinates a federation to its end.
///
/// # Errors
///
/// If it cannot listen, or the federation fails.
pub(crate) fn rti(arguments: RtiArguments) -> Result<ExitCode, Error> {
    outputs::check_of_rti(&arguments)?;
    let compiled = match check::checked(&arguments.program())? {
        Ok(compiled) => compiled,
        Err(code) => return Ok(code),
    };
    require_federation(&compiled.program, &arguments.file)?;
    check::show_warnings(&compiled);
    frames::begin(&arguments.frames, Some(&compiled.program))?;
    let secret = secret::of_rti(&arguments.secret)?;
    if secret.is_none() {
        arguments.listen.iter().try_for_each(refuse_without_secret)?;
    }
    let federation = secret.map_or_else(hprm::random_federation, Ok)?;
    let mut listen = arguments.listen.into_iter();
    let rti = hprm::Rti::bind(&RtiOptions {
        program: Arc::clone(&compiled.program),
        fingerprint: Arc::new(compiled.fingerprint()),
        federation,
        listen: listen.next().expect("the option is required"),
        also_listen: listen.collect(),
        security: Security {
            auth: compiled.settings.auth,
            encrypt: compiled.settings.encrypt,
            tls: arguments.tls.files(),
        },
        hang_timeout: arguments.hang.timeout(),
    })
    .and_then(|rti| rti.recorded(arguments.tracing.request(None).as_ref()))
    .map_err(|failure| Error::from(&failure))?
    .join_timeout(arguments.join_timeout);
    let interruption = Arc::new(Interruption::default());
    interruption.watch(rti.handle())?;
    for address in rti.addresses() {
        message::print_line(&format!("listening at {address}"));
    }
    if secret.is_none() {
        message::print_line(&format!("federation {federation}"));
    }

    hprm::enter_realtime(&compiled.program.properties, None)
        .map_err(|failure| Error::from(&failure))?;
    let mut failures = Failures::new(rti.handle(), Arc::clone(&interruption));
    let roster = Roster::new(&compiled.program);
    let outcome = rti.run(|event| {
        let observed = event.clone();
        match message_of(&compiled.program, event) {
            Ok(line) => line.iter().for_each(|line| message::print_line(line)),
            Err(verdict) => {
                failures.take(*verdict, matches!(observed, RtiEvent::Failed { .. }));
            }
        }
        roster.observe(&observed);
    });
    roster.close();
    if let Some(signal) = interruption.signal() {
        if interruption.gave_up.load(Ordering::Relaxed) {
            unfinished(signal).show();
        }
        return Ok(exit_code(signal.exit_code()));
    }
    if let (None, Err(failure)) = (failures.code, outcome) {
        failures.take(Verdict::on_rti(&failure), true);
    }
    Ok(failures.code.map_or(ExitCode::SUCCESS, exit_code))
}

/// Refuses addresses that other machines can reach, for a federation whose secret is not known there.
fn refuse_without_secret(address: &Address) -> Result<(), Error> {
    if !address.is_open() {
        return Ok(());
    }
    Err(Error::option(format!(
        "{address} is open to other machines, and this federation has no secret that they share"
    ))
    .hint("name a file for it, which is made if it is missing: --federation-file FILE"))
}

/// Refuses programs without federates.
///
/// # Errors
///
/// If it is one.
pub(crate) fn require_federation(program: &Program, file: &Path) -> Result<(), Error> {
    if program.is_federated() {
        return Ok(());
    }
    Err(Error::new(format!("{} is not a federation", file.display()))
        .hint("its main reactor is not federated: hprm run runs it in one process"))
}

/// That the federation has not stopped in order.
fn unfinished(signal: Signal) -> Error {
    let limit = ORDERLY.as_secs();
    let said = format!(
        "the federation has not stopped in order within {limit} s after signal {signal}: the RTI ends now"
    );
    Error::of(Kind::Unfinished, said).code(signal.exit_code()).hint(
        "a federate does not answer, or a reaction takes longer; the federates lose their RTI",
    )
}

/// Ctrl-C: whether and how it came.
#[derive(Debug, Default)]
struct Interruption {
    /// The signal, or zero.
    signal: AtomicI32,
    /// Whether the federation was asked to stop, and that took too long.
    gave_up: AtomicBool,
}

impl Interruption {
    /// The first time, the federation stops in order, or at once if that takes too long, or does not
    /// start; the second time, at once.
    fn watch(self: &Arc<Self>, rti: RtiHandle) -> Result<(), Error> {
        let interruption = Arc::clone(self);
        signals::watch(move |signal| {
            let first = interruption.signal.swap(signal.0, Ordering::Relaxed) == 0;
            if first {
                rti.request_stop();
                let (later, handle) = (Arc::clone(&interruption), rti.clone());
                let give_up = move || {
                    thread::sleep(ORDERLY);
                    later.gave_up.store(true, Ordering::Relaxed);
                    handle.abort();
                };
                // Without that thread nothing would end the wait for an orderly stop.
                if thread::Builder::new().name("stop".to_owned()).spawn(give_up).is_err() {
                    interruption.gave_up.store(true, Ordering::Relaxed);
                    rti.abort();
                }
            } else {
                rti.abort();
            }
            true
        })
        .map_err(|error| Error::new(format!("cannot watch for Ctrl-C: {error}")))
    }

    fn signal(&self) -> Option<Signal> {
        Some(self.signal.load(Ordering::Relaxed)).filter(|number| *number != 0).map(Signal)
    }
}

/// What has failed: reported at once, because a federate may take long to end.
struct Failures {
    rti: RtiHandle,
    interruption: Arc<Interruption>,
    /// The exit code that follows from the first one.
    code: Option<i32>,
    /// Whether one has ended the federation.
    over: bool,
}

impl Failures {
    fn new(rti: RtiHandle, interruption: Arc<Interruption>) -> Self {
        Self { rti, interruption, code: None, over: false }
    }

    /// Takes note of a failure. One that is `fatal` ends the federation, and what follows from it is not
    /// reported; the failure of a transient federate is not fatal.
    fn take(&mut self, verdict: Verdict, fatal: bool) {
        if self.over || self.interruption.signal().is_some() {
            return;
        }
        self.code.get_or_insert(verdict.code);
        Error::from(verdict.report).show();
        if fatal {
            self.over = true;
            self.limit_end();
        }
    }

    /// Has the RTI close all links if the federates do not end by themselves: a reaction may not return.
    fn limit_end(&self) {
        let rti = self.rti.clone();
        let give_up = move || {
            thread::sleep(AFTER_FAILURE);
            rti.abort();
        };
        if thread::Builder::new().name("failure".to_owned()).spawn(give_up).is_err() {
            self.rti.abort();
        }
    }
}

/// What a person reads about an event, or what has gone wrong.
fn message_of(program: &Program, event: RtiEvent) -> Result<Option<String>, Box<Verdict>> {
    let name = |federate: FederateId| program.federates[federate].name.as_str();
    Ok(Some(match event {
        RtiEvent::Joined { federate, .. } => format!("federate {} joined", name(federate)),
        RtiEvent::Refused { name, reason } => {
            let hint = reason.hint().map(|hint| format!("\n  hint: {hint}")).unwrap_or_default();
            format!("refused federate {name}: {reason}{hint}")
        }
        RtiEvent::Left(federate) => {
            format!("federate {} has left before the start; it may join again", name(federate))
        }
        RtiEvent::Loaded(_) | RtiEvent::Entered(_) | RtiEvent::Closing => return Ok(None),
        RtiEvent::Started(_) => "the federation starts".to_owned(),
        RtiEvent::Silent { federate, silence } => on_silent(name(federate), silence),
        RtiEvent::Answers { federate, silence } => on_answer(name(federate), silence),
        RtiEvent::Withdrawn { report: None, .. } => return Ok(None),
        RtiEvent::Withdrawn { federate, report: Some(report) }
        | RtiEvent::Dropped { federate, report }
        | RtiEvent::Failed { federate, report } => {
            let verdict = Verdict::on_federate(name(federate), None, Some(&report), None);
            return Err(Box::new(verdict));
        }
    }))
}

fn exit_code(code: i32) -> ExitCode {
    u8::try_from(code).map_or(ExitCode::FAILURE, ExitCode::from)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_machines_need_a_secret() {
        let refused = |text: &str| refuse_without_secret(&text.parse().unwrap()).is_err();
        assert!(!refused("unix:@a") && !refused("tcp:127.0.0.1:1"));
        assert!(refused("0.0.0.0:1") && refused("robot.local:1"));
    }
}
