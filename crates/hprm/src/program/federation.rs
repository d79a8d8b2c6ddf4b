//! Federations of programs in Rust: each reactor of the main reactor is a federate, a process of the same executable.
//!
//! One `main` describes the federation, in the launcher and in each federate: what was handed to this process decides
//! which of them it is. What is handed, and how the parts are found in it, is in `handover.rs` and `handed.rs`.

use std::collections::BTreeSet;
use std::panic::Location;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use hprm_codec::Transfer;
use hprm_core::{Coordination, Properties, ReactorId, Spin, WhenFull};

use super::builder::{Reactor, ReactorBuilder};
use super::claim::{self, Role};
use super::connection::Connections;
use super::describe;
use super::federate::Federate;
use super::graph::Graph;
use super::handed::Handed;
use super::handle::{Port, ports};
use super::launching::Launching;
use super::parts::Parts;
use super::running::run_federate;
use super::transport::Codec;
use crate::{Failure, HangTimeout, Kind, Report, Runnable, nanoseconds};

/// A federation that is being put together: each reactor that is added is a federate, and runs in a process of its own.
///
/// `run` starts the federates as processes of this same executable. All of them run `main`, up to `run`: what comes
/// before that should describe the federation and do nothing else. Only the process that was started by hand returns
/// from it.
///
/// ```no_run
/// use std::time::Duration;
///
/// use hprm::prelude::*;
///
/// fn main() -> Result<(), Failure> {
///     let period = Duration::from_millis(100);
///     let mut federation = Federation::new("Counting").timeout(2 * period);
///     let count = federation.reactor("counter", 0_u32, |counter| {
///         let (tick, out) = (counter.timer("tick", Duration::ZERO, period), counter.output("out"));
///         counter.reaction().on(tick).sets(out).run(move |count, ctx| {
///             *count += 1;
///             ctx.set(out, *count);
///         });
///         out
///     });
///     let number = federation.reactor("printer", (), |printer| {
///         let number = printer.input("number");
///         printer.reaction().on(number).run(move |(), ctx| println!("{:?}", ctx.get(number)));
///         number
///     });
///     federation.connect(count, number);
///     federation.run()
/// }
/// ```
pub struct Federation {
    name: String,
    graph: Graph,
    properties: Properties,
    launching: Launching,
    names: BTreeSet<String>,
    role: Role,
    /// Why it cannot run as processes.
    unread: Option<Report>,
}

impl Federation {
    /// A federation without federates. `name` must be the same in each process: it tells a federate which of several
    /// federations in one `main` is its own.
    #[must_use]
    #[track_caller]
    pub fn new(name: &str) -> Self {
        let (role, unread) = match claim::role(name, Location::caller()) {
            Ok(role) => (role, None),
            // The report is an error of `run`.
            Err(report) => (Role::Other, Some(*report)),
        };
        let graph = match &role {
            Role::Federate(handover) => {
                let program = Arc::new(handover.program.clone());
                Graph::of(Parts::Handed(Handed::new(program, ReactorId(0))))
            }
            Role::Launcher(_) | Role::Other => Graph::new(name),
        };
        Self {
            name: name.to_owned(),
            graph,
            properties: Properties::default(),
            launching: Launching::default(),
            names: BTreeSet::new(),
            role,
            unread,
        }
    }

    // How it runs.

    /// Federates wait for one another by their clocks, and not for grants of the RTI.
    #[must_use]
    pub fn decentralized(mut self) -> Self {
        self.properties.coordination = Coordination::Decentralized;
        self
    }

    /// Ends it so long after its start.
    #[must_use]
    pub fn timeout(mut self, timeout: Duration) -> Self {
        self.properties.timeout = Some(nanoseconds(timeout));
        self
    }

