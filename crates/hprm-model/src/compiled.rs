//! The result of a compilation: a program for the runtime, and everything that Python needs to run its
//! bodies.

use std::collections::BTreeMap;
use std::sync::Arc;

use hprm_core::{
    ActionId, Fact, FederateId, ModeId, PortId, Program, ReactionId, ReactorId, Table, Transition,
};

use crate::code::Code;
use crate::diagnostic::Diagnostic;
use crate::given::Given;
use crate::outline::Outline;
use crate::properties::Settings;
use crate::render::render_all;
use crate::source::{FileId, Sources, Span};
use crate::syntax::Syntax;
use crate::value::Value;

/// A compiled program.
#[derive(Clone, Debug)]
pub struct Compiled {
    /// The instance graph.
    pub program: Arc<Program>,
    /// Whether the main reactor is a federated one.
    pub federated: bool,
    /// What it is written in, for what is said about it when it runs.
    pub syntax: Syntax,
    /// All files that were read, for tracebacks.
    pub sources: Sources,
    /// The reactors that have instances; for [`Purpose::Check`](crate::Purpose::Check), also others.
    pub classes: Vec<Class>,
    /// By reactor instance.
    pub instances: Table<ReactorId, Instance>,
    /// By reaction instance.
    pub bodies: Table<ReactionId, ReactionCode>,
    /// By connection: where it is written.
    pub connections: Vec<Span>,
    /// File-level preambles in the order in which they run: what a file imports comes before it.
    pub preambles: Vec<Code>,
    /// The target property `files` of all files, each with the file that states it.
    pub files: Vec<(String, FileId)>,
    /// The target property `protobufs` of all files, likewise.
    pub protobufs: Vec<(String, FileId)>,
    /// Modules and files beside a federated program that decide what it does, for federates to
    /// compare.
    pub modules: Vec<Fact>,
    /// Target properties that the scheduler does not need.
    pub settings: Settings,
    /// The host of a federated reactor (`at`), where the RTI runs.
    pub rti_host: Option<String>,
    /// All hosts that a federated program names.
    pub hosts: Vec<PlacedAt>,
    /// The federates that are executables.
    pub executables: BTreeMap<FederateId, ExecutableFederate>,
    /// For [`Purpose::Draw`](crate::Purpose::Draw), what is drawn.
    pub outline: Option<Outline>,
    /// Warnings.
    pub warnings: Vec<Diagnostic>,
}

impl Compiled {
    /// The file that gets the trace of a run, if the target property `tracing` asks for one.
    #[must_use]
    pub fn trace_file(&self) -> Option<String> {
        let Settings { tracing, trace_file, .. } = &self.settings;
        let named = trace_file.as_ref().unwrap_or(&self.program.name);
        let file = if named.contains('.') { named.clone() } else { format!("{named}.pftrace") };
        tracing.then_some(file)
    }

    /// The parameters of the main reactor; none in a file without one.
    #[must_use]
    pub fn main_parameters(&self) -> &[ParameterDecl] {
        let main = self.instances.values().next();
        main.map_or(&[], |main| &self.classes[main.class].parameters)
    }
}

/// A federate that is an executable.
#[derive(Clone, PartialEq, Debug)]
pub struct ExecutableFederate {
    /// What starts it from anywhere: its absolute path, and its arguments.
    pub command: Vec<String>,
    /// The names and the values of its parameters.
    pub parameters: Vec<(String, Given)>,
    /// What it has declared, as text.
    pub declaration: String,
}

/// Where part of a federation is to run (`at`).
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct PlacedAt {
    /// The instance that is a federate, or a bank of them; none for the RTI.
    pub federate: Option<String>,
    /// The host, as written: `user@host:port`.
    pub host: String,
    /// Where it is written.
    pub span: Span,
}

/// A reactor, as Python sees it.
#[derive(Clone, PartialEq, Debug)]
pub struct Class {
    /// Its name; the program's for an unnamed main reactor.
    pub name: String,
    /// The file that declares it.
    pub file: FileId,
    /// Reactor-level preambles: text of the class body.
    pub preambles: Vec<Code>,
    /// Parameters.
    pub parameters: Vec<ParameterDecl>,
    /// State variables.
    pub state: Vec<StateDecl>,
    /// Methods.
    pub methods: Vec<Method>,
    /// Reactions in their order.
    pub reactions: Vec<ReactionBody>,
    /// What else it declares, for messages about names in bodies.
    pub parts: Vec<ReactorPart>,
}

