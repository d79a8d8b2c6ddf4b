//! Handles: what names a port, an action, a timer or a mode. They are small and are copied into the reactions that use
//! them.
//!
//! A handle knows the type of its values, so the compiler refuses a connection between different types and a value of
//! the wrong type; and it knows its program (`identity.rs`). Names are for people and are nowhere looked up.

use std::fmt;
use std::marker::PhantomData;

use hprm_core::{ActionId, ModeId, PortId, TimerId, Transition, Trigger};

use super::identity::{GraphNumber, Of, Part};
use super::sender::Sent;
use super::value::{Message, Value};

/// An input port of a reactor, for values of the type `T`.
///
/// ```
/// use hprm::prelude::*;
///
/// let mut program = Program::new("Ports");
/// let out = program.reactor("source", (), |source| {
///     let out = source.output("out");
///     source.reaction().on(Startup).sets(out).run(move |(), ctx| ctx.set(out, 7));
///     out
/// });
/// let input: InputPort<i64> = program.reactor("sink", (), |sink| {
///     let input = sink.input("in");
///     sink.reaction().on(input).run(move |(), ctx| assert_eq!(ctx.get(input), Some(&7)));
///     input
/// });
/// program.connect(out, input);
/// # program.run().unwrap();
/// ```
pub struct InputPort<T>(pub(super) Of<PortId>, PhantomData<fn() -> T>);

/// An output port of a reactor, for values of the type `T`.
///
/// [`InputPort`] has an example.
pub struct OutputPort<T>(pub(super) Of<PortId>, PhantomData<fn() -> T>);

/// An action that is scheduled relative to the current tag, with values of the type `T`.
///
/// ```
/// use std::time::Duration;
///
/// use hprm::prelude::*;
///
/// let mut program = Program::new("Countdown").fast();
/// program.reactor("countdown", (), |reactor| {
///     let again: LogicalAction<u32> = reactor.logical_action("again", Duration::from_millis(10));
///     reactor.reaction().on(Startup).schedules(again).run(move |(), ctx| {
///         ctx.schedule(again, Duration::ZERO, 3);
///     });
///     reactor.reaction().on(again).schedules(again).run(move |(), ctx| match ctx.get(again) {
///         Some(&left) if left > 0 => ctx.schedule(again, Duration::ZERO, left - 1),
///         _ => assert_eq!(ctx.elapsed(), Duration::from_millis(40)),
///     });
/// });
/// # program.run().unwrap();
/// ```
pub struct LogicalAction<T>(pub(super) Of<ActionId>, PhantomData<fn() -> T>);

/// An action that is scheduled by the clock, also from other threads, with values of the type `T`.
///
/// [`Sender`](crate::Sender) has an example.
pub struct PhysicalAction<T>(pub(super) Of<ActionId>, PhantomData<fn() -> T>);

/// A timer of a reactor.
///
/// ```
/// use std::time::Duration;
///
/// use hprm::prelude::*;
///
/// let mut program = Program::new("Ticks").fast().timeout(Duration::from_millis(20));
/// program.reactor("ticks", 0, |ticks| {
///     let tick: Timer = ticks.timer("tick", Duration::ZERO, Duration::from_millis(10));
///     ticks.reaction().on(tick).run(|count, _| *count += 1);
///     ticks.reaction().on(Shutdown).run(|count, _| assert_eq!(*count, 3));
/// });
/// # program.run().unwrap();
/// ```
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Timer(pub(super) Of<TimerId>);

/// A mode of a reactor: a part of it that is active only while the reactor is in this mode.
///
/// ```
/// use std::time::Duration;
///
/// use hprm::prelude::*;
///
/// let mut program = Program::new("Lamp").fast();
/// program.reactor("lamp", (), |lamp| {
///     let (off, on) = (lamp.initial_mode("off"), lamp.mode("on"));
///     lamp.in_mode(off, |lamp| {
///         let begin = lamp.timer("begin", Duration::from_secs(1), Duration::ZERO);
///         lamp.reaction().on(begin).enters(on.reset()).run(move |(), ctx| ctx.enter(on.reset()));
///     });
///     lamp.in_mode(on, |lamp| {
///         lamp.reaction().on(Reset).run(|(), ctx| assert_eq!(ctx.elapsed().as_secs(), 1));
///     });
/// });
/// # program.run().unwrap();
/// ```
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Mode(pub(super) Of<ModeId>);

/// A way to enter a mode; see [`Mode::reset`] and [`Mode::history`].
///
/// [`Mode`] has an example.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Entry(pub(super) Of<ModeId>, pub(super) Transition);

/// Triggers a reaction when the program starts, or the mode of the reaction is entered for the first time.
///
/// [`InputPort`] has an example.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Startup;

/// Triggers a reaction at the last tag of the program.
///
/// [`Timer`] has an example.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Shutdown;

/// Triggers a reaction when its mode is entered by [`Mode::reset`].
///
/// [`Mode`] has an example.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Reset;

