//! How the command speaks: `error: ...`, an indented `hint: ...`, and colour where it is wanted; or JSON
//! for programs that start it. What a failure says is in its [`Report`].
//!
//! Diagnostics of programs look different; they come from the renderer of the front end.

use std::fs::File;
use std::io::{self, ErrorKind, Write};
use std::path::Path;
use std::process::ExitCode;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

use hprm::console::{self, show};
pub(crate) use hprm::console::{color, print, print_error, reason};
use hprm::{Failure, Kind, Label, Report};
use serde_json::{Value, json};

/// What went wrong, and what to do about it.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Error(Box<Report>);

impl Error {
    /// That the command cannot do what it was asked for. The first line of `message` is a sentence
    /// without a period; more may follow.
    pub(crate) fn new(message: impl Into<String>) -> Self {
        Self::of(Kind::Command, message)
    }

    /// That an option or an environment variable cannot be obeyed.
    pub(crate) fn option(message: impl Into<String>) -> Self {
        Self::of(Kind::Option, message)
    }

    /// A failure of some kind.
    pub(crate) fn of(kind: Kind, message: impl Into<String>) -> Self {
        Self::from(Report::new(kind, message))
    }

    /// Adds what to do about it.
    pub(crate) fn hint(self, hint: impl Into<String>) -> Self {
        Self::from(self.0.hint(hint))
    }

    /// Says what the command ends with.
    pub(crate) fn code(self, code: i32) -> Self {
        Self::from(Report { code, ..*self.0 })
    }

    /// What is told.
    pub(crate) fn report(&self) -> &Report {
        &self.0
    }

    /// Writes it to the standard error, in one piece.
    pub(crate) fn show(&self) {
        if let Some(mut file) = ALSO.get() {
            // The process that reads it gets less then, and the exit code.
            let _ = writeln!(file, "{}", self.0.json());
        }
        match speaks_json() {
            true => print_error(format!("{}\n", self.0.json()).as_bytes()),
            false => show(Label::Error, &self.0),
        }
    }

    /// Writes it to the standard error as a warning, after which the command goes on.
    pub(crate) fn show_as_warning(&self) {
        show(Label::Warning, &self.0);
    }

    /// For programs.
    pub(crate) fn as_json(&self) -> Value {
        json!(self.0)
    }
}

impl From<Report> for Error {
    fn from(report: Report) -> Self {
        Self(Box::new(report))
    }
}

impl From<Error> for Report {
    fn from(error: Error) -> Self {
        *error.0
    }
}

impl From<&Failure> for Error {
    fn from(failure: &Failure) -> Self {
        Self::from(failure.report())
    }
}

impl From<Failure> for Error {
    fn from(failure: Failure) -> Self {
        Self::from(&failure)
    }
}

/// Shows what the launcher tells.
pub(crate) fn tell(label: Label, report: Report) {
    let error = Error::from(report);
    match label {
        Label::Error => error.show(),
        Label::Warning => error.show_as_warning(),
    }
}

/// Where failures are written besides.
static ALSO: OnceLock<File> = OnceLock::new();

/// Has failures written to a file from now on, as JSON, one object a line. If it cannot be written, that is no failure.
pub(crate) fn also_write_to(path: Option<&Path>) {
    if let Some(file) = path.and_then(|path| File::options().append(true).open(path).ok()) {
        ALSO.get_or_init(|| file);
    }
}

/// Whether failures are told as JSON.
static TO_PROGRAMS: AtomicBool = AtomicBool::new(false);

/// Has failures told as JSON from now on, one object a line, if that is wanted.
pub(crate) fn speak_json(json: bool) {
    TO_PROGRAMS.store(json, Ordering::Relaxed);
}

/// Whether failures are told as JSON.
pub(crate) fn speaks_json() -> bool {
    TO_PROGRAMS.load(Ordering::Relaxed)
}

/// Has a process that this one becomes, or starts, tell of failures in the same way.
pub(crate) fn json_option() -> Option<&'static str> {
    speaks_json().then_some("--json")
}

/// For commands that print one JSON object: it has the key `error` if there is nothing else to print.
///
/// # Errors
///
/// As `outcome`, if text is wanted.
pub(crate) fn or_json(json: bool, outcome: Result<ExitCode, Error>) -> Result<ExitCode, Error> {
    match outcome {
        Err(error) if json => {
            print_line(&json!({ "error": error.as_json() }).to_string());
            Ok(ExitCode::FAILURE)
        }
        outcome => outcome,
    }
}

/// Whether a result could not be written.
static UNWRITTEN: AtomicBool = AtomicBool::new(false);

/// Writes a line to the standard output; it is dropped if the reader has closed it.
pub(crate) fn print_line(line: &str) {
    if let Err(error) = print(format!("{line}\n").as_bytes())
        && error.kind() != ErrorKind::BrokenPipe
        && !UNWRITTEN.swap(true, Ordering::Relaxed)
    {
        unwritable(&error).show();
    }
}

/// Whether [`print_line`] has failed, and has reported it.
pub(crate) fn is_unwritten() -> bool {
    UNWRITTEN.load(Ordering::Relaxed)
}

/// The error that the standard output cannot be written.
pub(crate) fn unwritable(error: &io::Error) -> Error {
    console::unwritable(error).into()
}
