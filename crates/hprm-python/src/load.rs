//! Making the host of a compiled program: its instances, its bodies with their arguments, its codecs.
//!
//! What is different about programs that Python has declared is in [`bound`](crate::bound).

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use hprm::{Failure, Inbox, Pickling, Source};
use hprm_core::{
    ConnectionId, Effect, Effects, FederateId, PortId, Program, ReactionId, ReactorId, Scheduler,
    Scope, Table, Trigger,
};
use hprm_model::{Argument, Compiled, ContainedPort, Ports, Runs};
use pyo3::exceptions::PyKeyError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

use crate::action::Action;
use crate::api::Api;
use crate::backlog::Backlog;
use crate::bodies::{self, Bodies};
use crate::bound;
use crate::codec::Codec;
use crate::console;
use crate::failure::failure_at;
use crate::host::PyHost;
use crate::interrupt::{Handled, Interrupt};
use crate::mode::Mode;
use crate::places::Places;
use crate::port::Port;
use crate::program;
use crate::runtime::Runtime;
use crate::signals;
use crate::stalls;
use crate::thread;
use crate::users::{Access, Users};
use crate::value::Value;

/// What looks after the process, so that it ends when it is asked to.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) enum Care {
    /// The process itself; it runs that, as users call it.
    Own(String),
    /// Another process or, for a federate that is a thread, another thread.
    Launcher,
    /// The code that has called HPRM, and goes on afterwards: nothing ends the process.
    Caller,
}

/// Whether the reactions of a reactor run in `scope`, or it contains such reactors.
pub(crate) fn runs_in(scope: Scope, program: &Program, reactor: ReactorId) -> bool {
    match scope {
        Scope::Whole => true,
        Scope::Federate(federate) => {
            reactor == ReactorId(0) || program.reactors[reactor].federate == Some(federate)
        }
    }
}

/// Loads the share of a program that lies in `scope`: runs its preambles, makes its instances; or, if Python has
/// `declared` it, has the instances bound that are there.
///
/// # Errors
///
/// What the program raised, and where.
pub(crate) fn load(
    py: Python<'_>,
    (compiled, declared): (&Compiled, Option<&Py<PyAny>>),
    scope: Scope,
    inbox: &Inbox<Value>,
    care: Care,
) -> Result<PyHost, Failure> {
    if let (Scope::Whole, Some(federate)) = (scope, compiled.executables.keys().next()) {
        let name = &compiled.program.federates[*federate].name;
        return Err(not_here(name));
    }
    let backlog = Backlog::from_environment()?;
    let program = Arc::clone(&compiled.program);
    let runtime = Arc::new(Runtime::new(program, scope, inbox.clone(), backlog));
    let is_bound = declared.is_some();
    let loading = |error| {
        let what = format!("loading {}", compiled.program.name);
        failure_at(py, error, Source::Other(what), ("", is_bound))
    };
    console::program_writes();
    let bodies = match declared {
        None => bodies(py, compiled, &runtime),
        Some(declared) => bound::bodies(declared.bind(py), compiled, &runtime),
    };
    let bodies = bodies.map_err(loading)?;
    let codecs = codecs(py, compiled, scope, is_bound)?;
    let pickling = Pickling::of(std::env::var_os(Pickling::NAME).as_deref());
    let pickling = pickling.map_err(Failure::option)?;
    let federate = match scope {
        Scope::Whole => FederateId(0),
        Scope::Federate(federate) => federate,
    };
    let shared = Arc::new(Scheduler::new(Arc::clone(&compiled.program), scope));
    let effects = Effects::default();
    let is_thread = thread::current_federate().is_some();
    let places = Arc::new(Places::of(compiled));
    let origins = origins(compiled, scope, &places);
    stalls::watch(py, &runtime, &places, is_thread)?;
    // Last, so that Ctrl-C interrupts a preamble at once.
    let launched = !matches!(care, Care::Own(_));
    let interrupt = match care {
        Care::Own(what) => Interrupt::install(py, Handled::All, |progress| {
            signals::stop_in_time(what, inbox.clone(), progress, true)
        }),
        Care::Launcher => {
            Interrupt::install(py, Handled::CtrlC, |_| signals::notice(inbox.clone()))
        }
        Care::Caller => Interrupt::install(py, Handled::All, |progress| {
            signals::stop_in_time("the program".to_owned(), inbox.clone(), progress, false)
        }),
    };
    let interrupt = interrupt.map_err(loading)?;
    Ok(PyHost {
        runtime,
        bodies,
        is_bound,
        interrupt,
        launched,
        codecs,
        pickling,
        origins,
        places,
        federate,
        is_thread,
        shared,
        effects,
    })
}