impl Mode {
    /// To enter the mode as if for the first time: its timers start again, and its suspended events are removed.
    #[must_use]
    pub fn reset(self) -> Entry {
        Entry(self.0, Transition::Reset)
    }

    /// To enter the mode as it was left: its suspended events wait for the rest of their time.
    #[must_use]
    pub fn history(self) -> Entry {
        Entry(self.0, Transition::History)
    }
}

/// What holds values: a port or an action.
///
/// ```
/// use hprm::prelude::*;
///
/// /// The value of a port or an action, or zero where it is absent.
/// fn number(ctx: &Context<'_>, of: impl Readable<Value = u32>) -> u32 {
///     ctx.get(of).copied().unwrap_or_default()
/// }
///
/// let mut program = Program::new("Reading");
/// let mut main = program.main();
/// let action = main.logical_action("action", std::time::Duration::ZERO);
/// let start = main.reaction().on(Startup).schedules(action);
/// start.run(move |(), ctx| ctx.schedule(action, std::time::Duration::ZERO, 7));
/// main.reaction().on(action).run(move |(), ctx| assert_eq!(number(ctx, action), 7));
/// # program.run().unwrap();
/// ```
pub trait Readable: Copy + Slotted {
    /// The type of its values.
    type Value: Message;

    #[doc(hidden)]
    fn read(value: &Value) -> Option<&Self::Value>;
}

/// An input or an output port.
///
/// ```
/// use hprm::prelude::*;
///
/// /// Sets a port at the start, whatever it holds.
/// fn begin<P>(reactor: &mut ReactorBuilder<'_, ()>, port: P, value: P::Value)
/// where
///     P: Port + Ports + Send + 'static,
///     P::Value: Clone,
/// {
///     reactor.reaction().on(Startup).sets(port).run(move |(), ctx| ctx.set(port, value.clone()));
/// }
///
/// let mut program = Program::new("Beginning");
/// program.reactor("a", (), |a| {
///     let (number, text) = (a.output::<u8>("number"), a.output::<String>("text"));
///     begin(a, number, 3);
///     begin(a, text, "three".to_owned());
/// });
/// # program.run().unwrap();
/// ```
pub trait Port: Readable {}

/// The ports that these handles name.
pub(super) fn ports<P: Port>(handles: impl IntoIterator<Item = P>) -> Vec<Of<PortId>> {
    handles.into_iter().filter_map(|handle| handle.slot().port()).collect()
}

/// A logical or a physical action. [`LogicalAction`] has an example.
pub trait Action: Readable {
    #[doc(hidden)]
    fn wrap(value: Self::Value) -> Value;
}

/// What can trigger a reaction: a timer, a port, an action, [`Startup`], [`Shutdown`], [`Reset`]; or an array, a slice
/// or a vector of those, of which any one triggers it.
///
/// ```
/// use std::time::Duration;
///
/// use hprm::prelude::*;
///
/// let mut program = Program::new("Triggers").fast().timeout(Duration::from_millis(20));
/// let mut main = program.main();
/// let timers = [10, 15].map(|ms| {
///     main.timer(&format!("every_{ms}_ms"), Duration::ZERO, Duration::from_millis(ms))
/// });
/// // At 0, 10, 15 and 20 ms.
/// main.reaction().on(timers).on(Shutdown).run(|(), ctx| println!("{:?}", ctx.elapsed()));
/// # program.run().unwrap();
/// ```
#[diagnostic::on_unimplemented(
    message = "`{Self}` does not trigger a reaction",
    note = "a timer, a port, an action, `Startup`, `Shutdown` and `Reset` do; several are an array or a vector of one \
            type, or several calls of `on`"
)]
pub trait Triggers {
    /// Calls `add` with each trigger, and with the program of a trigger that is part of one.
    #[doc(hidden)]
    fn each(&self, add: &mut dyn FnMut(Trigger, Option<GraphNumber>));
}

/// A port, or an array, a slice or a vector of ports. [`InputPort`] has an example.
#[diagnostic::on_unimplemented(
    message = "`{Self}` is not a port",
    note = "several ports are an array or a vector of one type, or several calls"
)]
pub trait Ports {
    #[doc(hidden)]
    fn each_port(&self, add: &mut dyn FnMut(Of<PortId>));
}

/// A port or an action, without the type of its values.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[doc(hidden)]
pub enum Slot {
    Port(PortId),
    Action(ActionId),
}

mod sealed {
    /// What only handles have.
    pub trait Slotted {
        fn slot(self) -> super::Of<super::Slot>;
    }
}

pub(super) use sealed::Slotted;

/// A slot of a program, or an entry of a mode, that can be compared at once.
pub(super) type Key = u64;

/// From the top: 29 bits for the program, 32 for the part, and three that say what it is.
#[inline]
fn key(graph: GraphNumber, part: u32, kind: Key) -> Key {
    Key::from(graph.get()) << 35 | Key::from(part) << 3 | kind
}

