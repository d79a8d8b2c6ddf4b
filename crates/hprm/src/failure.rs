//! What can go wrong with a running program, as values.
//!
//! A [`Failure`] says why a loop ends before its program does, in fields. How that is shown is up to its
//! [`Report`], and what the process ends with is decided here, by [`Failure::exit_code`].

mod reaction;
mod report;

use std::fmt::{self, Display};
use std::io;
use std::os::unix::fs::FileTypeExt;
use std::path::{Path, PathBuf};

use hprm_core::{ProgramError, Tag};
use hprm_federated::{Fault, Missing, Refusal};
use hprm_model::{Severity, render};

use crate::Address;
use crate::link::descriptors::advice;
use crate::supervisor::Signal;
pub use reaction::ReactionFailure;
pub use report::{Kind, Label, Report};

/// Why a program ends before its last tag.
///
/// A new kind of failure is a new variant, with its kind in [`Self::kind`] and, if people can do
/// something about it, its hint in the [`Report`].
///
/// Its `Debug` text is that for people, because that is what a `main` that returns it prints.
///
/// ```
/// use hprm::prelude::*;
///
/// let mut program = Program::new("Failing");
/// program.reactor("a", (), |reactor| {
///     reactor.reaction().on(Startup).run(|(), _| Err::<(), _>("no camera"));
/// });
/// let failure = program.run().unwrap_err();
/// assert!(failure.to_string().contains("no camera"));
/// ```
#[derive(Clone, PartialEq, Eq, thiserror::Error)]
pub enum Failure {
    /// This federate has left the federation by itself, for example by `sys.exit(0)`. That is no error.
    #[error("the program has left")]
    LeftFederation,
    /// A signal has asked the program to stop.
    #[error("stopped by signal {signal}")]
    Interrupted {
        /// Its number.
        signal: i32,
    },
    /// The program has ended itself with an exit code.
    #[error("exited with code {code}")]
    Exited {
        /// The code that the program gave.
        code: i32,
    },
    /// The program has ended itself with a text.
    #[error("{said}")]
    Quit {
        /// The text.
        said: String,
    },
    /// Code of the program has failed: a reaction has raised an exception, for example.
    #[error("{}", .0.report.message)]
    Raised(Box<Raised>),
    /// A reaction of a program in Rust has returned an error, which is the source of this one.
    #[error(transparent)]
    Reaction(Box<ReactionFailure>),
    /// The parts of the program do not fit together.
    #[error(transparent)]
    Program(#[from] ProgramError),
    /// The text of the program has mistakes.
    #[error("{}", mistakes(.0))]
    Mistakes(Vec<Report>),
    /// An option, a target property or an environment variable has a value that HPRM cannot use.
    #[error("{message}")]
    Option {
        /// What is wrong.
        message: String,
        /// What to do about it.
        hint: Option<&'static str>,
    },
    /// An operation of the system has failed.
    #[error("{message}")]
    System {
        /// What cannot be done, and why.
        message: String,
        /// What to do about it.
        hint: Option<String>,
    },
    /// What was asked for cannot be done, although its options are right: a process cannot be started, for
    /// example.
    #[error("{message}")]
    Command {
        /// What cannot be done, and why.
        message: String,
        /// What to do about it.
        hint: Option<String>,
    },
    /// The RTI or a federate cannot listen at an address.
    #[error("{}cannot listen at {address}: {reason}", if *.rti { "the RTI " } else { "" })]
    Listen {
        /// Whether it is the RTI.
        rti: bool,
        /// Where.
        address: Address,
        /// Why not.
        reason: String,
        /// What to do about it.
        hint: Option<&'static str>,
    },
    /// The logical trace cannot be written.
    #[error("cannot write the trace {}: {reason}", .file.display())]
    Trace {
        /// Which file it is.
        file: PathBuf,
        /// Why.
        reason: String,
        /// What to do about it.
        hint: Option<&'static str>,
    },
    /// There is no RTI to join.
    #[error("no RTI at {address}: {reason}")]
    NoRti {
        /// Where it should be.
        address: Address,
        /// What happened when this process tried to connect.
        reason: String,
        /// What to do about it.
        hint: String,
    },
    /// There is an RTI, and the handshake with it has failed.
    #[error("the RTI at {address}: {reason}")]
    Unauthenticated {
        /// Where it is.
        address: Address,
        /// Why.
        reason: String,
    },
    /// The RTI does not let this federate join.
    #[error("the RTI refuses this federate: {0}")]
    Refused(Refusal),
    /// Federates have not joined in time: the outcome of their RTI.
    #[error("{0}")]
    Missing(Missing),
    /// The link to the RTI has ended.
    #[error("federation {program}: the link to the RTI is lost")]
    RtiLost {
        /// The program of the federation.
        program: String,
    },
    /// A link cannot be used any more.
    #[error("{0}")]
    Link(String),
    /// What comes over a link does not follow the protocol.
    #[error("the federation's protocol: {reason}")]
    Protocol {
        /// What is wrong with it.
        reason: String,
        /// What to do about it.
        hint: Option<&'static str>,
    },
    /// An operation of the object store has failed.
    #[error("the object store: {0}")]
    Store(String),
    /// There is no memory for a message.
    #[error("{0}")]
    Memory(String),
    /// Another federate has failed, and this one ends for that reason. The host knows the report.
    #[error("{}", .0.message)]
    OtherFederateFailed(Box<Report>),
    /// A federate has failed: the outcome of the RTI of its federation.
    #[error("{}", .0.message)]
    FederateFailed(Box<Report>),
}

/// The failure of code of a program: which code it is, and what happened.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Raised {
    /// Which code.
    pub source: Source,
    /// What happened, where, and what to do about it. Its kind follows from the source.
    pub report: Report,
}

