//! Mistakes in the Python of programs, which only Python finds.
//!
//! One interpreter looks through all programs, runs nothing of them, and answers in JSON.

use std::path::{Path, PathBuf};
use std::process::Stdio;

use hprm::Descriptions;
use hprm_model::{Diagnostic, Position, Severity, Sources};
use serde::Deserialize;

use crate::args::Interpreter;
use crate::message::Error;
use crate::python;

/// A mistake, as the interpreter tells of it.
#[derive(Clone, PartialEq, Eq, Debug, Deserialize)]
pub(crate) struct Mistake {
    /// The program, as it was named.
    program: PathBuf,
    code: String,
    severity: String,
    message: String,
    hint: Option<String>,
    file: String,
    line: u32,
    column: u32,
    end_line: u32,
    end_column: u32,
}

/// The codes of what the interpreter finds; `hprm._findings` says what they mean.
const CODES: [&str; 6] = ["LF1001", "LF1003", "LF1004", "LF1005", "LF1006", "LF1007"];

/// The mistakes in these programs, which have no others.
///
/// # Errors
///
/// If there is no interpreter, or it does not answer: a warning, for nothing is known to be wrong.
pub(crate) fn mistakes(
    programs: &[&Path],
    interpreter: &Interpreter,
) -> Result<Vec<Mistake>, Error> {
    if programs.is_empty() {
        return Ok(Vec::new());
    }
    let unchecked = |reason: &dyn std::fmt::Display| {
        Error::new(format!("the Python of reactions was not looked into: {reason}"))
            .hint("hprm doctor tells what is missing; --no-bodies does without")
    };
    let python = python::find(interpreter).map_err(|error| unchecked(&error.report().message))?;
    let mut command = python::module(&python, "syntax");
    // It compiles the programs again, and need not ask executables again.
    let known = Descriptions::known().map_err(|error| unchecked(&error))?;
    known.hand_to(&mut command);
    let answer = command.arg("--").args(programs).stdin(Stdio::null()).output();
    let answer = answer.map_err(|error| unchecked(&error))?;
    if !answer.status.success() {
        let said = String::from_utf8_lossy(&answer.stderr).into_owned();
        return Err(unchecked(&reason(&said)));
    }
    let text = String::from_utf8_lossy(&answer.stdout);
    let parsed = text.lines().map(serde_json::from_str).collect::<Result<_, _>>();
    parsed.map_err(|error| unchecked(&error))
}

/// Why Python has failed, of what it has said: an error without its hint, or the end of a traceback.
fn reason(said: &str) -> &str {
    let mut lines = said.lines().rev().filter(|line| !line.starts_with("  hint: "));
    let last = lines.find(|line| !line.trim().is_empty()).unwrap_or("Python has failed");
    last.strip_prefix("error: ").unwrap_or(last)
}

impl Mistake {
    /// Whether it is one of the program at `path`.
    pub(crate) fn is_of(&self, path: &Path) -> bool {
        self.program == path
    }

    /// It as a diagnostic; none if the file has changed so much that it is not read any more.
    pub(crate) fn diagnostic(&self, sources: &Sources) -> Option<Diagnostic> {
        let place = |line, column| sources.at(&self.file, Position { line, column });
        let span = place(self.line, self.column)?;
        let end = place(self.end_line, self.end_column)?;
        Some(Diagnostic {
            code: CODES.into_iter().find(|code| *code == self.code).unwrap_or(CODES[0]),
            severity: match self.severity.as_str() {
                "warning" => Severity::Warning,
                _ => Severity::Error,
            },
            message: self.message.clone(),
            span: span.to(end),
            labels: Vec::new(),
            hint: self.hint.clone(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::reason;

    #[test]
    fn what_python_has_said_is_told_without_its_hint_and_traceback() {
        let said = "error: HPRM cannot be loaded: no memory\n  hint: is memory left?\n";
        assert_eq!(reason(said), "HPRM cannot be loaded: no memory");
        assert_eq!(
            reason("Traceback (most recent call last):\n  x\nMemoryError\n\n"),
            "MemoryError"
        );
        assert_eq!(reason(""), "Python has failed");
    }
}
