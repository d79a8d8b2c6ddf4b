//! Assembling a reactor: its ports, timers and actions, its reactions, the reactors inside it.

use std::marker::PhantomData;
use std::time::Duration;

use hprm_core::{
    ActionId, Delay, Direction, Effect, Origin, PortId, ReactionSpec, ReactorId, Spacing, Trigger,
};

use super::bodies::{BodyFn, Code, Outcome};
use super::handle::{InputPort, LogicalAction, OutputPort, PhysicalAction, Timer};
use super::{Context, Graph};
use crate::nanoseconds;

/// A reactor that is being assembled. `S` is its state, which its reactions share, `V` what ports
/// and actions hold.
pub struct Reactor<'a, S, V> {
    graph: &'a mut Graph<V>,
    id: ReactorId,
    state: PhantomData<fn(S)>,
}

impl<'a, S: Send + 'static, V: Clone + Send + Sync + 'static> Reactor<'a, S, V> {
    pub(super) fn assemble<R>(
        graph: &'a mut Graph<V>,
        parent: ReactorId,
        name: &str,
        state: S,
        assemble: impl FnOnce(&mut Reactor<'_, S, V>) -> R,
    ) -> R {
        let id = graph.builder.reactor(parent, name);
        graph.bodies.insert(id, Box::new(state));
        assemble(&mut Reactor { graph, id, state: PhantomData })
    }

    /// Adds an input port.
    pub fn input(&mut self, name: &str) -> InputPort {
        InputPort(self.graph.builder.port(self.id, name, Direction::Input))
    }

    /// Adds an output port.
    pub fn output(&mut self, name: &str) -> OutputPort {
        OutputPort(self.graph.builder.port(self.id, name, Direction::Output))
    }

    /// A timer: its first event is at `offset`, the others at each `period` after that. There are
    /// no others if that is zero.
    pub fn timer(&mut self, name: &str, offset: Duration, period: Duration) -> Timer {
        Timer(self.graph.builder.timer(self.id, name, nanoseconds(offset), nanoseconds(period)))
    }

    /// A logical action.
    pub fn logical_action(&mut self, name: &str, min_delay: Duration) -> LogicalAction {
        LogicalAction(self.action(name, Origin::Logical, min_delay))
    }

    /// A physical action.
    pub fn physical_action(&mut self, name: &str, min_delay: Duration) -> PhysicalAction {
        PhysicalAction(self.action(name, Origin::Physical, min_delay))
    }

    /// Gives an action a minimum spacing.
    pub fn space(&mut self, action: impl Into<ActionId>, spacing: Spacing) {
        self.graph.builder.space(action.into(), spacing);
    }

    /// A reactor inside this one; see [`App::reactor`](crate::App::reactor).
    pub fn reactor<T: Send + 'static, R>(
        &mut self,
        name: &str,
        state: T,
        assemble: impl FnOnce(&mut Reactor<'_, T, V>) -> R,
    ) -> R {
        Reactor::assemble(self.graph, self.id, name, state, assemble)
    }

    /// Connects two ports of this reactor or of those inside it.
    pub fn connect(&mut self, from: impl Into<PortId>, to: impl Into<PortId>) {
        self.graph.connect(from.into(), to.into(), Delay::None);
    }

    /// Connects two ports with a delay; see [`App::connect_after`](crate::App::connect_after).
    pub fn connect_after(
        &mut self,
        from: impl Into<PortId>,
        to: impl Into<PortId>,
        after: Duration,
    ) {
        self.graph.connect(from.into(), to.into(), Delay::after(nanoseconds(after)));
    }

    /// The next reaction. It runs after those before it, if they run at the same tag. Nothing is
    /// added before [`NewReaction::run`].
    pub fn reaction(&mut self) -> NewReaction<'_, 'a, S, V> {
        NewReaction { reactor: self, spec: ReactionSpec::default(), late: None }
    }

    fn action(&mut self, name: &str, origin: Origin, min_delay: Duration) -> ActionId {
        self.graph.builder.action(self.id, name, origin, nanoseconds(min_delay))
    }
}

/// A reaction that is being declared.
#[must_use = "a reaction is added by `run`"]
pub struct NewReaction<'r, 'a, S, V> {
    reactor: &'r mut Reactor<'a, S, V>,
    spec: ReactionSpec,
    late: Option<BodyFn<V>>,
}

impl<S: 'static, V> NewReaction<'_, '_, S, V> {
    /// Runs it when this is present: a port, a timer, an action, [`Trigger::Startup`] or
    /// [`Trigger::Shutdown`].
    pub fn on(mut self, trigger: impl Into<Trigger>) -> Self {
        self.spec.triggers.push(trigger.into());
        self
    }

    /// Lets it read a port that does not trigger it.
    pub fn reads(mut self, port: impl Into<PortId>) -> Self {
        self.spec.sources.push(port.into());
        self
    }

    /// Lets it set a port.
    pub fn sets(mut self, port: impl Into<PortId>) -> Self {
        self.spec.effects.push(Effect::Port(port.into()));
        self
    }

    /// Lets it schedule an action.
    pub fn schedules(mut self, action: impl Into<ActionId>) -> Self {
        self.spec.effects.push(Effect::Action(action.into()));
        self
    }

    /// Runs `handler` instead of the body if the clock is more than `deadline` ahead of the tag.
    pub fn deadline<O: Outcome>(
        mut self,
        deadline: Duration,
        handler: impl FnMut(&mut S, &mut Context<'_, V>) -> O + Send + 'static,
    ) -> Self {
        self.spec.deadline = Some(nanoseconds(deadline));
        self.late = Some(boxed(handler));
        self
    }

    /// Adds the reaction, with its body: it gets the reactor's state and the running program. An
    /// error that it returns ends the program.
    pub fn run<O: Outcome>(
        self,
        body: impl FnMut(&mut S, &mut Context<'_, V>) -> O + Send + 'static,
    ) {
        let Reactor { graph, id, .. } = self.reactor;
        graph.builder.reaction(*id, self.spec);
        graph.bodies.push(Code { main: boxed(body), deadline: self.late });
    }
}

fn boxed<S: 'static, V, O: Outcome>(
    mut body: impl FnMut(&mut S, &mut Context<'_, V>) -> O + Send + 'static,
) -> BodyFn<V> {
    Box::new(move |state, ctx| {
        let state = state.downcast_mut().expect("a reaction is given the state of its reactor");
        body(state, ctx).outcome().map_err(String::into_boxed_str)
    })
}