/// Code of a program.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Source {
    /// A body of a reaction.
    Reaction {
        /// Its full name.
        name: String,
        /// When it ran.
        tag: Tag,
    },
    /// A thread that the program has started.
    Thread {
        /// Its name.
        name: String,
    },
    /// The serialization of a value that a connection carries.
    Connection {
        /// The output.
        from: String,
        /// The input.
        to: String,
    },
    /// Something else: loading, perhaps.
    Other(String),
}

impl Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Reaction { name, .. } => write!(f, "reaction {name}"),
            Self::Thread { name } => write!(f, "thread {name}"),
            Self::Connection { from, to } => {
                write!(f, "sending a value on connection {from} -> {to}")
            }
            Self::Other(what) => f.write_str(what),
        }
    }
}

impl fmt::Debug for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let reports = match self {
            Self::Mistakes(reports) => reports.clone(),
            failure => vec![failure.report()],
        };
        let texts: Vec<_> = reports.iter().map(|report| report.text(Label::Error, false)).collect();
        let text = texts.join("\n");
        // A `main` that returns it has said that it is an error.
        match text.strip_prefix("error[").and_then(|text| text.split_once(']')) {
            Some((code, text)) => write!(f, "{code}{text}"),
            None => f.write_str(text.strip_prefix("error: ").unwrap_or(&text)),
        }
    }
}

impl Failure {
    /// Ctrl-C has stopped the program.
    #[must_use]
    pub const fn interrupted() -> Self {
        Self::Interrupted { signal: Signal::INTERRUPT.0 }
    }

    /// An operation of the system has failed; `what` says what cannot be done.
    #[must_use]
    pub fn system(what: impl Display, error: &io::Error) -> Self {
        let hint = advice(error).map(str::to_owned);
        Self::System { message: format!("{what}: {error}"), hint }
    }

    /// The logical trace `file` cannot be written.
    #[must_use]
    pub fn trace(file: &Path, error: &io::Error) -> Self {
        let hint = match error.kind() {
            io::ErrorKind::FileTooLarge => {
                Some("ulimit -f limits how long a file may be: let it be longer, or unlimited")
            }
            io::ErrorKind::StorageFull => {
                Some("make room there, or write the trace to another disk")
            }
            _ => None,
        };
        Self::Trace { file: file.to_owned(), reason: error.to_string(), hint }
    }

    /// The outcome of a run, which includes that of writing its trace. If both have failed, the failure of the
    /// run counts.
    pub(crate) fn with_trace_outcome(
        outcome: Result<(), Self>,
        trace_outcome: Result<(), Self>,
    ) -> Result<(), Self> {
        match outcome {
            Err(failure)
                if failure.needs_report() || matches!(failure, Self::OtherFederateFailed(_)) =>
            {
                Err(failure)
            }
            outcome => trace_outcome.and(outcome),
        }
    }

    /// The RTI, or else a federate, cannot listen at an address.
    pub(crate) fn listen(rti: bool, address: &Address, error: &io::Error) -> Self {
        let (address, reason) = (address.clone(), error.to_string());
        let hint = match (error.kind(), &address) {
            (io::ErrorKind::AddrInUse, Address::Path(path)) if !may_be_socket(path) => {
                Some("there is something else than a socket at this path: choose another one")
            }
            (io::ErrorKind::AddrInUse, Address::Path(_)) => Some(
                "a process listens there, or one that has ended has left this path: remove it then, or choose \
                 another",
            ),
            (io::ErrorKind::AddrInUse, _) => Some(
                "another process listens there: end it (`ss -ltnxp` names it, if it is yours), or choose \
                 another address; of TCP ports, 0 is a free one",
            ),
            (io::ErrorKind::AddrNotAvailable, _) => Some(
                "no interface of this machine has this address: `ip address` lists those that it has; 0.0.0.0 \
                 stands for all of them",
            ),
            (io::ErrorKind::PermissionDenied, _) => {
                Some("choose a port from 1024 on, or a path in a folder of yours")
            }
            _ => advice(error),
        };
        Self::Listen { rti, address, reason, hint }
    }

