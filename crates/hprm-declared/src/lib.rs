//! The front end for programs whose instances another language has made: what they declare, as JSON, to
//! what `hprm-model` checks.
//!
//! Such a program is a tree of objects, so each reactor *instance* is declared, with its widths, times and
//! contents as they are; instances that declare the same may share one declaration. Bodies stay where they
//! are: the model knows only that they are there.
//!
//! `document` is the form of the JSON, `places` finds places in the texts, `reactors` makes a library of the
//! declarations, with `members` and `references`; `properties` has the target properties, and `facts` what
//! federates compare beyond what the model knows. `named` reads how users name such a program.
//!
//! This crate is pure: text goes in, data comes out. It opens no file and runs nothing.

#![deny(clippy::disallowed_methods, clippy::disallowed_types)]
#![forbid(unsafe_code)]

mod document;
mod facts;
mod members;
mod named;
mod places;
mod properties;
mod reactors;
mod references;

use hprm_lf::SourceLoader;
use hprm_model::{CompileFailure, Compiled, Purpose, Report, Syntax, TargetProperties};

use crate::document::Document;
use crate::reactors::Reactors;

pub use crate::named::NamedProgram;

/// The text is no declaration of a program: the Python package that wrote it has another version than this
/// crate, or a bug.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error("the declaration of the program cannot be read: {0}")]
pub struct Malformed(String);

impl Malformed {
    fn new(why: impl Into<String>) -> Self {
        Self(why.into())
    }
}

/// The parameters of the main reactor that `text` declares, each with its value as text.
///
/// # Errors
///
/// [`Malformed`] if the text is no declaration.
pub fn parameters(text: &str) -> Result<Vec<(String, String)>, Malformed> {
    let document = read(text)?;
    let main = document.reactors.get(document.main);
    let facts = main.into_iter().flat_map(|main| &main.facts);
    let parameter = |(subject, value): &(String, String)| {
        Some((subject.strip_prefix("parameter ")?.to_owned(), value.clone()))
    };
    Ok(facts.filter_map(parameter).collect())
}

fn read(text: &str) -> Result<Document, Malformed> {
    serde_json::from_str(text).map_err(|error| Malformed::new(error.to_string()))
}

/// Compiles the program that `text` declares, with target properties as `KEY=VALUE`, which override those of
/// the program. Values of parameters, `main.NAME=VALUE`, are left out: the program has used them when it made
/// its main reactor. `files` tells whether the files are there that target properties name.
///
/// ```
/// use hprm_model::Purpose;
///
/// let text = r#"{
///     "files": [{"path": "app.py", "text": "class Hello(Reactor):\n    def greet(self): ...\n"}],
///     "main": 0,
///     "reactors": [{
///         "name": "Hello", "at": [0, 1, 0, -1],
///         "reactions": [{"name": "greet", "at": [0, 2, 4, -1], "triggers": ["startup"]}]
///     }]
/// }"#;
/// let mut files = |_: &str| Err("no such file".to_owned());
/// let compiled = hprm_declared::compile(text, &[], &mut files, Purpose::Run).unwrap().unwrap();
/// assert_eq!(compiled.program.name, "Hello");
/// assert_eq!(compiled.classes[0].reactions[0].line, 2);
/// ```
///
/// # Errors
///
/// [`Malformed`] if the text is no declaration; the inner error has everything that is wrong with the program.
pub fn compile(
    text: &str,
    properties: &[String],
    files: &mut dyn SourceLoader,
    purpose: Purpose,
) -> Result<Result<Compiled, CompileFailure>, Malformed> {
    let document = read(text)?;
    let mut report = Report::new(Syntax::Python);
    let mut library = Reactors::new(&document, &mut report)?.into_library()?;
    let is_property = |stated: &&String| !stated.starts_with(hprm_lf::PARAMETER);
    let stated: Vec<String> = properties.iter().filter(is_property).cloned().collect();
    let overrides = hprm_lf::overrides(&stated, &mut library, &mut report);
    let properties = TargetProperties::read(&library, &overrides, &mut report);
    hprm_lf::check_files(&properties, library.sources(), files, &mut report);
    let compiled = hprm_model::compile(library, properties, &overrides, purpose, report);
    Ok(compiled.map(|mut compiled| {
        if compiled.federated {
            compiled.modules = facts::facts(&document, &compiled);
        }
        compiled
    }))
}
