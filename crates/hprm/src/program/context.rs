//! What a body sees of the running program, and what it can do.

use std::time::Duration;

use bytemuck::Pod;
use hprm_codec::Element;
use hprm_core::{Effects, PhysicalTime, PortId, ReactionId, Scheduler, Tag};

use super::bodies::Site;
use super::handle::{Action, Entry, Key, Port, Readable, Slot};
use super::identity::{Of, Part};
use super::loan::Loan;
use super::value::Value;
use crate::Clock;
use crate::nanoseconds;

/// The program, as the reaction that is running sees it.
///
/// A reaction touches only what it declares; whatever else it tries is a mistake in the program
/// and panics, because the order of reactions follows from what they declare.
///
/// ```
/// use std::time::Duration;
///
/// use hprm::prelude::*;
///
/// let mut program = Program::new("Main").fast();
/// let mut main = program.main();
/// let again = main.logical_action::<&str>("again", Duration::from_secs(1));
/// main.reaction().on(Startup).on(again).schedules(again).run(move |(), ctx| {
///     match ctx.get(again) {
///         None => ctx.schedule(again, Duration::from_secs(1), "hello"),
///         Some(text) => assert_eq!((*text, ctx.elapsed()), ("hello", Duration::from_secs(2))),
///     }
/// });
/// program.run()?;
/// # Ok::<(), Failure>(())
/// ```
pub struct Context<'a> {
    pub(super) access: Access<'a>,
    pub(super) reaction: ReactionId,
    pub(super) site: &'a Site,
}

/// How a reaction reaches the scheduler.
pub(super) enum Access<'a> {
    /// It runs alone.
    Alone(&'a mut Scheduler<Value>),
    /// It runs at the same time as other reactions.
    Shared(&'a Scheduler<Value>, &'a mut Effects<Value>),
}

