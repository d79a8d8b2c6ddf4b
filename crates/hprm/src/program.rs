//! Programs in Rust: reactors are values, reactions are closures or methods.
//!
//! A [`Program`] is put together, then run. Handles carry the types of what ports and actions hold, so the compiler
//! checks connections, and the values that are set and read; inside, the scheduler has one type of values
//! (`value.rs`). The scheduler decides what runs when, as for any other program; a program in Rust runs in one process.

mod bodies;
mod builder;
mod claim;
mod connection;
mod context;
mod describe;
mod digest;
mod executable;
mod federate;
mod federation;
mod graph;
mod handed;
mod handle;
mod identity;
mod launching;
mod loan;
mod parameter_names;
mod parameters;
mod parts;
mod reaction;
mod restart;
mod running;
mod sender;
mod transport;
mod value;

use std::panic::Location;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use hprm_core::Properties;

use crate::recorder::TraceRequest;
use crate::trace::Trace;
use crate::{Failure, nanoseconds, run_whole_traced};
use bodies::Bodies;
pub use builder::{Reactor, ReactorBuilder};
pub use connection::Connections;
pub use context::Context;
pub use executable::{CarriedPort, Interface, run_as_federate, run_as_federate_with};
pub use federate::Federate;
pub use federation::Federation;
use graph::Graph;
pub use handle::{
    Action, Entry, InputPort, LogicalAction, Mode, OutputPort, PhysicalAction, Port, Ports,
    Readable, Reset, Shutdown, Startup, Timer, Triggers,
};
pub use loan::Loan;
pub use reaction::{Outcome, ReactionBuilder};
pub use restart::Restart;
use sender::Entrances;
pub use sender::{ScheduleError, Sender, WhenFull};
pub use value::Message;

/// A program that is being put together: a main reactor, with reactors inside.
///
/// ```
/// use std::time::Duration;
///
/// use hprm::prelude::*;
///
/// /// Counts up at each period.
/// struct Counter {
///     count: u32,
///     period: Duration,
/// }
///
/// impl Reactor for Counter {
///     type Ports = OutputPort<u32>;
///
///     fn assemble(&mut self, counter: &mut ReactorBuilder<'_, Self>) -> OutputPort<u32> {
///         let tick = counter.timer("tick", Duration::ZERO, self.period);
///         let out = counter.output("out");
///         counter.reaction().on(tick).sets(out).run(move |counter, ctx| {
///             counter.count += 1;
///             ctx.set(out, counter.count);
///         });
///         out
///     }
/// }
///
/// let mut program = Program::new("Counting").fast();
/// let period = Duration::from_millis(10);
/// let out = program.add("counter", Counter { count: 0, period });
/// // Adds up what it gets, and stops the program when it is enough.
/// let inp = program.reactor("adder", 0, |adder| {
///     let inp = adder.input("inp");
///     adder.reaction().on(inp).run(move |sum, ctx| {
///         *sum += ctx.get(inp).copied().unwrap_or_default();
///         if *sum >= 10 {
///             assert_eq!(ctx.elapsed(), 3 * period);
///             ctx.request_stop();
///         }
///     });
///     inp
/// });
/// program.connect(out, inp);
/// program.run()?;
/// # Ok::<(), Failure>(())
/// ```
pub struct Program {
    graph: Graph,
    properties: Properties,
    logical_trace: Option<PathBuf>,
    trace: Option<PathBuf>,
}

/// A checked program, ready to run. It is made where what is wrong with a program is to be known before it runs.
///
/// ```
/// use hprm::prelude::*;
///
/// let mut program = Program::new("Checked");
/// program.main().reaction().on(Startup).run(|(), _| println!("it runs"));
/// let runnable: Runnable = program.build()?;
/// runnable.run()?;
/// # Ok::<(), Failure>(())
/// ```
pub struct Runnable {
    program: Arc<hprm_core::Program>,
    bodies: Bodies,
    entrances: Entrances,
    logical_trace: Option<PathBuf>,
    trace: Option<PathBuf>,
}

impl Program {
    /// A program without reactors. `name` is for people.
    #[must_use]
    pub fn new(name: &str) -> Self {
        Self {
            graph: Graph::new(name),
            properties: Properties::default(),
            logical_trace: None,
            trace: None,
        }
    }

    // How it runs.

    /// Does not wait for physical time: the program runs as fast as it can.
    #[must_use]
    pub fn fast(mut self) -> Self {
        self.properties.fast = true;
        self
    }

    /// Does not end when nothing is left to do, because threads may still schedule physical actions.
    #[must_use]
    pub fn keepalive(mut self) -> Self {
        self.properties.keepalive = true;
        self
    }

    /// Ends it so long after its start.
    #[must_use]
    pub fn timeout(mut self, timeout: Duration) -> Self {
        self.properties.timeout = Some(nanoseconds(timeout));
        self
    }

    /// Runs up to so many reactions at the same time that do not depend on one another, each in a thread; zero is as many
    /// as there are processors. What the program does is the same for any number.
    #[must_use]
    pub fn workers(mut self, workers: u32) -> Self {
        self.properties.workers = Some(workers);
        self
    }

    /// Replaces all properties.
    #[must_use]
    pub fn properties(mut self, properties: Properties) -> Self {
        self.properties = properties;
        self
    }

    /// Writes what reactions do to a file, which `hprm diff` compares with that of another run.
    #[must_use]
    pub fn logical_trace(mut self, file: impl Into<PathBuf>) -> Self {
        self.logical_trace = Some(file.into());
        self
    }

    /// Writes when reactions, messages and grants were, to a file that Perfetto opens.
    #[must_use]
    pub fn trace(mut self, file: impl Into<PathBuf>) -> Self {
        self.trace = Some(file.into());
        self
    }

