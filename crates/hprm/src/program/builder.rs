//! Assembling a reactor: its ports, timers, actions, modes and reactions, and the reactors inside it.

use std::marker::PhantomData;
use std::panic::Location;
use std::time::Duration;

use hprm_core::{ActionId, Direction, ModalElement, ModeId, Origin, PortId, ReactorId, Spacing};

use super::connection::Connections;
use super::graph::Graph;
use super::handle::{
    Action, InputPort, LogicalAction, Mode, OutputPort, PhysicalAction, Port, Timer, ports,
};
use super::identity::{Named, Of, Part};
use super::reaction::ReactionBuilder;
use super::sender::{Sender, WhenFull};
use super::value::Message;
use crate::nanoseconds;

/// A reactor that is a type: its fields are its state and its parameters.
///
/// ```
/// use std::time::Duration;
///
/// use hprm::prelude::*;
///
/// /// Sends every value on, times a factor.
/// struct Gain<T> {
///     factor: T,
/// }
///
/// #[derive(Clone, Copy)]
/// struct GainPorts<T> {
///     inp: InputPort<T>,
///     out: OutputPort<T>,
/// }
///
/// impl<T: Message + Copy + std::ops::Mul<Output = T>> Reactor for Gain<T> {
///     type Ports = GainPorts<T>;
///
///     fn assemble(&mut self, gain: &mut ReactorBuilder<'_, Self>) -> GainPorts<T> {
///         let ports = GainPorts { inp: gain.input("inp"), out: gain.output("out") };
///         gain.reaction().on(ports.inp).sets(ports.out).run(move |gain, ctx| gain.scale(ports, ctx));
///         ports
///     }
/// }
///
/// impl<T: Message + Copy + std::ops::Mul<Output = T>> Gain<T> {
///     fn scale(&mut self, ports: GainPorts<T>, ctx: &mut Context<'_>) {
///         if let Some(value) = ctx.get(ports.inp) {
///             ctx.set(ports.out, *value * self.factor);
///         }
///     }
/// }
///
/// let mut program = Program::new("Gains").fast();
/// let first = program.add("first", Gain { factor: 2.0 });
/// let second = program.add("second", Gain { factor: 0.25 });
/// program.connect(first.out, second.inp);
/// let mut main = program.main();
/// main.reaction().on(Startup).sets(first.inp).run(move |(), ctx| ctx.set(first.inp, 10.0));
/// main.reaction().on(second.out).run(move |(), ctx| assert_eq!(ctx.get(second.out), Some(&5.0)));
/// program.run()?;
/// # Ok::<(), Failure>(())
/// ```
pub trait Reactor: Sized + Send + 'static {
    /// What other parts of the program need of it: usually its ports.
    type Ports;

    /// Gives it its ports, timers, actions and reactions. After that, it is the state that its reactions share.
    fn assemble(&mut self, builder: &mut ReactorBuilder<'_, Self>) -> Self::Ports;
}

/// A reactor that is being assembled. `S` is its state, which its reactions share.
///
/// [`Reactor`] has an example; [`Program::reactor`](crate::Program::reactor) gives one to a closure.
pub struct ReactorBuilder<'a, S> {
    pub(super) graph: &'a mut Graph,
    pub(super) id: ReactorId,
    /// The mode that contains what is declared now.
    pub(super) mode: Option<ModeId>,
    state: PhantomData<fn(S)>,
}