    /// Code of the program has failed, and the message says all.
    #[must_use]
    pub fn raised(source: Source, message: impl Into<String>) -> Self {
        let report = Report::new(Kind::Code, message);
        Self::Raised(Box::new(Raised { source, report }))
    }

    /// An option or a property is wrong, and the message says all.
    #[must_use]
    pub fn option(message: impl Into<String>) -> Self {
        Self::Option { message: message.into(), hint: None }
    }

    /// What was asked for cannot be done, and the message says all.
    #[must_use]
    pub fn command(message: impl Into<String>) -> Self {
        Self::Command { message: message.into(), hint: None }
    }

    /// What comes over a link does not follow the protocol.
    pub(crate) fn protocol(reason: &dyn Display) -> Self {
        let hint = "the sender is not a federate of this version of hprm, or has a defect: run the same \
                    version everywhere";
        Self::Protocol { reason: reason.to_string(), hint: Some(hint) }
    }

    /// An operation of the object store has failed.
    #[must_use]
    pub(crate) fn store(reason: &dyn Display) -> Self {
        Self::Store(reason.to_string())
    }

    /// The errors that the front end has found; with `color`, their text for people is coloured.
    #[must_use]
    pub fn mistakes(found: &hprm_model::CompileFailure, color: bool) -> Self {
        let hprm_model::CompileFailure { diagnostics, sources, .. } = found;
        let errors = diagnostics.iter().filter(|found| found.severity == Severity::Error);
        let report = |found: &hprm_model::Diagnostic| {
            let stated = sources.is_stated(found.span.file);
            let path = sources.path(found.span.file);
            let position = (!stated).then(|| sources.position(found.span));
            let (kind, message) = match stated {
                true => (Kind::Option, format!("{path}: {}", found.message)),
                false => (Kind::Program, found.message.clone()),
            };
            Report {
                diagnostic: Some(found.code.to_string()),
                file: (!stated).then(|| path.to_owned()),
                line: position.map(|position| position.line),
                column: position.map(|position| position.column),
                hint: found.hint.clone(),
                rendered: Some(render(found, sources, color).trim_end().to_owned()),
                ..Report::new(kind, message)
            }
        };
        Self::Mistakes(errors.map(report).collect())
    }

    /// Adds a hint to a failure of code of the program, or to [`Self::Command`]. It comes before another one.
    #[must_use]
    pub fn with_hint(mut self, hint: &str) -> Self {
        let place = match &mut self {
            Self::Raised(raised) => &mut raised.report.hint,
            Self::Command { hint, .. } => hint,
            _ => return self,
        };
        *place = Some(match place.take() {
            Some(other) => format!("{hint}; {other}"),
            None => hint.to_owned(),
        });
        self
    }

    /// What kind of thing has happened.
    #[must_use]
    pub fn kind(&self) -> Kind {
        match self {
            Self::LeftFederation => Kind::Left,
            Self::Interrupted { .. } => Kind::Interrupted,
            Self::Exited { .. } => Kind::Exit,
            Self::Quit { .. } => Kind::Quit,
            Self::Raised(raised) => match raised.source {
                Source::Reaction { .. } => Kind::Reaction,
                Source::Thread { .. } => Kind::Thread,
                Source::Connection { .. } => Kind::Connection,
                Source::Other(_) => Kind::Code,
            },
            Self::Reaction(_) => Kind::Reaction,
            Self::Program(_) => Kind::Program,
            Self::Mistakes(reports) => reports.first().map_or(Kind::Program, |report| report.kind),
            Self::Option { .. } => Kind::Option,
            Self::Command { .. } => Kind::Command,
            Self::System { .. } | Self::Listen { .. } => Kind::System,
            Self::Trace { .. } => Kind::Trace,
            Self::NoRti { .. } | Self::Unauthenticated { .. } | Self::RtiLost { .. } => Kind::Rti,
            Self::Refused(_) => Kind::Refused,
            Self::Missing(_) => Kind::Absent,
            Self::Link(_) => Kind::Link,
            Self::Protocol { .. } => Kind::Protocol,
            Self::Store(_) => Kind::Store,
            Self::Memory(_) => Kind::Memory,
            Self::OtherFederateFailed(report) | Self::FederateFailed(report) => report.kind,
        }
    }