impl Of<Slot> {
    #[inline]
    pub(super) fn key(self) -> Key {
        match self.id {
            Slot::Port(port) => key(self.graph, port.0, 0),
            Slot::Action(action) => key(self.graph, action.0, 1),
        }
    }

    pub(super) fn port(self) -> Option<Of<PortId>> {
        match self.id {
            Slot::Port(port) => Some(Of { id: port, graph: self.graph }),
            Slot::Action(_) => None,
        }
    }

    pub(super) fn action(self) -> Option<Of<ActionId>> {
        match self.id {
            Slot::Port(_) => None,
            Slot::Action(action) => Some(Of { id: action, graph: self.graph }),
        }
    }
}

impl From<Slot> for Part {
    fn from(slot: Slot) -> Self {
        match slot {
            Slot::Port(port) => port.into(),
            Slot::Action(action) => action.into(),
        }
    }
}

impl Entry {
    pub(super) fn key(self) -> Key {
        let Self(mode, transition) = self;
        let way = match transition {
            Transition::Reset => 2,
            Transition::History => 3,
        };
        key(mode.graph, mode.id.0, way)
    }
}

macro_rules! slots {
    ($($name:ident($id:ident) = $kind:ident;)*) => {$(
        impl<T> $name<T> {
            pub(super) fn new(id: Of<$id>) -> Self {
                Self(id, PhantomData)
            }
        }

        impl<T> Clone for $name<T> {
            fn clone(&self) -> Self {
                *self
            }
        }

        impl<T> Copy for $name<T> {}

        impl<T> PartialEq for $name<T> {
            fn eq(&self, other: &Self) -> bool {
                self.0 == other.0
            }
        }

        impl<T> Eq for $name<T> {}

        impl<T> fmt::Debug for $name<T> {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, concat!(stringify!($name), "({})"), self.0.id.0)
            }
        }

        impl<T: Message> Slotted for $name<T> {
            #[inline]
            fn slot(self) -> Of<Slot> {
                Of { id: Slot::$kind(self.0.id), graph: self.0.graph }
            }
        }

        impl<T: Message> Triggers for $name<T> {
            fn each(&self, add: &mut dyn FnMut(Trigger, Option<GraphNumber>)) {
                add(Trigger::$kind(self.0.id), Some(self.0.graph));
            }
        }
    )*};
}

slots! {
    InputPort(PortId) = Port;
    OutputPort(PortId) = Port;
    LogicalAction(ActionId) = Action;
    PhysicalAction(ActionId) = Action;
}

macro_rules! plain_values {
    ($($name:ident)*) => {$(
        impl<T: Message> Readable for $name<T> {
            type Value = T;

            #[inline]
            fn read(value: &Value) -> Option<&T> {
                value.get()
            }
        }
    )*};
}

plain_values! { InputPort OutputPort LogicalAction }

impl<T: Message> Readable for PhysicalAction<T> {
    type Value = T;

    fn read(value: &Value) -> Option<&T> {
        value.get::<Sent<T>>().map(Sent::value)
    }
}

impl<T: Message> Action for LogicalAction<T> {
    #[inline]
    fn wrap(value: T) -> Value {
        Value::new(value)
    }
}

impl<T: Message> Action for PhysicalAction<T> {
    fn wrap(value: T) -> Value {
        Value::new(Sent::by_reaction(value))
    }
}

macro_rules! ports {
    ($($name:ident)*) => {$(
        impl<T: Message> Port for $name<T> {}

        impl<T: Message> Ports for $name<T> {
            fn each_port(&self, add: &mut dyn FnMut(Of<PortId>)) {
                add(self.0);
            }
        }
    )*};
}

ports! { InputPort OutputPort }

impl Triggers for Timer {
    fn each(&self, add: &mut dyn FnMut(Trigger, Option<GraphNumber>)) {
        add(Trigger::Timer(self.0.id), Some(self.0.graph));
    }
}

macro_rules! triggers {
    ($($name:ident)*) => {$(
        impl Triggers for $name {
            fn each(&self, add: &mut dyn FnMut(Trigger, Option<GraphNumber>)) {
                add(Trigger::$name, None);
            }
        }
    )*};
}

triggers! { Startup Shutdown Reset }

macro_rules! several {
    ($([$($generics:tt)*] $several:ty;)*) => {$(
        impl<H: Triggers, $($generics)*> Triggers for $several {
            fn each(&self, add: &mut dyn FnMut(Trigger, Option<GraphNumber>)) {
                self.iter().for_each(|one| one.each(add));
            }
        }

        impl<H: Ports, $($generics)*> Ports for $several {
            fn each_port(&self, add: &mut dyn FnMut(Of<PortId>)) {
                self.iter().for_each(|one| one.each_port(add));
            }
        }
    )*};
}

several! {
    [] &[H];
    [] Vec<H>;
    [] &Vec<H>;
    [const N: usize] [H; N];
    [const N: usize] &[H; N];
}
