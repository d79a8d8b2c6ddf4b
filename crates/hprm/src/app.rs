//! Programs in Rust: reactors whose bodies are closures.
//!
//! An [`App`] is put together, then run. Values have one type, chosen by the program: a number, an
//! `Arc` of something large, an enum of everything that travels. The scheduler decides what runs when, as
//! for any other program; an app runs in one process.

mod bodies;
mod context;
mod handle;
mod reactor;

use std::io;
use std::sync::Arc;
use std::time::Duration;

use hprm_core::{Delay, PortId, Program, ProgramBuilder, ProgramError, Properties};

use crate::{Failure, Inbox, nanoseconds, run_whole};
use bodies::Bodies;
pub use bodies::Outcome;
pub use context::Context;
pub use handle::{InputPort, LogicalAction, OutputPort, PhysicalAction, Readable, Timer};
pub use reactor::{NewReaction, Reactor};

/// A program that is being put together.
///
/// ```
/// use std::time::Duration;
///
/// use hprm::{App, Context, InputPort, OutputPort, Properties, Reactor};
///
/// /// Counts up every ten milliseconds.
/// fn counter(reactor: &mut Reactor<'_, u64, u64>) -> OutputPort {
///     let tick = reactor.timer("tick", Duration::ZERO, Duration::from_millis(10));
///     let out = reactor.output("out");
///     reactor.reaction().on(tick).sets(out).run(move |count, ctx| {
///         *count += 1;
///         ctx.set(out, *count);
///     });
///     out
/// }
///
/// /// Adds up what it gets, and stops the program when it is enough.
/// fn adder(reactor: &mut Reactor<'_, u64, u64>) -> InputPort {
///     let inp = reactor.input("inp");
///     reactor.reaction().on(inp).run(move |sum, ctx: &mut Context<'_, u64>| {
///         *sum += ctx.get(inp).copied().unwrap_or_default();
///         if *sum >= 10 {
///             assert_eq!(ctx.elapsed(), Duration::from_millis(30));
///             ctx.request_stop();
///         }
///     });
///     inp
/// }
///
/// let mut app = App::new("Counting", Properties { fast: true, ..Properties::default() });
/// let out = app.reactor("counter", 0, counter);
/// let inp = app.reactor("adder", 0, adder);
/// app.connect(out, inp);
/// app.run()?;
/// # Ok::<(), hprm::Failure>(())
/// ```
pub struct App<V> {
    graph: Graph<V>,
    inbox: Option<Inbox<V>>,
}

/// A checked program with its bodies.
pub struct Runnable<V> {
    program: Arc<Program>,
    bodies: Bodies<V>,
    inbox: Option<Inbox<V>>,
}

/// Reaches a running app from any thread. Clones reach the same one.
pub struct Sender<V> {
    inbox: Inbox<V>,
}

/// The parts of an app, while reactors are added.
struct Graph<V> {
    builder: ProgramBuilder,
    bodies: Bodies<V>,
}

impl<V: Clone + Send + Sync + 'static> App<V> {
    /// An app without reactors. `name` is for people.
    #[must_use]
    pub fn new(name: &str, properties: Properties) -> Self {
        let builder = ProgramBuilder::new(name, properties);
        Self { graph: Graph { builder, bodies: Bodies::new() }, inbox: None }
    }

    /// Adds a reactor. `assemble` gives it its ports, timers, actions and reactions, and returns
    /// what other parts of the app need of it: usually its ports.
    pub fn reactor<S: Send + 'static, R>(
        &mut self,
        name: &str,
        state: S,
        assemble: impl FnOnce(&mut Reactor<'_, S, V>) -> R,
    ) -> R {
        let main = self.graph.builder.main();
        Reactor::assemble(&mut self.graph, main, name, state, assemble)
    }

    /// Connects two ports: a value appears at both ends at the same tag.
    pub fn connect(&mut self, from: impl Into<PortId>, to: impl Into<PortId>) {
        self.graph.connect(from.into(), to.into(), Delay::None);
    }

    /// Connects two ports: a value appears at the other end `after` later; one microstep, if that
    /// is zero.
    pub fn connect_after(
        &mut self,
        from: impl Into<PortId>,
        to: impl Into<PortId>,
        after: Duration,
    ) {
        self.graph.connect(from.into(), to.into(), Delay::after(nanoseconds(after)));
    }

    /// Reaches the app while it runs.
    ///
    /// # Errors
    ///
    /// If the process has no descriptor left.
    pub fn sender(&mut self) -> io::Result<Sender<V>> {
        let inbox = match &self.inbox {
            Some(inbox) => inbox.clone(),
            None => self.inbox.insert(Inbox::new()?).clone(),
        };
        Ok(Sender { inbox })
    }

    /// Checks the program.
    ///
    /// # Errors
    ///
    /// The first rule that it breaks: a port with two sources, a loop without a delay.
    pub fn build(self) -> Result<Runnable<V>, ProgramError> {
        let program = Arc::new(self.graph.builder.build()?);
        let bodies = self.graph.bodies.of(&program);
        Ok(Runnable { program, bodies, inbox: self.inbox })
    }

    /// Checks the program and runs it to its end.
    ///
    /// # Errors
    ///
    /// The first rule that it breaks, or what a body returned.
    pub fn run(self) -> Result<(), Failure> {
        self.build()?.run()
    }
}

impl<V: Clone + Send + Sync + 'static> Runnable<V> {
    /// The program, with its levels.
    #[must_use]
    pub fn program(&self) -> &Arc<Program> {
        &self.program
    }

    /// Runs it to its end.
    ///
    /// # Errors
    ///
    /// What a body returned.
    ///
    /// # Panics
    ///
    /// If a body does.
    pub fn run(mut self) -> Result<(), Failure> {
        let inbox = match self.inbox {
            Some(inbox) => inbox,
            None => {
                Inbox::new().map_err(|error| Failure::system("no descriptor is left", &error))?
            }
        };
        run_whole(&self.program, &mut self.bodies, &inbox)
    }
}

impl<V> Clone for Sender<V> {
    fn clone(&self) -> Self {
        Self { inbox: self.inbox.clone() }
    }
}

impl<V> Sender<V> {
    /// Schedules a physical action by the clock, `extra` after its minimum delay. Returns false if
    /// the program has ended.
    pub fn schedule(
        &self,
        action: PhysicalAction,
        extra: Duration,
        value: impl Into<Option<V>>,
    ) -> bool {
        self.inbox.schedule(action.0, nanoseconds(extra), value.into())
    }

    /// Asks the program to stop at its next tag.
    pub fn request_stop(&self) {
        self.inbox.request_stop();
    }
}

impl<V> Graph<V> {
    fn connect(&mut self, from: PortId, to: PortId, delay: Delay) {
        self.builder.connect(from, to, delay);
    }
}