/// The error for a federate that runs only as a process of its own.
pub(crate) fn not_here(federate: &str) -> Failure {
    Failure::Option {
        message: format!(
            "the federate {federate} is an executable, and cannot run in this process"
        ),
        hint: Some("run the federation as processes: `hprm run` does that without --in-process"),
    }
}

fn bodies(
    py: Python<'_>,
    compiled: &Compiled,
    runtime: &Arc<Runtime>,
) -> PyResult<BTreeMap<ReactionId, Bodies>> {
    let source = program::describe(py, compiled, Some(runtime.scope()))?;
    let api = Bound::new(py, Api(Arc::clone(runtime)))?;
    let loaded = py.import("hprm._program")?.call_method1("load", (source, api))?;
    let mut bodies = BTreeMap::new();
    for (id, code) in compiled.bodies.iter() {
        let reactor = compiled.program.reactions[id].reactor;
        // None if the reactor runs elsewhere.
        let found = match &code.runs {
            Runs::Reaction(index) => loaded.call_method1("bodies", (reactor.0, *index))?,
            Runs::ResetState(state) => loaded.call_method1("reset", (reactor.0, state))?,
        };
        let Some((instance, functions)) = found.extract::<Option<(Py<PyAny>, Functions)>>()? else {
            continue;
        };
        let (main, deadline, tardy) = functions;
        let mut arguments = Arguments { py, runtime, reaction: id, contained: BTreeMap::new() };
        let mut values = vec![instance.bind(py).clone()];
        for argument in &code.arguments {
            values.push(arguments.argument(argument)?);
        }
        let mutable = code.arguments.iter().zip(1..).filter_map(|(argument, at)| match argument {
            Argument::Port { mutable: true, .. } => Some(at),
            _ => None,
        });
        let mutable = mutable.collect();
        let arguments = bodies::Arguments { all: PyTuple::new(py, values)?.unbind(), mutable };
        bodies.insert(id, Bodies { main, deadline, tardy, arguments });
    }
    Ok(bodies)
}

/// A reaction's body, its deadline handler and its tardy handler.
pub(crate) type Functions = (Py<PyAny>, Option<Py<PyAny>>, Option<Py<PyAny>>);

/// Makes the arguments of one reaction.
struct Arguments<'a, 'py> {
    py: Python<'py>,
    runtime: &'a Arc<Runtime>,
    reaction: ReactionId,
    /// The ports of contained instances, for their aliases.
    contained: BTreeMap<(&'a str, &'a str), Bound<'py, PyAny>>,
}

impl<'a, 'py> Arguments<'a, 'py> {
    fn argument(&mut self, argument: &'a Argument) -> PyResult<Bound<'py, PyAny>> {
        match argument {
            Argument::Port { name, ports, access, .. } => {
                self.port(name, *ports, self.own(*ports, *access))
            }
            Argument::Contained { name, bank, members } => self.contained(name, *bank, members),
            Argument::Alias { instance, port, .. } => {
                let key = (instance.as_str(), port.as_str());
                let port = self.contained.get(&key).cloned();
                port.ok_or_else(|| PyKeyError::new_err(format!("no port {}.{}", key.0, key.1)))
            }
            Argument::Mode { mode, transition, .. } => {
                let users = Users::Argument(self.reaction, *transition);
                Ok(Bound::new(self.py, Mode::new(self.runtime, *mode, users))?.into_any())
            }
            Argument::Action { action, .. } => {
                Ok(Bound::new(self.py, Action::new(self.runtime, *action))?.into_any())
            }
        }
    }

    fn contained(
        &mut self,
        name: &'a str,
        bank: bool,
        members: &'a [Vec<ContainedPort>],
    ) -> PyResult<Bound<'py, PyAny>> {
        let class = self.py.import("hprm._ports")?.getattr("Contained")?;
        let mut instances = Vec::new();
        for (index, member) in members.iter().enumerate() {
            let label = if bank { format!("{name}[{index}]") } else { name.to_owned() };
            let ports = PyDict::new(self.py);
            for port in member {
                let full = format!("{label}.{}", port.name);
                let built = self.port(&full, port.ports, elsewhere(port.access))?;
                ports.set_item(&port.name, &built)?;
                self.contained.insert((name, &port.name), built);
            }
            instances.push(class.call1((label, ports))?);
        }
        if bank {
            return Ok(PyTuple::new(self.py, instances)?.into_any());
        }
        instances.pop().ok_or_else(|| PyKeyError::new_err(format!("no instance {name}")))
    }