    // What is in it.

    /// The main reactor, which has no state: it may have timers, actions and reactions as well.
    pub fn main(&mut self) -> ReactorBuilder<'_, ()> {
        let main = self.graph.parts.root();
        ReactorBuilder::new(&mut self.graph, main)
    }

    /// Adds a reactor, and returns its ports. The reactors in one reactor have different names.
    #[track_caller]
    pub fn add<R: Reactor>(&mut self, name: &str, reactor: R) -> R::Ports {
        self.main().add(name, reactor)
    }

    /// Adds a bank: a reactor for each item, which are `name[0]` and so on.
    ///
    /// ```
    /// use hprm::prelude::*;
    ///
    /// struct Worker {
    ///     id: u32,
    /// }
    ///
    /// impl Reactor for Worker {
    ///     type Ports = OutputPort<u32>;
    ///
    ///     fn assemble(&mut self, worker: &mut ReactorBuilder<'_, Self>) -> OutputPort<u32> {
    ///         let out = worker.output("out");
    ///         worker.reaction().on(Startup).sets(out).run(move |worker, ctx| ctx.set(out, worker.id));
    ///         out
    ///     }
    /// }
    ///
    /// let mut program = Program::new("Bank").fast();
    /// let workers = program.bank("worker", (1..=4).map(|id| Worker { id }));
    /// let inputs = program.reactor("sum", (), |sum| {
    ///     let inputs = sum.inputs("inp", 4);
    ///     let all = inputs.clone();
    ///     sum.reaction().on(&inputs).run(move |(), ctx| {
    ///         assert_eq!(ctx.present(&all).map(|(_, id)| id).sum::<u32>(), 10);
    ///     });
    ///     inputs
    /// });
    /// program.connect_each(workers, inputs);
    /// program.run()?;
    /// # Ok::<(), Failure>(())
    /// ```
    #[track_caller]
    pub fn bank<R: Reactor>(
        &mut self,
        name: &str,
        reactors: impl IntoIterator<Item = R>,
    ) -> Vec<R::Ports> {
        self.main().bank(name, reactors)
    }

    /// Adds a reactor that is not worth a type: its state, and a closure that gives it its ports, timers, actions and
    /// reactions, and returns what other parts of the program need of it.
    #[track_caller]
    pub fn reactor<S: Send + 'static, R>(
        &mut self,
        name: &str,
        state: S,
        assemble: impl FnOnce(&mut ReactorBuilder<'_, S>) -> R,
    ) -> R {
        self.main().reactor(name, state, assemble)
    }

    /// Connects two ports: a value appears at both ends at the same tag, unless more is said about the connection. The
    /// type of their values is the same.
    #[track_caller]
    pub fn connect<F: Port>(
        &mut self,
        from: F,
        to: impl Port<Value = F::Value>,
    ) -> Connections<'_> {
        self.connect_each([from], [to])
    }

    /// Connects the ports of two multiports or banks, one by one. There must be as many on both sides.
    #[track_caller]
    pub fn connect_each<F: Port, T: Port<Value = F::Value>>(
        &mut self,
        from: impl IntoIterator<Item = F>,
        to: impl IntoIterator<Item = T>,
    ) -> Connections<'_> {
        self.graph.connect(handle::ports(from), handle::ports(to), None, Location::caller())
    }

    /// Reaches a physical action from other threads, while the program runs.
    #[track_caller]
    pub fn sender<T>(&mut self, action: PhysicalAction<T>) -> Sender<T> {
        self.graph.sender(action, Location::caller())
    }

    // Running it.

    /// Checks the program.
    ///
    /// ```
    /// use hprm::prelude::*;
    ///
    /// let mut program = Program::new("Main");
    /// program.reactor("relay", (), |relay| {
    ///     let (inp, out) = (relay.input::<u32>("inp"), relay.output("out"));
    ///     relay.reaction().on(inp).sets(out).run(move |(), ctx| ctx.set(out, 1));
    ///     relay.connect(out, inp);
    /// });
    /// let mistake = program.build().err().expect("a reaction cannot precede itself");
    /// assert!(mistake.to_string().contains("Main.relay.1"));
    /// ```
    ///
    /// # Errors
    ///
    /// Rules that it breaks: a port with two sources, a cycle without a delay, a reaction that sets a port of another
    /// reactor.
    pub fn build(self) -> Result<Runnable, Failure> {
        let (program, bodies, entrances) = self.graph.build(self.properties)?;
        let Self { logical_trace, trace, .. } = self;
        Ok(Runnable { program, bodies, entrances, logical_trace, trace })
    }

    /// Checks the program and runs it to its end.
    ///
    /// # Errors
    ///
    /// Rules that it breaks, or the error that a body has returned: [`Failure::Reaction`].
    ///
    /// # Panics
    ///
    /// If a body does.
    pub fn run(self) -> Result<(), Failure> {
        self.build()?.run()
    }
}

impl Runnable {
    /// Runs it to its end.
    ///
    /// # Errors
    ///
    /// The error that a body has returned: [`Failure::Reaction`].
    ///
    /// # Panics
    ///
    /// If a body does.
    pub fn run(mut self) -> Result<(), Failure> {
        describe::answer_in_one(&self.program)?;
        let inbox = self.entrances.ready()?;
        let trace =
            self.logical_trace.map(|file| Trace::create(&file, &self.program)).transpose()?;
        let request = self.trace.map(TraceRequest::file);
        sender::running_reactions(|| {
            run_whole_traced(&self.program, &mut self.bodies, &inbox, trace, request.as_ref())
        })
    }
}
