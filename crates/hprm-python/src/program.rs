//! A compiled program, described in the plain data from which the package builds its Python side.
//!
//! `hprm._source` declares that data, `hprm._program` builds from it. Only what runs in the scope is
//! described: a federate makes no instance, and compiles no body, of another one.

use hprm_core::{ReactorId, Scope};
use hprm_model::{Class, Code, Compiled, Instance, ReactionBody, ReactorPart, Value};
use pyo3::exceptions::PyNotImplementedError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyTuple};

use crate::load::runs_in;

/// Describes the share of a program that lies in `scope`, as a `ProgramSource`; without a scope there
/// are no instances.
///
/// # Errors
///
/// If the program holds a kind of value that is not known here.
pub(crate) fn describe<'py>(
    py: Python<'py>,
    compiled: &Compiled,
    scope: Option<Scope>,
) -> PyResult<Bound<'py, PyAny>> {
    let describe = Describe { module: py.import("hprm._source")?, compiled };
    let sources = &compiled.sources;
    let files = PyDict::new(py);
    for file in (0..sources.len()).filter_map(|i| u32::try_from(i).ok()).map(hprm_model::FileId) {
        files.set_item(sources.path(file), sources.text(file))?;
    }
    let paths = |stated: &[(String, hprm_model::FileId)]| -> Vec<(String, String)> {
        stated.iter().map(|(path, file)| (path.clone(), sources.path(*file).to_owned())).collect()
    };
    let uses = paths(&compiled.files);
    let protobufs = paths(&compiled.protobufs);
    let preambles = describe.codes(&compiled.preambles)?;
    let classes = compiled.classes.iter().map(|class| describe.class(class));
    let classes = PyList::new(py, classes.collect::<PyResult<Vec<_>>>()?)?;
    let reactors = compiled.program.reactors.iter();
    let instances = reactors
        .filter(|(id, _)| scope.is_some_and(|scope| runs_in(scope, &compiled.program, *id)))
        .map(|(id, _)| describe.instance(id))
        .collect::<PyResult<Vec<_>>>()?;
    let (name, path) = (&compiled.program.name, sources.path(hprm_model::FileId::MAIN));
    let tracing = compiled.settings.tracing;
    let fields = (name, path, files, uses, protobufs, tracing, preambles, classes, instances);
    describe.module.getattr("ProgramSource")?.call1(fields)
}

struct Describe<'a, 'py> {
    module: Bound<'py, PyModule>,
    compiled: &'a Compiled,
}

impl<'py> Describe<'_, 'py> {
    fn class(&self, class: &Class) -> PyResult<Bound<'py, PyAny>> {
        let py = self.module.py();
        let parameters = PyList::empty(py);
        for parameter in &class.parameters {
            parameters.append((&parameter.name, self.value(&parameter.default)?))?;
        }
        let state = PyList::empty(py);
        for variable in &class.state {
            let init = variable.init.as_ref().map(|init| self.value(init)).transpose()?;
            state.append((&variable.name, init))?;
        }
        let methods = PyList::empty(py);
        for method in &class.methods {
            let defaults = method.defaults.iter().map(|default| self.value(default));
            let defaults = PyList::new(py, defaults.collect::<PyResult<Vec<_>>>()?)?;
            methods.append((
                &method.name,
                &method.args,
                defaults,
                self.body(method.code.as_ref())?,
            ))?;
        }
        let reactions = class.reactions.iter().map(|reaction| self.reaction(reaction));
        let reactions = reactions.collect::<PyResult<Vec<_>>>()?;
        let preambles = self.codes(&class.preambles)?;
        let parts = class.parts.iter().map(|ReactorPart { name, kind, class }| (name, kind, class));
        let parts: Vec<_> = parts.collect();
        let fields = (&class.name, preambles, parameters, state, methods, reactions, parts);
        self.module.getattr("ClassSource")?.call1(fields)
    }

    fn reaction(&self, reaction: &ReactionBody) -> PyResult<Bound<'py, PyAny>> {
        self.module.getattr("ReactionSource")?.call1((
            &reaction.args,
            &reaction.kinds,
            &reaction.contained,
            self.body(reaction.code.as_ref())?,
            self.body(reaction.deadline.as_ref())?,
            self.body(reaction.tardy.as_ref())?,
        ))
    }

    fn instance(&self, id: ReactorId) -> PyResult<Bound<'py, PyAny>> {
        let Instance { class, name, bank_index, assignments } = &self.compiled.instances[id];
        let assigned = PyList::empty(self.module.py());
        for (parameter, value) in assignments {
            assigned.append((parameter, self.value(value)?))?;
        }
        let parent = self.compiled.program.reactors[id].parent.map(|parent| parent.0);
        let fields = (id.0, parent, *class, name, *bank_index, assigned);
        self.module.getattr("InstanceSource")?.call1(fields)
    }

    fn value(&self, value: &Value) -> PyResult<Bound<'py, PyAny>> {
        let py = self.module.py();
        let all =
            |values: &[Value]| values.iter().map(|v| self.value(v)).collect::<PyResult<Vec<_>>>();
        Ok(match value {
            Value::Int(number) | Value::Time(number) => number.into_pyobject(py)?.into_any(),
            Value::Float(number) => number.into_pyobject(py)?.into_any(),
            Value::Bool(truth) => truth.into_pyobject(py)?.to_owned().into_any(),
            Value::Str(text) => text.into_pyobject(py)?.into_any(),
            Value::Char(character) => character.into_pyobject(py)?.into_any(),
            Value::Parameter(name) => self.module.getattr("Parameter")?.call1((name,))?,
            Value::List(values) => PyList::new(py, all(values)?)?.into_any(),
            Value::Tuple(values) => PyTuple::new(py, all(values)?)?.into_any(),
            Value::Code(code) => self.code(code)?,
            other => {
                let message = format!("a value of a kind that Python has no word for: {other:?}");
                return Err(PyNotImplementedError::new_err(message));
            }
        })
    }

    fn codes(&self, codes: &[Code]) -> PyResult<Bound<'py, PyList>> {
        let codes = codes.iter().map(|code| self.code(code)).collect::<PyResult<Vec<_>>>()?;
        PyList::new(self.module.py(), codes)
    }

    /// None if there is no text of it.
    fn body(&self, code: Option<&Code>) -> PyResult<Option<Bound<'py, PyAny>>> {
        code.map(|code| self.code(code)).transpose()
    }

    fn code(&self, code: &Code) -> PyResult<Bound<'py, PyAny>> {
        let path = self.compiled.sources.path(code.file);
        self.module.getattr("Code")?.call1((&code.text, path, code.line, code.column))
    }
}
