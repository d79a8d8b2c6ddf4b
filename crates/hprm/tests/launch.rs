//! Launching federations, with shell commands in the place of federates, and signals before, during and after
//! that.
//!
//! What needs federates that join is tested with the command and Python.

use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::channel;
use std::time::Duration;

use hprm::launch::signals::watch;
use hprm::launch::{Launch, Membership};
use hprm::supervisor::{Advice, Signal};
use hprm::{Failure, HangTimeout, Kind, Label, Report, Security, random_federation};
use hprm_core::{ProgramBuilder, Properties};
use signal_hook::consts::SIGTERM;
use signal_hook::low_level::raise;

/// Names the test that a process of its own runs.
const INNER: &str = "HPRM_TEST_INNER";

/// Two federates; one is transient if that is asked for.
fn launch(transient: bool) -> Launch {
    let mut b = ProgramBuilder::new("Main", Properties::default());
    for name in ["first", "second"] {
        let reactor = b.reactor(b.main(), name);
        let federate = b.federate(reactor, name, 0, None);
        if transient && name == "second" {
            b.make_transient(federate);
        }
    }
    let program = b.build().unwrap();
    Launch {
        fingerprint: Arc::new(program.fingerprint()),
        program: Arc::new(program),
        federation: random_federation().unwrap(),
        also_listen: Vec::new(),
        security: Security::default(),
        join_timeout: Duration::from_secs(60),
        hang_timeout: HangTimeout::default(),
        debugged: None,
        logical_trace: None,
        trace: None,
        advice: Advice::PROGRAM,
    }
}

fn shell(script: &str) -> Command {
    let mut command = Command::new("/bin/sh");
    command.args(["-c", script]);
    command
}

/// A process that notes its number and does not end by itself.
fn staying(folder: &Path) -> Command {
    shell(&format!("echo $$ > {0}/draft; mv {0}/draft {0}/pid; exec sleep 1000", folder.display()))
}

/// Whether the process that has noted its number, if it came to that, is gone.
fn is_gone(folder: &Path) -> bool {
    let Ok(pid) = std::fs::read_to_string(folder.join("pid")) else { return true };
    !PathBuf::from(format!("/proc/{}", pid.trim())).exists()
}

#[test]
fn a_federate_that_fails_ends_the_others_and_is_told_once() {
    let folder = tempfile::tempdir().unwrap();
    let mut told = Vec::new();
    // It fails once the other one is there.
    let failing =
        format!("while [ ! -e {}/pid ]; do sleep 0.01; done; exit 3", folder.path().display());
    let command = |membership: &Membership<'_>| {
        Ok(if membership.name == "first" { staying(folder.path()) } else { shell(&failing) })
    };
    let code = launch(false).run(command, &mut |label, report: Report| told.push((label, report)));
    assert_eq!(code, Ok(3));
    let (label, report) = &told[0];
    assert_eq!(report.hint.as_deref(), Some(Advice::PROGRAM.unexplained));
    assert_eq!((*label, report.federate.as_deref()), (Label::Error, Some("second")));
    assert!(told[1..].iter().all(|(label, _)| *label == Label::Warning), "{told:?}");
    assert!(folder.path().join("pid").exists() && is_gone(folder.path()));
}

#[test]
fn what_has_started_ends_if_another_federate_cannot_start() {
    let folder = tempfile::tempdir().unwrap();
    let command = |membership: &Membership<'_>| {
        let is_first = membership.name == "first";
        Ok(if is_first { staying(folder.path()) } else { Command::new("/nowhere/federate") })
    };
    let failure = launch(false).run(command, &mut |_, _| ()).unwrap_err();
    assert_eq!(failure.kind(), Kind::Command);
    let said = "cannot start federate second with /nowhere/federate: No such file";
    assert!(failure.to_string().starts_with(said), "{failure}");
    assert!(is_gone(folder.path()));
}

#[test]
fn transient_federates_are_started_first_and_all_know_the_rti() {
    let launching = launch(true).start().unwrap();
    let address = launching.rti().clone();
    let mut seen = Vec::new();
    let command = |membership: &Membership<'_>| {
        assert_eq!(*membership.rti, address);
        seen.push(membership.name.to_owned());
        match seen.len() {
            1 => Ok(shell("exec sleep 1000")),
            _ => Err(Failure::command("enough")),
        }
    };
    assert_eq!(launching.run(command, &mut |_, _| ()), Err(Failure::command("enough")));
    assert_eq!(seen, ["second", "first"]);
}

/// Has a process of its own run the test `name` of this file, for what concerns a whole process.
fn alone(name: &str) -> ExitStatus {
    let mut process = Command::new(std::env::current_exe().unwrap());
    process.args(["--exact", name, "--test-threads", "1"]).env(INNER, name);
    process.output().unwrap().status
}

fn is_alone(name: &str) -> bool {
    std::env::var(INNER).is_ok_and(|inner| inner == name)
}

#[test]
fn a_signal_asks_while_it_is_watched_and_ends_the_process_afterwards() {
    let name = "a_signal_asks_while_it_is_watched_and_ends_the_process_afterwards";
    if !is_alone(name) {
        assert_eq!(alone(name).signal(), Some(SIGTERM));
        return;
    }
    let (signals, seen) = channel();
    for _ in 0..2 {
        let sender = signals.clone();
        let outer = watch(|_| true).unwrap();
        let inner = watch(move |signal| sender.send(signal).is_ok()).unwrap();
        raise(SIGTERM).unwrap();
        assert_eq!(seen.recv(), Ok(Signal::TERMINATE));
        drop(inner);
        // It is still watched.
        raise(SIGTERM).unwrap();
        drop(outer);
    }
    raise(SIGTERM).unwrap();
}

#[test]
fn a_handler_of_the_program_is_there_before_and_after() {
    let name = "a_handler_of_the_program_is_there_before_and_after";
    if !is_alone(name) {
        assert_eq!(alone(name).code(), Some(0));
        return;
    }
    let asked = Arc::new(AtomicBool::new(false));
    signal_hook::flag::register(SIGTERM, Arc::clone(&asked)).unwrap();
    drop(watch(|_| true).unwrap());
    assert!(!asked.load(Ordering::Relaxed));
    raise(SIGTERM).unwrap();
    assert!(asked.load(Ordering::Relaxed));
}

#[test]
fn a_run_leaves_signals_as_they_were() {
    let name = "a_run_leaves_signals_as_they_were";
    if !is_alone(name) {
        assert_eq!(alone(name).signal(), Some(SIGTERM));
        return;
    }
    // The command is asked for when the signals are watched.
    let command = |_: &Membership<'_>| {
        raise(SIGTERM).unwrap();
        Ok(shell("exec sleep 1000"))
    };
    assert_eq!(launch(false).run(command, &mut |_, _| ()), Ok(Signal::TERMINATE.exit_code()));
    raise(SIGTERM).unwrap();
}
