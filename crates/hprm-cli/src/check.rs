//! `hprm check`, and what every other command does before it starts anything.
//!
//! Finding mistakes is up to the front end; this shows them, as text or as JSON.

use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use hprm::{Label, Report};
use hprm_model::{CompileFailure, Compiled, Diagnostic, Severity, Sources, Span};
use serde_json::{Value, json};

use crate::args::Check;
use crate::declare::{self, Undeclared};
use crate::message::{self, Error};
use crate::source::{Outcome, Program};
use crate::{bodies, executable, explain};

/// The program, compiled; if it has errors, which have been shown then, what the command ends with.
///
/// # Errors
///
/// If the file is not a program at all.
pub(crate) fn checked(program: &Program<'_>) -> Result<Result<Compiled, ExitCode>, Error> {
    match program.compile()? {
        Outcome::Right(compiled) => Ok(Ok(*compiled)),
        Outcome::Undeclared(undeclared) => Ok(Err(show_undeclared(undeclared))),
        Outcome::Wrong(failure) => {
            show_mistakes(&failure);
            Ok(Err(ExitCode::FAILURE))
        }
    }
}

/// Shows why a program in Python has not declared itself; what the command ends with.
pub(crate) fn show_undeclared(Undeclared { code, reports, .. }: Undeclared) -> ExitCode {
    if !message::speaks_json() {
        show_reports(&reports);
        if codes_of(&reports).next().is_some() {
            message::print_error(b"\n");
            explain::offer(codes_of(&reports));
        }
    } else {
        reports.into_iter().for_each(|report| Error::from(report).show());
    }
    code
}

/// Shows what is wrong with a program.
pub(crate) fn show_mistakes(failure: &CompileFailure) {
    if message::speaks_json() {
        let reports = hprm::Failure::mistakes(failure, false).reports();
        reports.into_iter().for_each(|report| Error::from(report).show());
    } else {
        show(&failure.diagnostics, &failure.sources);
        explain::offer(failure.diagnostics.iter().map(|it| it.code));
    }
}

/// Shows the warnings of a program that has no errors.
pub(crate) fn show_warnings(compiled: &Compiled) {
    show(&compiled.warnings, &compiled.sources);
}

