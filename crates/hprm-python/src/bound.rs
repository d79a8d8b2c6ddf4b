//! Programs that Python has declared: their ports become attributes of the reactors, their bodies are functions
//! that exist.

use std::collections::BTreeMap;
use std::sync::Arc;

use hprm_core::{ReactionId, ReactorId};
use hprm_model::{Compiled, Runs};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

use crate::api::Api;
use crate::bodies::{Arguments, Bodies};
use crate::load::{Functions, runs_in};
use crate::parts::Parts;
use crate::runtime::Runtime;

/// Gives each reactor that runs here its ports, actions and modes, and finds the functions of its reactions.
///
/// # Errors
///
/// What Python raises.
pub(crate) fn bodies(
    declared: &Bound<'_, PyAny>,
    compiled: &Compiled,
    runtime: &Arc<Runtime>,
) -> PyResult<BTreeMap<ReactionId, Bodies>> {
    let (py, program) = (declared.py(), &compiled.program);
    let api = Bound::new(py, Api(Arc::clone(runtime)))?;
    py.import(intern!(py, "hprm._thread_failures"))?.call_method1(intern!(py, "watch"), (&api,))?;
    let runs_here = |reactor: ReactorId| runs_in(runtime.scope(), program, reactor);
    let parts = Parts::of(compiled, runtime);
    // Containers come before what they contain.
    for (id, reactor) in program.reactors.iter().filter(|(id, _)| runs_here(*id)) {
        let types = declared.call_method1(intern!(py, "types"), (&reactor.name,))?;
        let attributes = parts.of_reactor(id, types.cast::<PyDict>()?)?;
        declared.call_method1(intern!(py, "bind"), (&reactor.name, attributes, &api))?;
    }
    let mut bodies = BTreeMap::new();
    for (id, code) in compiled.bodies.iter() {
        let reactor = program.reactions[id].reactor;
        // A declared reactor has no state variables that the front end resets.
        let (Runs::Reaction(index), true) = (&code.runs, runs_here(reactor)) else { continue };
        let arguments = (&program.reactors[reactor].name, *index);
        let found = declared.call_method1(intern!(py, "bodies"), arguments)?;
        let (instance, functions): (Bound<'_, PyAny>, Functions) = found.extract()?;
        let (main, deadline, tardy) = functions;
        let all = PyTuple::new(py, [instance])?.unbind();
        let arguments = Arguments { all, mutable: Vec::new() };
        bodies.insert(id, Bodies { main, deadline, tardy, arguments });
    }
    Ok(bodies)
}