    /// How long federates and the RTI look for messages again and again, before they sleep: a message is seen in less
    /// than a microsecond then, and each of them keeps a processor busy meanwhile. Zero is never. Without this, they do
    /// so for 50 µs if there are more processors than processes.
    ///
    /// ```
    /// use std::time::Duration;
    ///
    /// use hprm::prelude::*;
    ///
    /// let federation = Federation::new("Control").decentralized().spin(Duration::from_micros(200));
    /// ```
    #[must_use]
    pub fn spin(mut self, time: Duration) -> Self {
        self.properties.spin = Spin::For(nanoseconds(time));
        self
    }

    /// Replaces all properties.
    #[must_use]
    pub fn properties(mut self, properties: Properties) -> Self {
        self.properties = properties;
        self
    }

    /// How long the federates may take to join and load; a minute, if this is not called.
    #[must_use]
    pub fn join_timeout(mut self, timeout: Duration) -> Self {
        self.launching.join_timeout = timeout;
        self
    }

    /// Ends the federation if a federate does not answer for so long, for example because a reaction does not return.
    /// Without this, it is only warned of.
    #[must_use]
    pub fn hang_timeout(mut self, timeout: Duration) -> Self {
        self.launching.hang_timeout = HangTimeout { limit: Some(nanoseconds(timeout)) };
        self
    }

    /// The most bytes that the object store of each federate takes: large arrays lie there for the receivers of this
    /// machine. Without this, it is 2 GiB, or less in a small container. What has no room travels inside its message,
    /// which costs copies, unless [`store_full_fails`](Self::store_full_fails) is called.
    #[must_use]
    pub fn store_limit(mut self, bytes: u64) -> Self {
        self.launching.store.limit = Some(bytes);
        self
    }

    /// Ends the federation with an error if the object store of a federate has no room for a large array.
    #[must_use]
    pub fn store_full_fails(mut self) -> Self {
        self.launching.store.when_full = WhenFull::Error;
        self
    }

    /// Writes what reactions do to a file, which `hprm diff` compares with that of another run.
    #[must_use]
    pub fn logical_trace(mut self, file: impl Into<PathBuf>) -> Self {
        self.launching.logical_trace = Some(file.into());
        self
    }

    /// Writes when reactions, messages and grants were, to a file that Perfetto opens.
    #[must_use]
    pub fn trace(mut self, file: impl Into<PathBuf>) -> Self {
        self.launching.trace = Some(file.into());
        self
    }

    // What is in it.

    /// Adds a federate that is a reactor, and returns its ports. The federate is a name, or a [`Federate`].
    #[track_caller]
    pub fn add<R: Reactor>(&mut self, federate: impl Into<Federate>, reactor: R) -> R::Ports {
        let federate = federate.into();
        let name = federate.name.clone();
        self.declare(&name, Location::caller());
        self.add_named(&name, federate, reactor)
    }

    /// Adds a bank: a federate for each item. Their reactors are `name[0]` and so on, the federates `name__0`.
    #[track_caller]
    pub fn bank<R: Reactor>(
        &mut self,
        federate: impl Into<Federate>,
        reactors: impl IntoIterator<Item = R>,
    ) -> Vec<R::Ports> {
        let federate = federate.into();
        self.declare(&federate.name, Location::caller());
        let members = reactors.into_iter().enumerate();
        let add = |(index, reactor)| {
            let name = format!("{}[{index}]", federate.name);
            self.add_named(&name, federate.member(index), reactor)
        };
        members.map(add).collect()
    }

    /// Adds a federate whose reactor is not worth a type: its state, and a closure that assembles it.
    #[track_caller]
    pub fn reactor<S: Send + 'static, R>(
        &mut self,
        federate: impl Into<Federate>,
        state: S,
        assemble: impl FnOnce(&mut ReactorBuilder<'_, S>) -> R,
    ) -> R {
        let federate = federate.into();
        let name = federate.name.clone();
        self.declare(&name, Location::caller());
        let id = self.federate(&name, federate);
        self.graph.bodies.insert(id, Box::new(state));
        assemble(&mut ReactorBuilder::new(&mut self.graph, id))
    }