    /// The exit code of a process that has failed like this.
    #[must_use]
    pub fn exit_code(&self) -> i32 {
        match self {
            Self::LeftFederation => 0,
            Self::Interrupted { signal } => exit_code(Signal(*signal).exit_code()),
            Self::Exited { code } => exit_code(*code),
            Self::FederateFailed(report) => exit_code(report.code),
            _ => 1,
        }
    }

    /// Whether this process has to report the failure to the user. It need not if the program ended as asked,
    /// or if another process reports the failure.
    #[must_use]
    pub fn needs_report(&self) -> bool {
        !matches!(
            self,
            Self::LeftFederation
                | Self::Interrupted { .. }
                | Self::Exited { .. }
                | Self::OtherFederateFailed(_)
        )
    }

    /// The failure as one report, for example for other processes.
    #[must_use]
    pub fn report(&self) -> Report {
        let plain = Report { code: self.exit_code(), ..Report::new(self.kind(), self.to_string()) };
        match self {
            Self::Raised(raised) => raised.report(plain),
            Self::Reaction(failure) => failure.report(plain),
            Self::OtherFederateFailed(report) | Self::FederateFailed(report) => {
                Report { code: plain.code, ..(**report).clone() }
            }
            Self::Mistakes(reports) => match reports.as_slice() {
                [report] => report.clone(),
                _ => plain,
            },
            Self::Quit { said } => Report { rendered: Some(said.clone()), ..plain },
            _ => Report { hint: self.hint().map(str::to_owned), ..plain },
        }
    }

    /// The reports that the user and programs that watch get, one by one; none if no report is needed.
    #[must_use]
    pub fn reports(&self) -> Vec<Report> {
        match self {
            Self::Mistakes(reports) => reports.clone(),
            failure if !failure.needs_report() => Vec::new(),
            failure => vec![failure.report()],
        }
    }

    /// What to do about it.
    fn hint(&self) -> Option<&str> {
        match self {
            Self::Option { hint, .. }
            | Self::Listen { hint, .. }
            | Self::Trace { hint, .. }
            | Self::Protocol { hint, .. } => *hint,
            Self::Command { hint, .. } | Self::System { hint, .. } => hint.as_deref(),
            Self::Program(error) => program_hint(error),
            Self::NoRti { hint, .. } => Some(hint),
            Self::Missing(_) => Some(
                "start them with `hprm federate`, or allow more time with `hprm rti --join-timeout`",
            ),
            Self::Refused(refusal) => refusal.hint(),
            Self::Memory(_) => Some(
                "drop values sooner, or let this process have more memory (ulimit -v, the limit of its \
                 container); what fits into the object store of its sender needs none in its receivers",
            ),
            _ => None,
        }
    }
}

impl Raised {
    fn report(&self, plain: Report) -> Report {
        let (reaction, tag) = match &self.source {
            Source::Reaction { name, tag } => (Some(name.clone()), Some((tag.time, tag.microstep))),
            _ => (None, None),
        };
        Report { kind: plain.kind, code: plain.code, reaction, tag, ..self.report.clone() }
    }
}

/// The exit code for the code of a failure: its last eight bits, which the system keeps, but never the zero that
/// means success.
#[must_use]
pub fn exit_code(code: i32) -> i32 {
    match code & 0xff {
        0 => 1,
        code => code,
    }
}

impl From<Fault> for Failure {
    fn from(fault: Fault) -> Self {
        match fault {
            // The program sends too many parts in one message, so the protocol is not at fault.
            Fault::TooManyParts { .. } => Self::Protocol { reason: fault.to_string(), hint: None },
            fault => Self::protocol(&fault),
        }
    }
}

/// What to do about a graph that the scheduler refuses, in a program that is built by calls.
fn program_hint(error: &ProgramError) -> Option<&'static str> {
    match error {
        ProgramError::CausalityLoop { .. } => Some(
            "give one of the connections a delay, `.after(Duration::ZERO)`, or reorder the reactions",
        ),
        ProgramError::TwoSources { .. } => Some(
            "a port has one source, a connection or a reaction, and `connect(from, to)` leads from an output of one \
             reactor to an input of another one. For several sources declare a multiport, `inputs(name, 2)`, and \
             connect each to a channel of its own",
        ),
        ProgramError::ConnectionLoop { .. } => Some("remove one of the connections"),
        ProgramError::InitialMode { .. } => {
            Some("declare one of the modes by `initial_mode`, and the others by `mode`")
        }
        _ => None,
    }
}

/// Whether there may be a socket at a path, for all that this process can see.
fn may_be_socket(path: &str) -> bool {
    std::fs::symlink_metadata(path).map_or(true, |found| found.file_type().is_socket())
}

fn mistakes(reports: &[Report]) -> String {
    let messages: Vec<_> = reports.iter().map(|report| report.message.as_str()).collect();
    messages.join("\n")
}