/// A part of a reactor that a reaction can name.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct ReactorPart {
    /// Its name.
    pub name: String,
    /// `input`, `output`, `action`, `timer`, `mode`, `instance` or `bank`.
    pub kind: &'static str,
    /// The class of an instance, and its ports, each with its kind.
    pub class: Option<(String, Vec<(String, &'static str)>)>,
}

/// A parameter.
#[derive(Clone, PartialEq, Debug)]
pub struct ParameterDecl {
    /// Its name.
    pub name: String,
    /// Its value where an instance is made without one.
    pub default: Value,
}

/// A state variable.
#[derive(Clone, PartialEq, Debug)]
pub struct StateDecl {
    /// Its name.
    pub name: String,
    /// Its first value; `None` in Python if there is none.
    pub init: Option<Value>,
}

/// A method.
#[derive(Clone, PartialEq, Debug)]
pub struct Method {
    /// Its name.
    pub name: String,
    /// Its parameters after `self`.
    pub args: Vec<String>,
    /// What the last of them are if a call leaves them out.
    pub defaults: Vec<Value>,
    /// Its body; none if the front end has it ([`Body::Bound`](crate::declaration::Body::Bound)).
    pub code: Option<Code>,
}

/// The Python of a reaction.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct ReactionBody {
    /// The name that the program gives it, if any.
    pub name: Option<String>,
    /// Python's parameters after `self`: one for each of [`ReactionCode::arguments`].
    pub args: Vec<String>,
    /// What they are: the kind of a [`ReactorPart`], or `source` for an input that does not trigger, or
    /// `mutable` for one that is copied.
    pub kinds: Vec<&'static str>,
    /// The ports of contained reactors that it names, as `instance.port`.
    pub contained: Vec<String>,
    /// The body; none if the front end has it ([`Body::Bound`](crate::declaration::Body::Bound)).
    pub code: Option<Code>,
    /// The body that runs instead when the deadline is missed. None if there is no
    /// [`deadline`](hprm_core::Reaction::deadline), or the front end has the body.
    pub deadline: Option<Code>,
    /// The body that runs instead when an input is tardy. None if the reaction does not handle
    /// that, or handles it by its own body (`tardy` alone), or the front end has the body;
    /// [`handles_tardy`] tells whether it does.
    ///
    /// [`handles_tardy`]: hprm_core::Reaction::handles_tardy
    pub tardy: Option<Code>,
    /// The file that holds it: an inherited reaction may have another one than its class.
    pub file: FileId,
    /// The line of the word `reaction` there.
    pub line: u32,
}

/// An instance, as Python makes it.
#[derive(Clone, PartialEq, Debug)]
pub struct Instance {
    /// Index into [`Compiled::classes`].
    pub class: usize,
    /// Its full name, as in the program.
    pub name: String,
    /// Its place in its bank; none if it is not in one.
    pub bank_index: Option<u32>,
    /// The parameters that the instantiation assigns, evaluated in the container. The others have
    /// their defaults.
    pub assignments: Vec<(String, Value)>,
}

/// What a reaction instance runs, and with what.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct ReactionCode {
    /// Index into [`Compiled::classes`].
    pub class: usize,
    /// What of the class it runs.
    pub runs: Runs,
    /// What Python's parameters stand for, in their order.
    pub arguments: Vec<Argument>,
}

/// What of its class a reaction instance runs.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Runs {
    /// A reaction, by index into the class's reactions.
    Reaction(usize),
    /// Not in the program text: gives these state variables their first values again, by index
    /// into the class's state (`reset state`).
    ResetState(Vec<usize>),
}

/// What one parameter of a reaction's Python function stands for.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Argument {
    /// An own port.
    Port {
        /// The parameter.
        name: String,
        /// The channels.
        ports: Ports,
        /// Read or write.
        access: Access,
        /// Whether the reaction may change the value, so that it gets a copy.
        mutable: bool,
    },
    /// A contained instance, or a bank of them, with the ports that the reaction mentions as
    /// attributes.
    Contained {
        /// The parameter: the name of the instance.
        name: String,
        /// Whether it is a bank, and so a list in Python.
        bank: bool,
        /// The ports of each member; exactly one member if it is not a bank.
        members: Vec<Vec<ContainedPort>>,
    },
    /// One port of a contained instance under a name of its own: `inst_port`.
    Alias {
        /// The parameter.
        name: String,
        /// The instance, which is a [`Argument::Contained`] before this one.
        instance: String,
        /// The port, among its ports.
        port: String,
    },
    /// An action.
    Action {
        /// The parameter.
        name: String,
        /// The action.
        action: ActionId,
    },
    /// A mode that the reaction can enter.
    Mode {
        /// The parameter: the name of the mode.
        name: String,
        /// The mode.
        mode: ModeId,
        /// How it is entered.
        transition: Transition,
    },
}

impl Argument {
    /// The name of the parameter.
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::Port { name, .. }
            | Self::Contained { name, .. }
            | Self::Alias { name, .. }
            | Self::Action { name, .. }
            | Self::Mode { name, .. } => name,
        }
    }
}

/// A port of a contained instance.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct ContainedPort {
    /// Its name in its reactor.
    pub name: String,
    /// The channels.
    pub ports: Ports,
    /// Read or write.
    pub access: Access,
}

/// What a reaction may do with a port.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Access {
    /// Read it.
    Read,
    /// Set it, and read what was set.
    Write,
}

/// The channels of a port, which follow one another.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Ports {
    /// The first channel.
    pub first: PortId,
    /// How many there are; none if it is not a multiport, and then there is one.
    pub width: Option<u32>,
}

impl Ports {
    /// All channels.
    pub fn channels(self) -> impl Iterator<Item = PortId> + Clone {
        let first = self.first.0;
        (first..first + self.width.unwrap_or(1)).map(PortId)
    }
}

/// Why a program cannot run. As text, all its diagnostics without colour.
#[derive(Clone, Debug, thiserror::Error)]
#[error("{}", render_all(diagnostics, sources, false))]
pub struct CompileFailure {
    /// At least one error, and perhaps warnings, in the order of the text.
    pub diagnostics: Vec<Diagnostic>,
    /// The files that they refer to.
    pub sources: Sources,
    /// For [`Purpose::Draw`](crate::Purpose::Draw), what can be drawn nevertheless.
    pub outline: Option<Box<Outline>>,
}