    fn add_named<R: Reactor>(
        &mut self,
        name: &str,
        federate: Federate,
        mut reactor: R,
    ) -> R::Ports {
        let id = self.federate(name, federate);
        let ports = reactor.assemble(&mut ReactorBuilder::new(&mut self.graph, id));
        self.graph.bodies.insert(id, Box::new(reactor));
        ports
    }

    /// Notes the name of a federate, or of a bank of federates.
    fn declare(&mut self, name: &str, at: &'static Location<'static>) {
        self.graph.declare_reactor(self.graph.parts.root(), name, at);
    }

    fn federate(&mut self, name: &str, federate: Federate) -> ReactorId {
        // Of equal names of reactors there is a mistake already.
        let is_reported = !self.graph.mistakes.is_empty();
        if !self.names.insert(federate.name.clone()) && !is_reported {
            let what = format!("two federates have the name {}", federate.name);
            let report = Report::new(Kind::Program, what);
            self.graph.mistakes.push(report.hint("give each federate a name of its own"));
        }
        if federate.name.is_empty() || federate.name.contains(char::is_control) {
            let what = format!("{:?} is no name of a federate", federate.name);
            let report = Report::new(Kind::Program, what);
            self.graph.mistakes.push(report.hint("a name is one line of text, and not empty"));
        }
        let parts = &mut self.graph.parts;
        let id = parts.reactor(parts.root(), name);
        parts.federate(id, federate);
        id
    }

    /// Connects a port of one federate to one of another: a value appears at both ends at the same tag, unless more is
    /// said about the connection. The type of their values is the same, and such values can travel.
    #[track_caller]
    pub fn connect<F: Port>(&mut self, from: F, to: impl Port<Value = F::Value>) -> Connections<'_>
    where
        F::Value: Transfer,
    {
        self.connect_each([from], [to])
    }

    /// Connects the ports of two multiports or banks, one by one. There must be as many on both sides.
    #[track_caller]
    pub fn connect_each<F: Port, T: Port<Value = F::Value>>(
        &mut self,
        from: impl IntoIterator<Item = F>,
        to: impl IntoIterator<Item = T>,
    ) -> Connections<'_>
    where
        F::Value: Transfer,
    {
        let (from, to) = (ports(from), ports(to));
        for port in from.iter().chain(&to) {
            self.graph.carry(*port, Codec::of::<F::Value>());
        }
        self.graph.connect(from, to, None, Location::caller())
    }

    // Running it.

    /// Runs the federation to its end: in the process that was started by hand, launches the federates; in one of them,
    /// runs that federate and ends the process.
    ///
    /// In a federate of another federation, which comes later in `main`, it does nothing: the launcher has run this one.
    ///
    /// What federates print is shown on the standard output and error of this process, behind their names.
    ///
    /// # Errors
    ///
    /// Rules that the program breaks; the first failure of a federate, [`Failure::FederateFailed`]; that Ctrl-C or
    /// SIGTERM has stopped it, [`Failure::Interrupted`].
    pub fn run(self) -> Result<(), Failure> {
        let Self { name, graph, properties, role, unread, launching, .. } = self;
        let built = graph.build(properties);
        let which = match role {
            Role::Federate(handover) => run_federate(&handover, built),
            Role::Launcher(which) => which,
            Role::Other => {
                return unread.map_or(Ok(()), |report| Err(Failure::Mistakes(vec![report])));
            }
        };
        let (program, ..) = built?;
        describe::answer(&program, launching.store, &[])?;
        if !program.is_federated() {
            return Err(Failure::option(format!("the federation {name} has no federates")));
        }
        launching.launch(&program, &which)
    }

    /// Runs all federates in this process, one reaction after the other: for tests, and to see what the federation does
    /// without one. Values are not encoded.
    ///
    /// # Errors
    ///
    /// Rules that the program breaks, or the error that a body has returned: [`Failure::Reaction`].
    pub fn run_in_one_process(self) -> Result<(), Failure> {
        let (program, bodies, entrances) = self.graph.build(self.properties)?;
        let Launching { logical_trace, trace, .. } = self.launching;
        Runnable { program, bodies, entrances, logical_trace, trace }.run()
    }
}