    /// What the reaction may do with a port of its own reactor: an input that is only a source can be
    /// given a value to remember.
    fn own(&self, ports: Ports, access: hprm_model::Access) -> Access {
        let spec = &self.runtime.program().reactions[self.reaction];
        let triggers = spec.triggers.contains(&Trigger::Port(ports.first));
        match elsewhere(access) {
            Access::Read if !triggers => Access::Remember,
            access => access,
        }
    }

    fn port(&self, name: &str, ports: Ports, access: Access) -> PyResult<Bound<'py, PyAny>> {
        let channels = (ports.first, ports.width);
        let user = |_| Users::Argument(self.reaction, access);
        Ok(Port::build(self.py, self.runtime, name, channels, user, || None)?.into_any())
    }
}

/// What the reaction may do with a port of a contained reactor.
fn elsewhere(access: hprm_model::Access) -> Access {
    match access {
        hprm_model::Access::Read => Access::Read,
        hprm_model::Access::Write => Access::Write,
    }
}

/// The codec of each channel; packages are imported only where they are needed, and once.
fn codecs(
    py: Python<'_>,
    compiled: &Compiled,
    scope: Scope,
    is_bound: bool,
) -> Result<Table<hprm_core::ChannelId, Arc<Codec>>, Failure> {
    let program = &compiled.program;
    let mut known = BTreeMap::<Option<&str>, Arc<Codec>>::new();
    let mut codecs = Table::new();
    for channel in program.channels.values() {
        let connection = &program.connections[channel.connection];
        let here = [channel.from, channel.to].map(Scope::Federate).contains(&scope);
        let name = connection.serializer.as_deref().filter(|_| here);
        let codec = match known.get(&name) {
            Some(codec) => Arc::clone(codec),
            None => {
                let codec = Codec::of(py, name).map_err(|error| {
                    let [from, to] =
                        [connection.from, connection.to].map(|port| program.port_name(port));
                    let name = name.unwrap_or("native");
                    let what = format!("loading the serializer \"{name}\" of {from} -> {to}");
                    let place = connection_place(compiled, channel.connection);
                    let failure = failure_at(py, error, Source::Other(what), (&place, is_bound));
                    failure.with_hint(SERIALIZERS)
                })?;
                Arc::clone(known.entry(name).or_insert(Arc::new(codec)))
            }
        };
        codecs.push(codec);
    }
    Ok(codecs)
}

/// What a serializer is, for an error about one that does not exist.
const SERIALIZERS: &str = "a serializer is a Python module with a class `Serializer`, beside the \
                           program or installed";

/// Where a connection is written.
fn connection_place(compiled: &Compiled, connection: ConnectionId) -> String {
    let span = compiled.connections.get(connection.index());
    span.map_or_else(String::new, |span| {
        let line = compiled.sources.position(*span).line;
        format!("{}:{line}", compiled.sources.path(span.file))
    })
}

/// Where the values of the ports come from that are sent from here: the reactions that set them.
fn origins(compiled: &Compiled, scope: Scope, places: &Places) -> BTreeMap<PortId, String> {
    let program = &compiled.program;
    let sent = program.channels.values().filter(|channel| Scope::Federate(channel.from) == scope);
    let sent: BTreeSet<_> =
        sent.map(|channel| program.connections[channel.connection].from).collect();
    let mut origins = BTreeMap::new();
    for (id, reaction) in program.reactions.iter() {
        for effect in &reaction.effects {
            if let Effect::Port(port) = effect
                && sent.contains(port)
                && let Some(place) = places.of_reaction(id)
            {
                origins.entry(*port).or_insert(place);
            }
        }
    }
    origins
}