impl<'a, S: Send + 'static> ReactorBuilder<'a, S> {
    pub(super) fn new(graph: &'a mut Graph, id: ReactorId) -> Self {
        Self { graph, id, mode: None, state: PhantomData }
    }

    // What a reactor has.

    /// Adds an input port for values of the type `T`. Ports, actions, timers and modes of one reactor have different
    /// names.
    #[track_caller]
    pub fn input<T: Message>(&mut self, name: &str) -> InputPort<T> {
        self.declare(name, Location::caller());
        InputPort::new(self.port(name, Direction::Input))
    }

    /// Adds an output port for values of the type `T`.
    #[track_caller]
    pub fn output<T: Message>(&mut self, name: &str) -> OutputPort<T> {
        self.declare(name, Location::caller());
        OutputPort::new(self.port(name, Direction::Output))
    }

    /// Adds a multiport: so many input ports, which are `name[0]` and so on.
    #[track_caller]
    pub fn inputs<T: Message>(&mut self, name: &str, width: usize) -> Vec<InputPort<T>> {
        self.declare(name, Location::caller());
        let port = |index| self.port(&format!("{name}[{index}]"), Direction::Input);
        (0..width).map(port).map(InputPort::new).collect()
    }

    /// Adds a multiport: so many output ports, which are `name[0]` and so on.
    #[track_caller]
    pub fn outputs<T: Message>(&mut self, name: &str, width: usize) -> Vec<OutputPort<T>> {
        self.declare(name, Location::caller());
        let port = |index| self.port(&format!("{name}[{index}]"), Direction::Output);
        (0..width).map(port).map(OutputPort::new).collect()
    }

    /// Adds a timer: its first event is at `offset`, the others at each `period` after that. There are no others if that
    /// is zero.
    #[track_caller]
    pub fn timer(&mut self, name: &str, offset: Duration, period: Duration) -> Timer {
        self.declare(name, Location::caller());
        let (offset, period) = (nanoseconds(offset), nanoseconds(period));
        let timer = self.graph.parts.timer(self.id, name, offset, period);
        self.put_in_mode(ModalElement::Timer(timer));
        Timer(self.graph.handle(timer, self.id, name))
    }

    /// Adds an action that is scheduled relative to the current tag; `min_delay` is added to each delay.
    #[track_caller]
    pub fn logical_action<T: Message>(
        &mut self,
        name: &str,
        min_delay: Duration,
    ) -> LogicalAction<T> {
        self.declare(name, Location::caller());
        LogicalAction::new(self.action(name, Origin::Logical, min_delay))
    }

    /// Adds an action that is scheduled by the clock; `min_delay` is added to each delay. Other threads schedule it with
    /// a [`Sender`].
    #[track_caller]
    pub fn physical_action<T: Message>(
        &mut self,
        name: &str,
        min_delay: Duration,
    ) -> PhysicalAction<T> {
        self.declare(name, Location::caller());
        let action = self.action(name, Origin::Physical, min_delay);
        self.graph.entrances.add(action.id, self.graph.full_name(self.id, name));
        PhysicalAction::new(action)
    }

    /// Gives an action of this reactor a minimum spacing.
    #[track_caller]
    pub fn space(&mut self, action: impl Action, spacing: Spacing) {
        let at = Location::caller();
        if let Some(action) = action.slot().action().and_then(|it| self.own(it, "space", at)) {
            self.graph.parts.space(action, spacing);
        }
    }

    /// States how many events of an action of this reactor that other threads have scheduled may wait, 100,000 if this
    /// is not called, and what [`Sender::schedule`] does about one more. At least one may wait.
    #[track_caller]
    pub fn bound<T>(&mut self, action: PhysicalAction<T>, events: usize, when_full: WhenFull) {
        if let Some(action) = self.own(action.0, "bound", Location::caller()) {
            self.graph.entrances.bound(action, events, when_full);
        }
    }

    /// Reaches an action from other threads.
    #[track_caller]
    pub fn sender<T>(&mut self, action: PhysicalAction<T>) -> Sender<T> {
        self.graph.sender(action, Location::caller())
    }

    /// The next reaction. It runs after those before it, if they run at the same tag. Nothing is added before
    /// [`ReactionBuilder::run`].
    #[track_caller]
    pub fn reaction(&mut self) -> ReactionBuilder<'_, 'a, S> {
        ReactionBuilder::new(self)
    }

    // Modes.

    /// Adds the mode in which the reactor starts.
    #[track_caller]
    pub fn initial_mode(&mut self, name: &str) -> Mode {
        self.new_mode(name, true, Location::caller())
    }

    /// Adds a mode in which the reactor does not start.
    #[track_caller]
    pub fn mode(&mut self, name: &str) -> Mode {
        self.new_mode(name, false, Location::caller())
    }

    /// Puts timers, actions, reactions, reactors and connections into a mode: those that `assemble` adds.
    ///
    /// ```
    /// use std::time::Duration;
    ///
    /// use hprm::prelude::*;
    ///
    /// let mut program = Program::new("Modes").fast().timeout(Duration::from_millis(50));
    /// program.reactor("heater", Vec::new(), |heater| {
    ///     let off = heater.initial_mode("off");
    ///     let on = heater.mode("on");
    ///     for (here, there, name) in [(off, on, "off"), (on, off, "on")] {
    ///         heater.in_mode(here, |heater| {
    ///             let wait = heater.timer(&format!("{name}_for"), Duration::from_millis(20), Duration::ZERO);
    ///             heater.reaction().on(wait).enters(there.reset()).run(move |log: &mut Vec<_>, ctx| {
    ///                 log.push((ctx.elapsed().as_millis(), name));
    ///                 ctx.enter(there.reset());
    ///             });
    ///         });
    ///     }
    ///     heater.reaction().on(Shutdown).run(|log, _| assert_eq!(*log, [(20, "off"), (40, "on")]));
    /// });
    /// program.run()?;
    /// # Ok::<(), Failure>(())
    /// ```
    #[track_caller]
    pub fn in_mode<R>(&mut self, mode: Mode, assemble: impl FnOnce(&mut Self) -> R) -> R {
        let mode = self.own(mode.0, "put parts into", Location::caller());
        let outer = std::mem::replace(&mut self.mode, mode);
        let result = assemble(self);
        self.mode = outer;
        result
    }

    // Reactors inside, and connections.

    /// Adds a reactor inside this one. The reactors in one reactor have different names.
    #[track_caller]
    pub fn add<T: Reactor>(&mut self, name: &str, reactor: T) -> T::Ports {
        self.graph.declare_reactor(self.id, name, Location::caller());
        self.add_member(name, reactor)
    }

    fn add_member<T: Reactor>(&mut self, name: &str, mut reactor: T) -> T::Ports {
        let id = self.child(name);
        let ports = reactor.assemble(&mut ReactorBuilder::new(self.graph, id));
        self.graph.bodies.insert(id, Box::new(reactor));
        ports
    }

    /// Adds a bank: a reactor inside this one for each item, which are `name[0]` and so on.
    #[track_caller]
    pub fn bank<T: Reactor>(
        &mut self,
        name: &str,
        reactors: impl IntoIterator<Item = T>,
    ) -> Vec<T::Ports> {
        self.graph.declare_reactor(self.id, name, Location::caller());
        let reactors = reactors.into_iter().enumerate();
        let add = |(index, reactor)| self.add_member(&format!("{name}[{index}]"), reactor);
        reactors.map(add).collect()
    }

    /// Adds a reactor inside this one that is not worth a type: its state, and a closure that assembles it.
    #[track_caller]
    pub fn reactor<T: Send + 'static, R>(
        &mut self,
        name: &str,
        state: T,
        assemble: impl FnOnce(&mut ReactorBuilder<'_, T>) -> R,
    ) -> R {
        self.graph.declare_reactor(self.id, name, Location::caller());
        let id = self.child(name);
        self.graph.bodies.insert(id, Box::new(state));
        assemble(&mut ReactorBuilder::new(self.graph, id))
    }

    /// Connects two ports of this reactor, or of those inside it: a value appears at both ends at the same tag. The type
    /// of their values is the same, or the program does not compile:
    ///
    /// ```compile_fail,E0271
    /// # use hprm::prelude::*;
    /// fn mix(reactor: &mut ReactorBuilder<'_, ()>, from: OutputPort<u32>, to: InputPort<f64>) {
    ///     reactor.connect(from, to);
    /// }
    /// ```
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
        self.graph.connect(ports(from), ports(to), self.mode, Location::caller())
    }

    // Internals.

    fn child(&mut self, name: &str) -> ReactorId {
        let id = self.graph.parts.reactor(self.id, name);
        self.put_in_mode(ModalElement::Reactor(id));
        id
    }

    /// Notes that a port, an action, a timer or a mode has that name.
    fn declare(&mut self, name: &str, at: &'static Location<'static>) {
        self.graph.declare_part(self.id, name, at);
    }

    fn port(&mut self, name: &str, direction: Direction) -> Of<PortId> {
        let port = self.graph.parts.port(self.id, name, direction);
        self.graph.handle(port, self.id, name)
    }

    fn action(&mut self, name: &str, origin: Origin, min_delay: Duration) -> Of<ActionId> {
        let action = self.graph.parts.action(self.id, name, origin, nanoseconds(min_delay));
        self.put_in_mode(ModalElement::Action(action));
        self.graph.handle(action, self.id, name)
    }

    fn new_mode(&mut self, name: &str, initial: bool, at: &'static Location<'static>) -> Mode {
        self.declare(name, at);
        let mode = self.graph.parts.mode(self.id, name, initial);
        Mode(self.graph.handle(mode, self.id, name))
    }

    /// An action or a mode, if it belongs to this reactor; otherwise it is a mistake.
    fn own<I: Copy + Into<Part>>(
        &mut self,
        part: Of<I>,
        verb: &str,
        at: &Location<'_>,
    ) -> Option<I> {
        let id = self.id;
        let subject =
            |graph: &Graph| format!("reactor {} cannot {verb}", graph.parts.reactor_name(id));
        let own = self.graph.own(part, at, subject)?;
        let Named { name, reactor } = part.named()?;
        if reactor == id {
            return Some(own);
        }
        let kind = part.id.into().kind();
        let what =
            format!("{} {kind} {name}, which belongs to another reactor", subject(self.graph));
        self.graph.mistake(at, what, &format!("do that in the reactor that declares the {kind}"));
        None
    }

    pub(super) fn put_in_mode(&mut self, element: ModalElement) {
        if let Some(mode) = self.mode {
            self.graph.parts.put_in_mode(element, mode);
        }
    }
}