/// Checks programs, and shows what was found in the order in which they are named.
pub(crate) fn check(arguments: &Check) -> ExitCode {
    let looked_through = |path| {
        let (properties, words) = (Vec::new(), Vec::new());
        let interpreter = &arguments.interpreter;
        let program = Program { path, properties, arguments: words, interpreter };
        (path, program.check())
    };
    let mut found = Vec::new();
    for path in arguments.files.iter().map(PathBuf::as_path) {
        match looked_through(path) {
            (_, Ok(Outcome::Undeclared(undeclared))) if undeclared.interrupted => {
                return undeclared.code;
            }
            looked_through => found.push(looked_through),
        }
    }
    // Python has compiled what a program in Python consists of.
    let well = found.iter().filter(|(path, outcome)| {
        let is_lf = !declare::is_python(path) && !executable::is_program(path);
        matches!(outcome, Ok(Outcome::Right(_))) && is_lf
    });
    let well: Vec<_> = well.map(|(path, _)| *path).collect();
    let bodies = if arguments.no_bodies {
        Ok(Vec::new())
    } else {
        bodies::mistakes(&well, &arguments.interpreter)
    };
    let output = Output { json: arguments.json };
    let mut count = Count::default();
    let mut codes = Vec::new();
    for (path, outcome) in found {
        let (mut diagnostics, sources) = match outcome {
            Ok(Outcome::Right(compiled)) => (compiled.warnings, compiled.sources),
            Ok(Outcome::Wrong(failure)) => (failure.diagnostics, failure.sources),
            Ok(Outcome::Undeclared(Undeclared { reports, .. })) => {
                count.errors += reports.len().max(1);
                codes.extend(codes_of(&reports).map(str::to_owned));
                output.undeclared(&reports, path);
                continue;
            }
            // The other files are of interest all the same.
            Err(error) => {
                count.errors += 1;
                output.error(&error, Some(path));
                continue;
            }
        };
        let mistakes = bodies.iter().flatten().filter(|mistake| mistake.is_of(path));
        diagnostics.extend(mistakes.filter_map(|mistake| mistake.diagnostic(&sources)));
        diagnostics.sort_by_key(|diagnostic| (diagnostic.span, diagnostic.code));
        count.add(&diagnostics);
        codes.extend(diagnostics.iter().map(|it| it.code.to_owned()));
        output.diagnostics(&diagnostics, &sources);
    }
    if let Err(error) = &bodies {
        count.warnings += 1;
        output.error(error, None);
    }
    if !arguments.json {
        explain::offer(codes);
        message::print_line(&count.summary(arguments.files.len()));
    }
    if count.errors == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// How findings are shown.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
struct Output {
    json: bool,
}

impl Output {
    fn diagnostics(self, diagnostics: &[Diagnostic], sources: &Sources) {
        if self.json {
            print_json(diagnostics, sources);
        } else {
            show(diagnostics, sources);
        }
    }

    /// Why the Python of a program does not declare it.
    fn undeclared(self, reports: &[Report], path: &Path) {
        if !self.json {
            show_reports(reports);
            if !reports.is_empty() {
                message::print_error(b"\n");
            }
            return;
        }
        let file = declare::file_of(path);
        if reports.is_empty() {
            let what = format!("{} does not declare a program", path.display());
            return self.error(&Error::new(what).hint("the standard error says why"), Some(file));
        }
        for report in reports {
            message::print_line(&report_as_json(report, file).to_string());
        }
    }

    /// What concerns a file as a whole; or all of them, and then it is a warning.
    fn error(self, error: &Error, file: Option<&Path>) {
        match file {
            _ if self.json => {
                let file = file.map(|path| json!({ "file": path.display().to_string() }));
                let (code, severity) =
                    if file.is_some() { ("LF0101", "error") } else { ("LF1002", "warning") };
                let report = error.report();
                let line = json!({
                    "code": code,
                    "severity": severity,
                    "message": report.message,
                    "at": file,
                    "hint": report.hint,
                    "labels": [],
                });
                message::print_line(&line.to_string());
            }
            Some(_) => error.show(),
            None => error.show_as_warning(),
        }
    }
}

#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
struct Count {
    errors: usize,
    warnings: usize,
}

impl Count {
    fn add(&mut self, diagnostics: &[Diagnostic]) {
        let errors = diagnostics.iter().filter(|d| d.severity == Severity::Error).count();
        self.errors += errors;
        self.warnings += diagnostics.len() - errors;
    }

    /// `2 programs checked: 1 error, no warnings`.
    fn summary(self, programs: usize) -> String {
        let number = |count: usize, noun: &str| match count {
            0 => format!("no {noun}s"),
            1 => format!("1 {noun}"),
            _ => format!("{count} {noun}s"),
        };
        let [programs, errors, warnings] =
            [(programs, "program"), (self.errors, "error"), (self.warnings, "warning")]
                .map(|(count, noun)| number(count, noun));
        format!("{programs} checked: {errors}, {warnings}")
    }
}

/// Shows diagnostics on the standard error.
pub(crate) fn show(diagnostics: &[Diagnostic], sources: &Sources) {
    let color = message::color(&io::stderr());
    for diagnostic in diagnostics {
        let text = hprm_model::render(diagnostic, sources, color);
        message::print_error(format!("{}\n\n", text.trim_end()).as_bytes());
    }
}

/// Shows what an interpreter has answered on the standard error.
fn show_reports(reports: &[Report]) {
    let color = message::color(&io::stderr());
    let texts: Vec<_> = reports.iter().map(|it| it.text(Label::Error, color) + "\n").collect();
    message::print_error(texts.join("\n").as_bytes());
}

fn codes_of(reports: &[Report]) -> impl Iterator<Item = &str> {
    reports.iter().filter_map(|report| report.diagnostic.as_deref())
}

/// As a diagnostic, at a place in the program's `file` if the report names no other.
fn report_as_json(report: &Report, file: &Path) -> Value {
    let mut at = json!({ "file": file.display().to_string() });
    if let (Some(file), Some(line)) = (&report.file, report.line) {
        let column = report.column.unwrap_or(1);
        at = json!({
            "file": file,
            "line": line,
            "column": column,
            "end_line": line,
            "end_column": column,
        });
    }
    json!({
        "code": report.diagnostic.as_deref().unwrap_or("LF0101"),
        "severity": "error",
        "message": report.message,
        "at": at,
        "hint": report.hint,
        "labels": [],
    })
}

fn print_json(diagnostics: &[Diagnostic], sources: &Sources) {
    for diagnostic in diagnostics {
        message::print_line(&as_json(diagnostic, sources).to_string());
    }
}

fn as_json(diagnostic: &Diagnostic, sources: &Sources) -> Value {
    let labels: Vec<_> = diagnostic
        .labels
        .iter()
        .map(|label| json!({ "message": label.text, "at": place(label.span, sources) }))
        .collect();
    json!({
        "code": diagnostic.code,
        "severity": match diagnostic.severity {
            Severity::Error => "error",
            Severity::Warning => "warning",
        },
        "message": diagnostic.message,
        "at": place(diagnostic.span, sources),
        "hint": diagnostic.hint,
        "labels": labels,
    })
}

fn place(span: Span, sources: &Sources) -> Value {
    let start = sources.position(span);
    let end = sources.position(Span { start: span.end, ..span });
    json!({
        "file": sources.path(span.file),
        "line": start.line,
        "column": start.column,
        "end_line": end.line,
        "end_column": end.column,
    })
}

#[cfg(test)]
mod tests {
    use super::Count;

    #[test]
    fn the_summary_counts() {
        let count = Count { errors: 1, warnings: 0 };
        assert_eq!(count.summary(2), "2 programs checked: 1 error, no warnings");
        assert_eq!(
            Count { errors: 0, warnings: 3 }.summary(1),
            "1 program checked: no errors, 3 warnings"
        );
    }
}