impl Context<'_> {
    /// The value at a port or of an action. None if it is absent.
    ///
    /// # Panics
    ///
    /// If the reaction does not declare it.
    #[inline]
    #[track_caller]
    pub fn get<H: Readable>(&self, handle: H) -> Option<&H::Value> {
        let value = match self.readable(handle.slot()) {
            Slot::Port(port) => self.port(port),
            Slot::Action(action) => self.scheduler().action(action).flatten(),
        };
        value.map(|value| {
            H::read(value).expect("a handle has the type that its part was declared with")
        })
    }

    /// Whether a port or an action is present at this tag.
    ///
    /// # Panics
    ///
    /// If the reaction does not declare it.
    #[track_caller]
    pub fn is_present(&self, handle: impl Readable) -> bool {
        match self.readable(handle.slot()) {
            Slot::Port(port) => self.port(port).is_some(),
            Slot::Action(action) => self.scheduler().action(action).is_some(),
        }
    }

    /// Those of several ports that are present, each with its index and its value.
    ///
    /// ```
    /// # use hprm::prelude::*;
    /// fn sum(inputs: &[InputPort<u32>], ctx: &Context<'_>) -> u32 {
    ///     ctx.present(inputs).map(|(_, value)| value).sum()
    /// }
    /// ```
    ///
    /// # Panics
    ///
    /// If the reaction does not declare one of them.
    pub fn present<'s, H: Readable>(
        &'s self,
        handles: &'s [H],
    ) -> impl Iterator<Item = (usize, &'s H::Value)> {
        let values = handles.iter().enumerate();
        values.filter_map(|(index, handle)| Some((index, self.get(*handle)?)))
    }

    /// Sets a port at this tag. The last value that is set wins. A value of another type than the port's does not
    /// compile:
    ///
    /// ```compile_fail,E0308
    /// # use hprm::prelude::*;
    /// fn body(ctx: &mut Context<'_>, port: OutputPort<u32>) {
    ///     ctx.set(port, 1.5);
    /// }
    /// ```
    ///
    /// # Panics
    ///
    /// If the port is no effect of the reaction.
    #[inline]
    #[track_caller]
    pub fn set<P: Port>(&mut self, port: P, value: P::Value) {
        let slot = port.slot();
        if !self.site.affects(slot.key()) {
            self.undeclared("set", slot, "sets");
        }
        let Slot::Port(port) = slot.id else { return };
        let value = Value::new(value);
        match &mut self.access {
            Access::Alone(scheduler) => _ = scheduler.set(port, value),
            Access::Shared(_, effects) => effects.set(port, value),
        }
    }

    /// Schedules an action: a logical one `extra` after the current tag and its minimum delay, a physical one by the
    /// clock.
    ///
    /// # Panics
    ///
    /// If the action is no effect of the reaction.
    #[inline]
    #[track_caller]
    pub fn schedule<A: Action>(&mut self, action: A, extra: Duration, value: A::Value) {
        let slot = action.slot();
        if !self.site.affects(slot.key()) {
            self.undeclared("schedule", slot, "schedules");
        }
        let Slot::Action(action) = slot.id else { return };
        let (extra, value) = (nanoseconds(extra), Some(A::wrap(value)));
        match &mut self.access {
            Access::Alone(scheduler) => _ = scheduler.schedule(action, extra, value, Clock::now),
            Access::Shared(scheduler, effects) => {
                effects.schedule(scheduler, action, extra, value, Clock::now);
            }
        }
    }

    /// Has the reactor enter a mode when the tag is complete. Of several requests at one tag, the last one wins.
    ///
    /// # Panics
    ///
    /// If the reaction does not declare it, in this way: see
    /// [`ReactionBuilder::enters`](crate::ReactionBuilder::enters).
    #[track_caller]
    pub fn enter(&mut self, entry: Entry) {
        let Entry(mode, transition) = entry;
        if !self.site.affects(entry.key()) {
            self.refuse_strange("enter", mode);
            let mode = &self.scheduler().program().modes[mode.id].name;
            self.undeclared_named("enter mode", mode, "enters");
        }
        match &mut self.access {
            Access::Alone(scheduler) => scheduler.enter(mode.id, transition),
            Access::Shared(_, effects) => effects.enter(mode.id, transition),
        }
    }

    /// An array of that shape to write, in memory that other federates of this machine can read: it is sent without a
    /// copy. What it contains at first is arbitrary, so write all of it.
    ///
    /// ```
    /// use hprm::prelude::*;
    ///
    /// fn capture(image: OutputPort<Array<u8>>, ctx: &mut Context<'_>) {
    ///     let mut pixels = ctx.loan::<u8>(&[480, 640, 3]);
    ///     pixels.fill(7);
    ///     ctx.set(image, pixels.into());
    /// }
    /// ```
    ///
    /// # Panics
    ///
    /// If there is no memory for an array of that shape.
    pub fn loan<T: Element + Pod>(&self, shape: &[usize]) -> Loan<T> {
        Loan::new(self.site.memory.as_ref(), shape)
    }

    /// Ends the program at the next microstep.
    pub fn request_stop(&mut self) {
        match &mut self.access {
            Access::Alone(scheduler) => scheduler.request_stop(),
            Access::Shared(_, effects) => effects.request_stop(),
        }
    }

    /// Ends this federate at its next tag, while the others go on. If it is transient, it may join again. A program
    /// without federates ends.
    ///
    /// ```
    /// use hprm::prelude::*;
    ///
    /// let mut program = Program::new("Leaving");
    /// let mut main = program.main();
    /// main.timer("tick", std::time::Duration::ZERO, std::time::Duration::from_millis(1));
    /// main.reaction().on(Startup).run(|(), ctx| ctx.leave());
    /// main.reaction().on(Shutdown).run(|(), ctx| assert_eq!(ctx.tag().microstep, 1));
    /// program.run()?;
    /// # Ok::<(), Failure>(())
    /// ```
    pub fn leave(&mut self) {
        match &mut self.access {
            Access::Alone(scheduler) => scheduler.leave(),
            Access::Shared(_, effects) => effects.leave(),
        }
    }

    /// The current tag.
    #[must_use]
    pub fn tag(&self) -> Tag {
        self.scheduler().tag()
    }

    /// Logical time since the start.
    #[must_use]
    pub fn elapsed(&self) -> Duration {
        Duration::from_nanos(self.tag().time.unsigned_abs())
    }

    /// Logical time since the Unix epoch.
    #[must_use]
    pub fn logical_time(&self) -> PhysicalTime {
        self.tag().due(self.scheduler().start_time())
    }

    /// How far the clock is ahead of logical time; zero if it is not.
    #[must_use]
    pub fn lag(&self) -> Duration {
        let lag = Clock::now().since(self.logical_time());
        Duration::from_nanos(u64::try_from(lag).unwrap_or(0))
    }

    /// Whether the deadline of the reaction has passed by now.
    #[must_use]
    pub fn misses_deadline(&self) -> bool {
        let (reaction, now) = (self.reaction, Clock::now());
        match &self.access {
            Access::Alone(scheduler) => scheduler.misses_deadline(reaction, now),
            Access::Shared(scheduler, effects) => effects.misses_deadline(scheduler, reaction, now),
        }
    }

    /// Changes the deadline of the reaction from now on.
    pub fn set_deadline(&mut self, deadline: Duration) {
        match &mut self.access {
            Access::Alone(scheduler) => {
                scheduler.set_deadline(self.reaction, nanoseconds(deadline));
            }
            Access::Shared(_, effects) => effects.set_deadline(nanoseconds(deadline)),
        }
    }

    #[inline]
    fn scheduler(&self) -> &Scheduler<Value> {
        match &self.access {
            Access::Alone(scheduler) => scheduler,
            Access::Shared(scheduler, _) => scheduler,
        }
    }

    #[inline]
    fn port(&self, port: PortId) -> Option<&Value> {
        match &self.access {
            Access::Alone(scheduler) => scheduler.port(port),
            Access::Shared(scheduler, effects) if self.site.affects(self.key(port)) => {
                effects.port(scheduler, port)
            }
            Access::Shared(scheduler, _) => scheduler.port(port),
        }
    }

    #[inline]
    fn key(&self, port: PortId) -> Key {
        Of { id: Slot::Port(port), graph: self.site.graph }.key()
    }

    #[inline]
    #[track_caller]
    fn readable(&self, slot: Of<Slot>) -> Slot {
        if !self.site.reads(slot.key()) {
            self.undeclared("read", slot, "reads");
        }
        slot.id
    }

    /// Panics if a part belongs to another program.
    #[track_caller]
    fn refuse_strange<I: Copy + Into<Part>>(&self, verb: &str, part: Of<I>) {
        if part.graph != self.site.graph {
            let reaction = self.scheduler().program().reaction_name(self.reaction);
            panic!("reaction {reaction} cannot {verb} {}", part.told_elsewhere());
        }
    }

    #[cold]
    #[track_caller]
    fn undeclared(&self, verb: &str, slot: Of<Slot>, method: &str) -> ! {
        self.refuse_strange(verb, slot);
        let program = self.scheduler().program();
        match slot.id {
            Slot::Port(port) => self.undeclared_named(verb, &program.port_name(port), method),
            Slot::Action(action) => {
                // An action is read only if it triggers the reaction.
                let method = if method == "reads" { "on" } else { method };
                self.undeclared_named(verb, &program.actions[action].name, method)
            }
        }
    }

    #[cold]
    #[track_caller]
    fn undeclared_named(&self, verb: &str, name: &str, method: &str) -> ! {
        let reaction = self.scheduler().program().reaction_name(self.reaction);
        panic!(
            "reaction {reaction} cannot {verb} {name}, which it does not declare; add \
             `.{method}(...)` to the reaction"
        )
    }
}
