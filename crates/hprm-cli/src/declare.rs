//! Programs in plain Python: an interpreter makes their reactors and declares them, as JSON.
//!
//! What the program prints meanwhile goes to the standard error. What is wrong with it as Python, the
//! interpreter answers as data.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io;
use std::os::fd::AsFd;
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{ExitCode, Stdio};

use hprm::{Answer, Report};
use hprm_declared::NamedProgram;

use crate::args::Interpreter;
use crate::message::Error;
use crate::python;
use crate::signals::{self, Ended};

/// The class that a federation extends, itself or by another file.
const FEDERATION: &[u8] = b"Federation";

/// What an interpreter answers that the program has ended, as one does that shows its help.
const ENDED: &str = "null";

/// The file of a program: without the name of a reactor, as in `app.py:Vision`.
pub(crate) fn file_of(path: &Path) -> &Path {
    named(path).map_or(path, |named| Path::new(named.file))
}

/// The reactor that the name of a program in Python has behind its file.
pub(crate) fn reactor_of(path: &Path) -> Option<&str> {
    named(path)?.reactor
}

/// Whether a program is in Python, by its path.
pub(crate) fn is_python(path: &Path) -> bool {
    named(path).is_some()
}

fn named(path: &Path) -> Option<NamedProgram<'_>> {
    NamedProgram::parse(path.to_str()?)
}

/// Whether a program is in Python and, as far as its text shows, has no federates: then the interpreter that runs
/// it finds out what is wrong with it, and nothing needs to be declared before.
///
/// # Errors
///
/// If the file cannot be read.
pub(crate) fn is_alone(path: &Path) -> Result<bool, Error> {
    let Some(NamedProgram { file, .. }) = named(path) else { return Ok(false) };
    is_readable(Path::new(file))?;
    let text = fs::read(file).unwrap_or_default();
    let is_named = text.windows(FEDERATION.len()).any(|word| word == FEDERATION);
    Ok(!is_named)
}

/// Why there is no declaration of a program.
#[derive(Debug)]
pub(crate) struct Undeclared {
    /// What the command ends with.
    pub(crate) code: ExitCode,
    /// What is wrong with the program; nothing if the interpreter has been ended, and has said why, or a signal has
    /// ended it.
    pub(crate) reports: Vec<Report>,
    /// Whether the user has asked this command to stop.
    pub(crate) interrupted: bool,
}

/// Has an interpreter declare the program at `path`. Returns the declaration, or why there is none.
///
/// # Errors
///
/// If the program cannot be read, or no interpreter started.
pub(crate) fn declare<'a>(
    path: &Path,
    properties: &[String],
    arguments: impl IntoIterator<Item = &'a OsString>,
    interpreter: &Interpreter,
) -> Result<Result<String, Undeclared>, Error> {
    is_readable(file_of(path))?;
    let unable = |error: io::Error| {
        Error::new(format!(
            "cannot have {} declared: {}",
            path.display(),
            hprm::console::reason(&error)
        ))
    };
    let mut answer = Answer::new().map_err(unable)?;
    let python = python::find(interpreter)?;
    let mut command = python::module(&python, "declare");
    command.arg("--out").arg(answer.path());
    command.args(properties.iter().map(|stated| format!("--property={stated}")));
    command.arg("--").arg(path).args(arguments);
    let failed = |error: io::Error| Error::new(format!("cannot run {}: {error}", python.display()));
    let stderr = io::stderr().as_fd().try_clone_to_owned().map_err(failed)?;
    command.stdin(Stdio::null()).stdout(stderr);
    let ended = signals::run_to_end(command).map_err(failed)?;
    let interrupted = ended.asked.is_some();
    if interrupted || !ended.status.success() {
        // What the interpreter made of the signal is no mistake of the program.
        let reports = if interrupted { String::new() } else { answer.read().unwrap_or_default() };
        let reports = reports.lines().filter_map(|line| serde_json::from_str(line).ok()).collect();
        return Ok(Err(Undeclared { code: exit_code(ended, path), reports, interrupted }));
    }
    match answer.read().map_err(unable)? {
        text if text == ENDED => {
            let (code, reports) = (ExitCode::SUCCESS, Vec::new());
            Ok(Err(Undeclared { code, reports, interrupted: false }))
        }
        text if !text.is_empty() => Ok(Ok(text)),
        _ => Err(Error::new(format!("{} has not declared a program", path.display()))
            .hint("does it end the interpreter when it is imported?")),
    }
}

/// What the command ends with, after an interpreter that has ended so.
fn exit_code(Ended { status, asked }: Ended, path: &Path) -> ExitCode {
    if let Some(signal) = status.signal().filter(|signal| !signals::asks_to_stop(*signal)) {
        let what = format!("{} was killed by signal {signal}", path.display());
        Error::new(what).hint("it was declaring its reactors").show();
    }
    let code = match (asked.or(status.signal()), status.code()) {
        (Some(signal), _) => 128 + signal,
        (None, code) => code.unwrap_or(1),
    };
    u8::try_from(code).map_or(ExitCode::FAILURE, ExitCode::from)
}

/// Sees to it that a file can be read, so that a wrong path is one plain error.
///
/// # Errors
///
/// If it cannot.
pub(crate) fn is_readable(file: &Path) -> Result<(), Error> {
    let opened = File::open(file).and_then(|opened| opened.metadata());
    let reason = match opened {
        Ok(found) if found.is_dir() => "it is a folder".to_owned(),
        Ok(_) => return Ok(()),
        Err(error) => hprm::console::reason(&error),
    };
    let error = Error::new(format!("cannot read {}: {reason}", file.display()));
    match file.try_exists() {
        Ok(false) => Err(error.hint("is the path right? It is relative to the current directory")),
        _ => Err(error),
    }
}
