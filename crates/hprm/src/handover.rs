//! What a launcher gives to a federate that is an executable of its own: which federate it is, where its federation
//! is, its parameters, and the whole program.
//!
//! It travels in memory without a name, because it contains the secret of the federation. Programs that the federate
//! starts inherit the environment, so that says which process it is meant for.

use std::fs::File;
use std::io::{self, Read, Seek, Write};
use std::os::fd::OwnedFd;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

use hprm_core::{Fact, Fingerprint, Program, StoreOptions};
use hprm_federated::FederationId;
use hprm_model::Given;
use rustix::fs::{MemfdFlags, memfd_create};
use serde::{Deserialize, Serialize};

use crate::recorder::TraceRequest;
use crate::trace::TraceShare;
use crate::{
    Address, Failure, FederateOptions, Label, Reach, Report, Security, TlsFiles, console,
    store_limits,
};

/// The environment variable that says that there is one, and from which process.
const VARIABLE: &str = "HPRM_HANDOVER";

/// The name of its memory, which tools show among the descriptors of a process.
const NAME: &str = "hprm-handover";

/// Both ends must be of one version: the form of a program may change from one to the next.
const VERSION: &str = env!("CARGO_PKG_VERSION");

/// What a federate needs to know to take part in a federation.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Handover {
    version: String,
    /// The name of the federate.
    pub federate: String,
    /// Where the RTI listens.
    pub rti: String,
    /// The secret of the federation.
    pub federation: String,
    /// Seconds that the RTI may take to be there.
    pub connect_timeout: f64,
    /// `HOST[:PORT]` by which other machines reach this one.
    pub advertise: Option<String>,
    /// The target property `auth`.
    pub auth: bool,
    /// Whether no TCP connection is without TLS.
    pub encrypt: bool,
    /// Certificate, key and authority, if TCP connections are encrypted.
    pub tls: Option<(PathBuf, PathBuf, PathBuf)>,
    /// The options for its object store.
    pub store: StoreOptions,
    /// Whether the launcher reports its failures, and it ends with the launcher.
    pub launched: bool,
    /// Its share of the logical trace, and the trace.
    pub logical_trace: Option<(PathBuf, Option<PathBuf>)>,
    /// The names and the values of its parameters.
    pub parameters: Vec<(String, Given)>,
    /// The program of the federation.
    pub program: Program,
    /// Which of the federations of the same name in the launcher it is; none if that is the first one.
    pub which: Option<Which>,
    /// What must be equal in all its processes.
    pub facts: Vec<Fact>,
}

/// One of several federations of the same name in one executable.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Debug, Serialize, Deserialize)]
pub struct Which {
    /// Where its `Federation::new` is.
    pub site: String,
    /// The name of the thread that assembles it: that of the test, if tests run in threads.
    pub thread: Option<String>,
    /// How many there were before it, of the same site and thread.
    pub before: usize,
}

/// Where a federation is, for the federates that join it.
#[derive(Clone, Debug)]
pub struct Meeting<'a> {
    /// Where the RTI listens.
    pub rti: &'a Address,
    /// The secret.
    pub federation: FederationId,
    /// How its links are protected.
    pub security: &'a Security,
}

impl Handover {
    /// A handover to a federate that the calling process launches.
    #[must_use]
    pub fn new(
        federate: &str,
        program: &Program,
        fingerprint: &Fingerprint,
        meeting: &Meeting<'_>,
    ) -> Self {
        let Meeting { rti, federation, security } = meeting;
        let tls = security.tls.clone();
        Self {
            version: VERSION.to_owned(),
            federate: federate.to_owned(),
            rti: rti.to_string(),
            federation: federation.to_string(),
            connect_timeout: Reach::default().connect_timeout.as_secs_f64(),
            advertise: None,
            auth: security.auth,
            encrypt: security.encrypt,
            tls: tls.map(|TlsFiles { certificate, key, authority }| (certificate, key, authority)),
            store: StoreOptions::default(),
            launched: true,
            logical_trace: None,
            parameters: Vec::new(),
            program: program.clone(),
            which: None,
            facts: fingerprint.facts().to_vec(),
        }
    }

    /// Has `command`, which is started next, read the handover as its standard input. A federate that is launched has
    /// no other one.
    ///
    /// # Errors
    ///
    /// If the system has no memory or no descriptor for it.
    pub fn attach(&self, command: &mut Command) -> io::Result<()> {
        command.stdin(Stdio::from(self.memory()?));
        command.env(VARIABLE, format!("stdin:{}", std::process::id()));
        Ok(())
    }

    /// Has `command`, by which the calling process replaces itself, read the handover from a descriptor of its own, so
    /// that it keeps its standard input.
    ///
    /// # Errors
    ///
    /// If the system has no memory or no descriptor for it.
    pub fn attach_beside(&self, command: &mut Command) -> io::Result<File> {
        let memory = File::from(self.memory()?);
        rustix::io::fcntl_setfd(&memory, rustix::io::FdFlags::empty())?;
        let number = std::os::fd::AsRawFd::as_raw_fd(&memory);
        command.env(VARIABLE, format!("{number}:{}", std::process::id()));
        Ok(memory)
    }

    fn memory(&self) -> io::Result<OwnedFd> {
        let text = serde_json::to_vec(self).map_err(io::Error::other)?;
        let mut memory = File::from(memfd_create(NAME, MemfdFlags::CLOEXEC)?);
        memory.write_all(&text)?;
        memory.rewind()?;
        Ok(memory.into())
    }

