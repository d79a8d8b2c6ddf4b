//! Declaring a reaction: what triggers it, what it may touch, and its body.

use std::error::Error;
use std::time::Duration;

use hprm_core::{Effect, ModalElement, ReactionSpec};

use super::bodies::{BodyFn, Code};
use super::builder::ReactorBuilder;
use super::context::Context;
use super::handle::{Action, Entry, Ports, Slot, Triggers};
use crate::nanoseconds;

/// What a body returns: nothing, or a result whose error ends the program.
///
/// ```
/// use hprm::prelude::*;
///
/// let mut program = Program::new("Main").fast();
/// program.reactor("parser", (), |parser| {
///     parser.reaction().on(Startup).run(|(), _| "x".parse::<u8>().map(drop));
/// });
/// let failure = program.run().unwrap_err();
/// let expected = "reaction Main.parser.1 failed at (0 ns, 0): invalid digit found in string";
/// assert_eq!(failure.to_string(), expected);
/// let source = std::error::Error::source(&failure).expect("it is the error that the body has returned");
/// assert!(source.is::<std::num::ParseIntError>());
/// ```
pub trait Outcome {
    /// The error, if there is one.
    ///
    /// # Errors
    ///
    /// If the body failed.
    fn outcome(self) -> Result<(), Box<dyn Error + Send + Sync>>;
}

impl Outcome for () {
    #[inline]
    fn outcome(self) -> Result<(), Box<dyn Error + Send + Sync>> {
        Ok(())
    }
}

impl<E: Into<Box<dyn Error + Send + Sync>>> Outcome for Result<(), E> {
    #[inline]
    fn outcome(self) -> Result<(), Box<dyn Error + Send + Sync>> {
        self.map_err(E::into)
    }
}

/// A reaction that is being declared.
///
/// Its body touches what is declared here and nothing else, because the order of reactions follows from that.
///
/// ```
/// use std::time::Duration;
///
/// use hprm::prelude::*;
///
/// let mut program = Program::new("Main").fast();
/// program.reactor("countdown", 3, |countdown| {
///     let next = countdown.logical_action("next", Duration::from_millis(1));
///     countdown.reaction().on([Startup]).schedules(next).run(move |_, ctx| {
///         ctx.schedule(next, Duration::ZERO, ());
///     });
///     countdown.reaction().on(next).schedules(next).run(move |left, ctx| {
///         *left -= 1;
///         if *left > 0 {
///             ctx.schedule(next, Duration::ZERO, ());
///         }
///     });
///     countdown.reaction().on(Shutdown).run(|left, ctx| {
///         assert_eq!((*left, ctx.elapsed()), (0, Duration::from_millis(3)));
///     });
/// });
/// program.run()?;
/// # Ok::<(), Failure>(())
/// ```
#[must_use = "a reaction is added by `run`"]
pub struct ReactionBuilder<'r, 'a, S> {
    reactor: &'r mut ReactorBuilder<'a, S>,
    spec: ReactionSpec,
    late: Option<BodyFn>,
    tardy: Option<BodyFn>,
}

impl<'r, 'a, S: Send + 'static> ReactionBuilder<'r, 'a, S> {
    pub(super) fn new(reactor: &'r mut ReactorBuilder<'a, S>) -> Self {
        Self { reactor, spec: ReactionSpec::default(), late: None, tardy: None }
    }

    /// Runs it when this is present, or one of these; see [`Triggers`].
    pub fn on(mut self, triggers: impl Triggers) -> Self {
        triggers.each(&mut |trigger| self.spec.triggers.push(trigger));
        self
    }

    /// Lets it read ports that do not trigger it.
    pub fn reads(mut self, ports: impl Ports) -> Self {
        ports.each_port(&mut |port| self.spec.sources.push(port));
        self
    }

    /// Lets it set ports.
    pub fn sets(mut self, ports: impl Ports) -> Self {
        ports.each_port(&mut |port| self.spec.effects.push(Effect::Port(port)));
        self
    }

    /// Lets it schedule an action.
    pub fn schedules(mut self, action: impl Action) -> Self {
        if let Slot::Action(action) = action.slot() {
            self.spec.effects.push(Effect::Action(action));
        }
        self
    }

    /// Lets it have its reactor enter a mode, in the way that is named here.
    pub fn enters(mut self, entry: Entry) -> Self {
        self.spec.effects.push(Effect::Mode(entry.0, entry.1));
        self
    }

    /// Runs `handler` instead of the body if the clock is more than `deadline` ahead of the tag.
    ///
    /// ```
    /// use std::time::Duration;
    ///
    /// use hprm::prelude::*;
    ///
    /// let mut program = Program::new("Main").fast();
    /// program.reactor("brake", false, |brake| {
    ///     brake
    ///         .reaction()
    ///         .on(Startup)
    ///         // Always too late.
    ///         .deadline(Duration::ZERO, |late, _| *late = true)
    ///         .run(|late, _| *late = false);
    ///     brake.reaction().on(Shutdown).run(|late, _| assert!(*late));
    /// });
    /// program.run()?;
    /// # Ok::<(), Failure>(())
    /// ```
    pub fn deadline<O: Outcome>(
        mut self,
        deadline: Duration,
        handler: impl FnMut(&mut S, &mut Context<'_>) -> O + Send + 'static,
    ) -> Self {
        self.spec.deadline = Some(nanoseconds(deadline));
        self.late = Some(boxed(handler));
        self
    }

    /// Runs `handler` instead of the body if an input has come after its tag: under decentralized coordination, when
    /// the federate did not wait for it long enough ([`Federate::maxwait`](crate::Federate::maxwait)).
    ///
    /// ```
    /// use hprm::prelude::*;
    ///
    /// let mut program = Program::new("Main").fast();
    /// program.reactor("planner", 0, |planner| {
    ///     let scan = planner.input::<f64>("scan");
    ///     planner
    ///         .reaction()
    ///         .on(scan)
    ///         .tardy(|missed, _| *missed += 1)
    ///         .run(move |_, ctx| assert!(ctx.is_present(scan)));
    /// });
    /// program.run()?;
    /// # Ok::<(), Failure>(())
    /// ```
    pub fn tardy<O: Outcome>(
        mut self,
        handler: impl FnMut(&mut S, &mut Context<'_>) -> O + Send + 'static,
    ) -> Self {
        self.spec.handles_tardy = true;
        self.tardy = Some(boxed(handler));
        self
    }

    /// Adds the reaction, with its body: it gets the reactor's state and the running program. An error that it returns
    /// ends the program.
    pub fn run<O: Outcome>(self, body: impl FnMut(&mut S, &mut Context<'_>) -> O + Send + 'static) {
        let reaction = self.reactor.graph.parts.reaction(self.reactor.id, self.spec);
        self.reactor.put_in_mode(ModalElement::Reaction(reaction));
        self.reactor.graph.bodies.insert_code(
            reaction,
            Code { main: boxed(body), deadline: self.late, tardy: self.tardy },
        );
    }
}

fn boxed<S: 'static, O: Outcome>(
    mut body: impl FnMut(&mut S, &mut Context<'_>) -> O + Send + 'static,
) -> BodyFn {
    Box::new(move |state, ctx| {
        let state = state.downcast_mut().expect("a reaction is given the state of its reactor");
        body(state, ctx).outcome()
    })
}
