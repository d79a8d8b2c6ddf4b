//! A program as people draw it: its reactors with what they declare and how they are connected.
//!
//! In the [`Program`](hprm_core::Program) every member of a bank and every channel of a multiport is a part of its
//! own; here a bank is one reactor with a width, and a port is one port. Attributes that only diagrams obey are here,
//! and nowhere else. There is an outline also of a program that the builder refuses, such as one with a causality loop.

use hprm_core::{Coordination, Direction, Nanos, Transition};

/// The reactors of a program.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Outline {
    /// The main reactor first, a container before its contents.
    pub reactors: Vec<Reactor>,
    /// Of a federated program, how its federates advance.
    pub coordination: Option<Coordination>,
    /// The host of the RTI (`at`).
    pub rti_host: Option<String>,
    /// The reactions that wait for one another in a cycle: the index of the reactor, and that of the reaction in it.
    pub cycle: Vec<(usize, usize)>,
}

/// A reactor, or a bank of them, which is drawn as its first member.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct Reactor {
    /// The name of the instance; of the main reactor, that of the program.
    pub name: String,
    /// The name of its class.
    pub class: String,
    /// The reactor that contains it, by index.
    pub parent: Option<usize>,
    /// The width of a bank.
    pub width: Option<u32>,
    /// The mode of its container that it is declared in, by index.
    pub mode: Option<usize>,
    /// How it is drawn.
    pub drawing: Drawing,
    /// What it is as a federate.
    pub federate: Option<Federate>,
    /// Its modes.
    pub modes: Vec<Mode>,
    /// Its ports.
    pub ports: Vec<Port>,
    /// Its timers.
    pub timers: Vec<Timer>,
    /// Its actions.
    pub actions: Vec<Action>,
    /// Its reactions.
    pub reactions: Vec<Reaction>,
    /// The reactors that it contains, by index.
    pub children: Vec<usize>,
    /// The connections between what it contains, and its own ports.
    pub connections: Vec<Connection>,
}

/// The attributes that say how something is drawn.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct Drawing {
    /// `@label`.
    pub label: Option<String>,
    /// `@icon`.
    pub icon: Option<String>,
    /// `@side`, in lower case.
    pub side: Option<String>,
    /// `@layout`: options and their values.
    pub layout: Vec<(String, String)>,
}

/// A federate, or a bank of them.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Federate {
    /// How long it waits for inputs, if the program says so; [`Nanos::MAX`] waits for ever.
    pub maxwait: Option<Nanos>,
    /// Where it runs (`at`).
    pub host: Option<String>,
    /// Whether it may join and leave.
    pub transient: bool,
    /// Whether it is an executable.
    pub executable: bool,
}

/// A mode.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Mode {
    /// Its name.
    pub name: String,
    /// Whether the reactor starts in it.
    pub initial: bool,
}

/// A port, or a multiport.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Port {
    /// Its name.
    pub name: String,
    /// Input or output.
    pub direction: Direction,
    /// The width of a multiport.
    pub width: Option<u32>,
    /// How it is drawn.
    pub drawing: Drawing,
}

/// A timer.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Timer {
    /// Its name.
    pub name: String,
    /// The time of its first event.
    pub offset: Nanos,
    /// The time between two events; zero if there is one event.
    pub period: Nanos,
    /// The mode that it is declared in, by index.
    pub mode: Option<usize>,
    /// How it is drawn.
    pub drawing: Drawing,
}

/// An action.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Action {
    /// Its name.
    pub name: String,
    /// Whether its events get the physical time.
    pub physical: bool,
    /// What is added to every delay.
    pub min_delay: Nanos,
    /// The mode that it is declared in, by index.
    pub mode: Option<usize>,
    /// How it is drawn.
    pub drawing: Drawing,
}

/// A reaction.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Reaction {
    /// Its name, if it has one.
    pub name: Option<String>,
    /// The mode that it is declared in, by index.
    pub mode: Option<usize>,
    /// What makes it run.
    pub triggers: Vec<Trigger>,
    /// What else it reads.
    pub sources: Vec<End>,
    /// What it may do.
    pub effects: Vec<Effect>,
    /// How late it may begin.
    pub deadline: Option<Nanos>,
    /// How it is drawn.
    pub drawing: Drawing,
}

/// What makes a reaction run.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Trigger {
    /// The start of the program.
    Startup,
    /// Its end.
    Shutdown,
    /// The entry of the mode by a transition that resets it.
    Reset,
    /// A timer, by index.
    Timer(usize),
    /// An action, by index.
    Action(usize),
    /// A port.
    Port(End),
}

/// What a reaction may do.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Effect {
    /// Schedule an action, by index.
    Action(usize),
    /// Enter a mode, by index.
    Mode(usize, Transition),
    /// Set a port.
    Port(End),
}

/// A port of the reactor itself, or of one that it contains.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub struct End {
    /// The reactor, by index.
    pub reactor: usize,
    /// Its port, by index.
    pub port: usize,
}

/// A connection; one for each pair of ports that share a channel.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Connection {
    /// Where it comes from.
    pub from: End,
    /// Where it leads.
    pub to: End,
    /// Whether messages get the physical time (`~>`).
    pub physical: bool,
    /// What `after` adds.
    pub delay: Option<Nanos>,
    /// How long the receiver waits for it, if the program says so.
    pub absent_after: Option<Nanos>,
    /// The mode that it is declared in, by index.
    pub mode: Option<usize>,
    /// How it is drawn.
    pub drawing: Drawing,
}