    /// What this process was given; none if it was not launched as a federate.
    ///
    /// # Errors
    ///
    /// If it cannot be read, or the launcher is of another version.
    pub fn of_this_process() -> Result<Option<Self>, Failure> {
        let Ok(given) = std::env::var(VARIABLE) else { return Ok(None) };
        let Some((place, process)) = given.split_once(':') else { return Ok(None) };
        let parent = rustix::process::getppid().map(|pid| pid.as_raw_nonzero().get().to_string());
        let is_mine =
            parent.as_deref() == Some(process) || std::process::id().to_string() == process;
        // Another process has one if the federate that was given it has started it, or if the launcher has ended.
        let is_there = is_mine || (place == "stdin" && has_handover_as_stdin());
        if !is_there {
            return Ok(None);
        }
        let mut text = String::new();
        let read = match place {
            "stdin" => io::stdin().read_to_string(&mut text),
            number => File::open(format!("/proc/self/fd/{number}"))
                .and_then(|mut file| file.read_to_string(&mut text)),
        };
        read.map_err(|error| {
            Failure::system("the handover of the launcher cannot be read", &error)
        })?;
        match (is_mine, text.is_empty()) {
            (true, _) => Self::read(&text).map(Some),
            (false, true) => Ok(None),
            (false, false) => Err(Failure::option("the launcher of this federate has ended")),
        }
    }

    fn read(text: &str) -> Result<Self, Failure> {
        #[derive(Deserialize)]
        struct Versioned {
            version: String,
        }
        let other = |version: &str| Failure::Option {
            message: format!(
                "the launcher has version {version} of HPRM, and this executable was built with {VERSION}"
            ),
            hint: Some("build the executable with the version of HPRM that launches it"),
        };
        match serde_json::from_str::<Self>(text) {
            Ok(handover) if handover.version == VERSION => Ok(handover),
            Ok(handover) => Err(other(&handover.version)),
            Err(error) => match serde_json::from_str::<Versioned>(text) {
                Ok(Versioned { version }) if version != VERSION => Err(other(&version)),
                Ok(_) => Err(Failure::Option {
                    message: format!(
                        "the launcher and this executable are different builds of HPRM {VERSION}, and do not \
                         understand each other: {error}"
                    ),
                    hint: Some("build both from the same source: `hprm`, and then the executable"),
                }),
                Err(_) => Err(Failure::option(format!(
                    "the handover of the launcher is malformed: {error}"
                ))),
            },
        }
    }

    /// How to run the federate.
    ///
    /// # Errors
    ///
    /// If what is stated makes no sense.
    pub(crate) fn options(&self, program: Arc<Program>) -> Result<FederateOptions, Failure> {
        let malformed = |what: &dyn std::fmt::Display| {
            Failure::option(format!("the handover of the launcher is malformed: {what}"))
        };
        let Some(federate) = program.federate_named(&self.federate) else {
            return Err(malformed(&format!("{} has no federate {}", program.name, self.federate)));
        };
        let tls = self.tls.clone();
        Ok(FederateOptions {
            fingerprint: Arc::new(Fingerprint::new(self.facts.clone())),
            federate,
            rti: self.rti.parse().map_err(|error| malformed(&error))?,
            federation: self.federation.parse().map_err(|error| malformed(&error))?,
            security: Security {
                auth: self.auth,
                encrypt: self.encrypt,
                tls: tls.map(|(certificate, key, authority)| TlsFiles {
                    certificate,
                    key,
                    authority,
                }),
            },
            reach: Reach {
                connect_timeout: Duration::try_from_secs_f64(self.connect_timeout)
                    .map_err(|error| malformed(&error))?,
                advertise: self.advertise.clone(),
                ..Reach::default()
            },
            store: store_limits(self.store),
            trace: self.logical_trace.clone().map(|(file, of)| TraceShare::new(file, of)),
            record: TraceRequest::of_this_process(),
            launched: self.launched,
            end_process: (!self.launched).then_some(end_process as crate::EndProcess),
            program,
        })
    }
}

/// Ends this process while a body runs: neither destructors nor what the program does at its exit can run.
fn end_process(report: &Report) {
    console::show(Label::Error, report);
    signal_hook::low_level::exit(report.code);
}

/// Whether the standard input of this process is a handover, read already or not.
fn has_handover_as_stdin() -> bool {
    let link = std::fs::read_link("/proc/self/fd/0").unwrap_or_default();
    link.to_string_lossy().contains(NAME)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn said(text: &str) -> String {
        Handover::read(text).unwrap_err().to_string()
    }

    #[test]
    fn a_launcher_of_another_version_or_build_is_told_so() {
        assert_eq!(
            said(r#"{"version": "0.0.1"}"#),
            format!(
                "the launcher has version 0.0.1 of HPRM, and this executable was built with {VERSION}"
            )
        );
        let other_build = Handover::read(&format!(r#"{{"version": "{VERSION}"}}"#)).unwrap_err();
        assert!(
            other_build.to_string().starts_with(&format!(
                "the launcher and this executable are different builds of HPRM {VERSION}, and do not understand each \
                 other: missing field"
            )),
            "{other_build}"
        );
        assert!(other_build.report().hint.is_some());
        assert!(said("{").starts_with("the handover of the launcher is malformed: "));
    }
}
