//! Declaring a reaction: what triggers it, what it may touch, and its body.

use std::error::Error;
use std::panic::Location;
use std::time::Duration;

use hprm_core::{Effect, ModalElement, ReactionSpec};

use super::bodies::{BodyFn, Code};
use super::builder::ReactorBuilder;
use super::context::Context;
use super::handle::{Action, Entry, Ports, Triggers};
use super::identity::{Of, Part};
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
    /// Where it begins.
    at: &'static Location<'static>,
}

impl<'r, 'a, S: Send + 'static> ReactionBuilder<'r, 'a, S> {
    #[track_caller]
    pub(super) fn new(reactor: &'r mut ReactorBuilder<'a, S>) -> Self {
        let (spec, at) = (ReactionSpec::default(), Location::caller());
        Self { reactor, spec, late: None, tardy: None, at }
    }

    /// A part that it names, if that is one of its own program; otherwise it is a mistake.
    fn own<I: Copy + Into<Part>>(
        &mut self,
        part: Of<I>,
        verb: &str,
        at: &Location<'_>,
    ) -> Option<I> {
        let reactor = self.reactor.id;
        self.reactor.graph.own(part, at, |graph| {
            format!("a reaction of {} cannot {verb}", graph.parts.reactor_name(reactor))
        })
    }

    /// Runs it when this is present, or one of these; see [`Triggers`].
    #[track_caller]
    pub fn on(mut self, triggers: impl Triggers) -> Self {
        let at = Location::caller();
        triggers.each(&mut |trigger, graph| {
            let part = Part::of_trigger(trigger).zip(graph).map(|(id, graph)| Of { id, graph });
            if part.is_none_or(|part| self.own(part, "be triggered by", at).is_some()) {
                self.spec.triggers.push(trigger);
            }
        });
        self
    }

    /// Lets it read ports that do not trigger it.
    #[track_caller]
    pub fn reads(mut self, ports: impl Ports) -> Self {
        let at = Location::caller();
        ports.each_port(&mut |port| {
            let port = self.own(port, "read", at);
            self.spec.sources.extend(port);
        });
        self
    }

    /// Lets it set ports.
    #[track_caller]
    pub fn sets(mut self, ports: impl Ports) -> Self {
        let at = Location::caller();
        ports.each_port(&mut |port| {
            let port = self.own(port, "set", at);
            self.spec.effects.extend(port.map(Effect::Port));
        });
        self
    }

    /// Lets it schedule an action.
    #[track_caller]
    pub fn schedules(mut self, action: impl Action) -> Self {
        let at = Location::caller();
        let action = action.slot().action().and_then(|action| self.own(action, "schedule", at));
        self.spec.effects.extend(action.map(Effect::Action));
        self
    }

    /// Lets it have its reactor enter a mode, in the way that is named here.
    #[track_caller]
    pub fn enters(mut self, entry: Entry) -> Self {
        let Entry(mode, transition) = entry;
        let mode = self.own(mode, "enter", Location::caller());
        self.spec.effects.extend(mode.map(|mode| Effect::Mode(mode, transition)));
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
        let reaction = self.reactor.graph.reaction(self.reactor.id, self.spec, self.at);
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
