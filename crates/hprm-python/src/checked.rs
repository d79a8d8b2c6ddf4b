//! A program that has been checked: the text of an `.lf` file, or what a Python file or an object declares.

use std::io::IsTerminal;

use hprm::{Disk, Failure, Source};
use hprm_declared::{Malformed, NamedProgram};
use hprm_model::{CompileFailure, Compiled, Purpose, explanation, render_all};
use pyo3::exceptions::PyRuntimeError;
use pyo3::intern;
use pyo3::prelude::*;

use crate::console::{replaced_stderr, say_to_caller};
use crate::failure::{failure_at, failure_in_loading};

/// A checked program.
pub(crate) struct Checked {
    pub(crate) compiled: Compiled,
    /// What has declared it; none if it is the text of an `.lf` file.
    pub(crate) declared: Option<Declared>,
}

/// What has declared a program in Python.
pub(crate) struct Declared {
    /// An object that knows the instances of its reactors, and the functions of their reactions.
    pub(crate) object: Py<PyAny>,
    /// The text of the declaration.
    text: String,
    /// The file and the properties, if it was loaded from a file.
    file: Option<(String, Vec<String>)>,
}

impl Checked {
    /// Checks the program at `path`: an `.lf` file, or a Python file, perhaps with the name of a reactor behind it
    /// (`app.py:Vision`).
    ///
    /// # Errors
    ///
    /// What is wrong with it, or what it raises.
    pub(crate) fn load(py: Python<'_>, path: &str, properties: &[String]) -> Result<Self, Failure> {
        if NamedProgram::parse(path).is_some() {
            let object = load(py, path, properties)?;
            let file = Some((path.to_owned(), properties.to_owned()));
            return Self::declared(object.bind(py), properties, file);
        }
        let compiled = hprm_lf::compile_with(path, properties, &mut Disk::from_environment());
        Ok(Self { compiled: accept(py, compiled)?, declared: None })
    }

    /// Writes its warnings to the standard error.
    pub(crate) fn show_warnings(&self, py: Python<'_>) {
        let Compiled { warnings, sources, .. } = &self.compiled;
        if !warnings.is_empty() {
            say_to_caller(py, &render_all(warnings, sources, in_color(py)));
        }
    }

    /// Checks the program that `object` declares, which exists already. The caller has its warnings of
    /// [`check_declared`].
    ///
    /// # Errors
    ///
    /// What is wrong with it.
    pub(crate) fn of(object: &Bound<'_, PyAny>, properties: &[String]) -> Result<Self, Failure> {
        Self::declared(object, properties, None)
    }

    fn declared(
        object: &Bound<'_, PyAny>,
        properties: &[String],
        file: Option<(String, Vec<String>)>,
    ) -> Result<Self, Failure> {
        let text = text_of(object)?;
        let purpose = purpose_of(object)
            .map_err(|error| failure_at(object.py(), error, declaring(), ("", true)))?;
        let compiled = compile(&text, properties, purpose);
        let compiled = compiled.map_err(|error| Failure::option(error.to_string()))?;
        let declared = Some(Declared { object: object.clone().unbind(), text, file });
        Ok(Self { compiled: accept(object.py(), compiled)?, declared })
    }
}

impl Declared {
    /// What declares the program for a federate that shares the process with others, each of which has modules,
    /// classes and instances of its own.
    ///
    /// # Errors
    ///
    /// What the file raises, or that it declares something else each time it is loaded.
    pub(crate) fn of_federate(&self, py: Python<'_>) -> Result<Py<PyAny>, Failure> {
        let Some((path, properties)) = &self.file else { return Ok(self.object.clone_ref(py)) };
        let object = load(py, path, properties)?;
        if text_of(object.bind(py))? == self.text {
            return Ok(object);
        }
        Err(Failure::Option {
            message: format!("{path} declares another program each time it is loaded"),
            hint: Some(
                "every federate loads the file, and all must declare the same: what is declared must not \
                 depend on the time, on random numbers or on the process",
            ),
        })
    }
}

/// The file of a program in Python, and what stands behind the colon in `app.py:Vision`; none of other programs.
#[pyfunction]
pub(crate) fn named_program(path: &str) -> Option<(&str, Option<&str>)> {
    NamedProgram::parse(path).map(|named| (named.file, named.reactor))
}

fn load(py: Python<'_>, path: &str, properties: &[String]) -> Result<Py<PyAny>, Failure> {
    let module = py.import(intern!(py, "hprm._declared"));
    let loaded = module.and_then(|it| it.call_method1(intern!(py, "load"), (path, properties)));
    Ok(loaded.map_err(|error| failure_in_loading(py, error, path))?.unbind())
}

fn text_of(object: &Bound<'_, PyAny>) -> Result<String, Failure> {
    let py = object.py();
    let text = object.getattr(intern!(py, "text")).and_then(|text| text.extract::<String>());
    text.map_err(|error| failure_at(py, error, declaring(), ("", true)))
}

fn declaring() -> Source {
    Source::Other("declaring the program".to_owned())
}

/// Whether the program is to be run, or a reactor of it is to be tested in virtual time.
fn purpose_of(object: &Bound<'_, PyAny>) -> PyResult<Purpose> {
    let is_test = object.getattr_opt(intern!(object.py(), "is_test"))?;
    let is_test = is_test.map_or(Ok(false), |it| it.is_truthy())?;
    Ok(if is_test { Purpose::Test } else { Purpose::Run })
}

fn compile(
    text: &str,
    properties: &[String],
    purpose: Purpose,
) -> Result<Result<Compiled, CompileFailure>, Malformed> {
    hprm_lf::compile_declared(text, properties, &mut Disk::from_environment(), purpose)
}

/// The program, unless there is something wrong with it.
fn accept(py: Python<'_>, compiled: Result<Compiled, CompileFailure>) -> Result<Compiled, Failure> {
    compiled.map_err(|failure| Failure::mistakes(&failure, in_color(py)))
}

fn in_color(py: Python<'_>) -> bool {
    let is_terminal = std::io::stderr().is_terminal() && replaced_stderr(py).is_none();
    is_terminal && std::env::var_os("NO_COLOR").is_none()
}

/// Whether the program that an object declares can run, its diagnostics as text, in colour if the standard
/// error is a terminal, and how to read more about its mistakes.
///
/// # Errors
///
/// If the object is no declaration, or the package and this module are of different versions.
#[pyfunction]
#[pyo3(signature = (declared, properties = vec![]))]
pub(crate) fn check_declared(
    declared: &Bound<'_, PyAny>,
    properties: Vec<String>,
) -> PyResult<(bool, String, String)> {
    let py = declared.py();
    let text: String = declared.getattr(intern!(py, "text"))?.extract()?;
    let compiled = compile(&text, &properties, purpose_of(declared)?);
    let compiled = compiled.map_err(|error| PyRuntimeError::new_err(error.to_string()))?;
    Ok(match compiled {
        Ok(compiled) => {
            let warnings = render_all(&compiled.warnings, &compiled.sources, in_color(py));
            (true, warnings, String::new())
        }
        Err(found) => {
            let mistakes = render_all(&found.diagnostics, &found.sources, in_color(py));
            let more = explanation::offer(found.diagnostics.iter().map(|it| it.code));
            (false, mistakes, more.unwrap_or_default())
        }
    })
}
