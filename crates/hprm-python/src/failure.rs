//! Turning what Python raised into the end of a program.

use hprm::supervisor::Signal;
use hprm::{Failure, Kind, Raised, Report, Source};
use hprm_core::NoMemory;
use pyo3::exceptions::{PyMemoryError, PySyntaxError};
use pyo3::prelude::*;

/// The code of Python that Python cannot compile.
const SYNTAX: &str = "LF1001";
/// The code of Python that raises an exception while the program is loaded.
const LOADING: &str = "LF1009";

/// What `hprm._errors` makes of an exception.
#[derive(FromPyObject)]
pub(crate) struct Described {
    /// Which end of the program it is.
    end: String,
    code: i32,
    message: String,
    file: Option<String>,
    line: Option<u32>,
    column: Option<u32>,
    excerpt: Option<String>,
    diagnostic: Option<String>,
    details: Option<String>,
    hint: Option<String>,
}

impl Described {
    pub(crate) fn failure(self, source: Source) -> Failure {
        let Self { end, code, message, file, line, column, excerpt, diagnostic, details, hint } =
            self;
        let plain = Report::new(Kind::Program, message);
        let report = Report { diagnostic, file, line, column, excerpt, details, hint, ..plain };
        match end.as_str() {
            "left" => Failure::LeftFederation,
            "exited" => Failure::Exited { code },
            "quit" => Failure::Quit { said: report.message },
            "interrupted" => Failure::interrupted(),
            "unread" => Failure::Interrupted { signal: Signal::BROKEN_PIPE.0 },
            "mistake" => Failure::Mistakes(vec![report]),
            _ => Failure::Raised(Box::new(Raised { source, report })),
        }
    }
}

/// The exception that says so.
pub(crate) fn no_memory(error: NoMemory) -> PyErr {
    PyMemoryError::new_err(error.to_string())
}

/// The failure that `error` means, while something went on that is no reaction.
///
/// `sys.exit` is a choice and has nothing to say; Ctrl-C neither.
pub(crate) fn failure_in(py: Python<'_>, error: PyErr, what: &str) -> Failure {
    failure_at(py, error, Source::Other(what.to_owned()), ("", false))
}

/// The failure that `error` means, while the program in Python at `path` was loaded. It has the code of a diagnostic,
/// whatever has raised it.
pub(crate) fn failure_in_loading(py: Python<'_>, error: PyErr, path: &str) -> Failure {
    let code = if error.is_instance_of::<PySyntaxError>(py) { SYNTAX } else { LOADING };
    let mut failure = failure_at(py, error, Source::Other(format!("loading {path}")), ("", true));
    if let Failure::Raised(raised) = &mut failure {
        raised.report.diagnostic.get_or_insert_with(|| code.to_owned());
    }
    failure
}

/// The same, in this part of the program, about the `place` of the program that this stems from, if the error names
/// no other. It does if frames of the program's own files are on the way to it: `.lf` files, or, if the program
/// `is_bound`, files that Python has imported.
pub(crate) fn failure_at(
    py: Python<'_>,
    error: PyErr,
    source: Source,
    (place, is_bound): (&str, bool),
) -> Failure {
    let error = error.into_value(py).into_bound(py);
    let arguments = (&error, source.to_string(), place, is_bound);
    let described = py
        .import("hprm._errors")
        .and_then(|errors| errors.call_method1("describe", arguments))
        .and_then(|described| described.extract::<Described>());
    match described {
        Ok(described) => described.failure(source),
        Err(second) => {
            let message = format!("{source} raised {error}; and then {second}");
            Failure::raised(source, message)
        }
    }
}
