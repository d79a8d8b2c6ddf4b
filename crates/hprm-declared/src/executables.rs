//! Reactors that are executables: what they declare becomes part of the program that names them.

use std::collections::BTreeSet;

use hprm_model::{
    Diagnostic, Executable, ExecutableFederate, Library, Overrides, Refusal, Refused, Report,
};

use crate::document::{self, Document};
use crate::{Declaration, Malformed, reactors};

/// What an executable has declared.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Described {
    /// What starts it from anywhere: its absolute path, and its arguments.
    pub command: Vec<String>,
    /// Its declaration, as JSON.
    pub text: String,
}

/// Has all executables that a program needs describe themselves, each once for each set of parameters, and puts what
/// they declare into its library. `ask` returns why there is no declaration, if there is none; what to do about that may be a second line.
pub fn describe(
    library: &mut Library,
    overrides: &Overrides,
    mut ask: impl FnMut(&Executable) -> Result<Described, String>,
    report: &mut Report,
) {
    let executables = library.executables(overrides, report);
    if report.has_errors() {
        return;
    }
    // What is wrong with an executable is told once, not for each set of parameters.
    let mut wrong = BTreeSet::new();
    for executable in executables {
        if wrong.contains(&executable.span) {
            continue;
        }
        let known = report.errors();
        let filled =
            ask(&executable).and_then(|described| fill(library, &executable, described, report));
        if let Err(reason) = filled {
            let (reason, hint) = match reason.split_once("\n") {
                Some((reason, hint)) => (reason.to_owned(), Some(hint.to_owned())),
                None => (reason, None),
            };
            report.add(Diagnostic::error("LF1102", executable.span, reason).maybe_hint(hint));
        }
        if report.errors() > known {
            wrong.insert(executable.span);
        }
        if report.errors() > known && report.is_full() {
            return;
        }
    }
}

fn fill(
    library: &mut Library,
    executable: &Executable,
    Described { command, text }: Described,
    report: &mut Report,
) -> Result<(), String> {
    let path = command.first().cloned().unwrap_or_default();
    let malformed = |Malformed(why): Malformed| {
        format!(
            "the declaration of the executable {path} cannot be read: {why}\n{}",
            "it and this command may be of different versions of HPRM"
        )
    };
    let Declaration(document) = Declaration::read(&text).map_err(malformed)?;
    if let Some(what) = beyond_a_reactor(&document) {
        let message = format!("the executable {path} declares {what}");
        report.add(
            Diagnostic::error("LF1102", executable.span, message)
                .hint("a federate is one reactor: in Rust, what `run_as_federate` is given"),
        );
        return Ok(());
    }
    if let Some(refusal) = refusal(&document, executable) {
        library.refuse(executable, &refusal, &command, report);
        return Ok(());
    }
    let reactor = reactors::part(&document, library, report).map_err(malformed)?;
    let how = ExecutableFederate { command, parameters: executable.given(), declaration: text };
    library.fill(executable, reactor, how, report);
    Ok(())
}

/// Why an executable does not take its parameters: it has said so, or does not have one of them.
fn refusal(document: &Document, executable: &Executable) -> Option<Refusal> {
    let known = document.parameters.clone();
    let (parameter, refused) = match &document.refused {
        Some(document::Refusal::Missing(name)) => (Some(name.clone()), Refused::Missing),
        Some(document::Refusal::Unknown(name)) => (Some(name.clone()), Refused::Unknown),
        Some(document::Refusal::Wrong(name, why)) => (name.clone(), Refused::Wrong(why.clone())),
        None => {
            let is_unknown = |name: &String| known.iter().all(|(known, _)| known != name);
            let mut names = executable.parameters.iter().map(|it| &it.name);
            (Some(names.find(|name| is_unknown(name))?.clone()), Refused::Unknown)
        }
    };
    Some(Refusal { parameter, refused, known })
}

/// What a document declares that is more than one reactor.
fn beyond_a_reactor(document: &Document) -> Option<&'static str> {
    if document.reactors.get(document.main).is_some_and(|main| main.federated) {
        return Some("a federation of its own");
    }
    if document.executable == Some(document::Executable::Program) {
        return Some("a program of its own");
    }
    if document.reactors.iter().any(|reactor| !reactor.executable.is_empty()) {
        return Some("a reactor that is another executable");
    }
    (!document.properties.is_empty()).then_some("target properties")
}
