//! The form in which other languages declare programs: JSON, to what `hprm-model` checks.
//!
//! Such a program is a tree of objects, so each reactor *instance* is declared, with its widths, times and
//! contents as they are; instances that declare the same may share one declaration. Bodies stay where they
//! are: the model knows only that they are there.
//!
//! `document` is the form of the JSON, `places` finds places in the texts, `reactors` makes a library of the
//! declarations, with `members` and `references`; `properties` has the target properties, and `facts` what
//! federates compare beyond what the model knows. `executables` puts what executables declare into a program that
//! names them. `named` reads how users name such a program.
//!
//! This crate is pure: text goes in, data comes out. It opens no file and runs nothing.

#![deny(clippy::disallowed_methods, clippy::disallowed_types)]
#![forbid(unsafe_code)]

mod document;
mod executables;
mod facts;
mod members;
mod named;
mod places;
mod properties;
mod reactors;
mod references;

use hprm_core::Fact;
use hprm_model::{Compiled, Library, Report};

use crate::document::{Document, Refusal};

pub use crate::executables::{Described, describe};
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

/// A program that another language has declared, as it was read.
#[derive(Debug)]
pub struct Declaration(Document);

impl Declaration {
    /// Reads the declaration of a program.
    ///
    /// ```
    /// use hprm_declared::Declaration;
    /// use hprm_model::{Overrides, Purpose, Report, Syntax, TargetProperties, compile};
    ///
    /// let text = r#"{
    ///     "files": [{"path": "app.py", "text": "class Hello(Reactor):\n    def greet(self): ...\n"}],
    ///     "main": 0,
    ///     "reactors": [{
    ///         "name": "Hello", "at": [0, 1, 0, -1],
    ///         "reactions": [{"name": "greet", "at": [0, 2, 4, -1], "triggers": ["startup"]}]
    ///     }]
    /// }"#;
    /// let mut report = Report::new(Syntax::Python);
    /// let library = Declaration::read(text).unwrap().library(&mut report).unwrap();
    /// let stated = Overrides::default();
    /// let properties = TargetProperties::read(&library, &stated, &mut report);
    /// let compiled = compile(library, properties, &stated, Purpose::Run, report).unwrap();
    /// assert_eq!(compiled.program.name, "Hello");
    /// assert_eq!(compiled.classes[0].reactions[0].line, 2);
    /// ```
    ///
    /// # Errors
    ///
    /// [`Malformed`] if the text is no declaration.
    pub fn read(text: &str) -> Result<Self, Malformed> {
        let document = serde_json::from_str(text);
        document.map(Self).map_err(|error| Malformed::new(error.to_string()))
    }

    /// What is declared, for the model to check.
    ///
    /// # Errors
    ///
    /// [`Malformed`] if parts of it do not fit together.
    pub fn library(&self, report: &mut Report) -> Result<Library, Malformed> {
        reactors::library(&self.0, report)
    }

    /// What federates compare beyond what the model knows.
    #[must_use]
    pub fn facts(&self, compiled: &Compiled) -> Vec<Fact> {
        facts::facts(&self.0, compiled)
    }

    /// Whether the main reactor is a federation.
    #[must_use]
    pub fn is_federation(&self) -> bool {
        self.0.reactors.get(self.0.main).is_some_and(|main| main.federated)
    }

    /// Why an executable that was given no parameters does not tell what it is, as what it does.
    #[must_use]
    pub fn refusal(&self) -> Option<String> {
        Some(match self.0.refused.as_ref()? {
            Refusal::Missing(name) => format!("needs the parameter `{name}`"),
            Refusal::Unknown(name) => format!("has no parameter `{name}`"),
            Refusal::Wrong(_, why) => format!("does not take the parameters that it has: {why}"),
        })
    }

    /// The parameters of the main reactor, each with its value as text.
    #[must_use]
    pub fn parameters(&self) -> Vec<(String, String)> {
        let main = self.0.reactors.get(self.0.main);
        let facts = main.into_iter().flat_map(|main| &main.facts);
        let parameter = |(subject, value): &(String, String)| {
            Some((subject.strip_prefix("parameter ")?.to_owned(), value.clone()))
        };
        facts.filter_map(parameter).collect()
    }
}
