//! The checked, flat instance graph of a program.
//!
//! A `Program` is built once, by [`ProgramBuilder`](crate::ProgramBuilder), which is the only
//! place that validates; code that has one may rely on its ids and levels. It is the same in every
//! federate: a federate runs the part of the program that is in its own reactor. It has no bodies, no
//! source text and nothing of Python.

use alloc::borrow::Cow;
use alloc::boxed::Box;
use alloc::format;
use alloc::string::String;
use alloc::vec::Vec;
use core::hash::{Hash, Hasher};
use serde::{Deserialize, Serialize};

use crate::{
    ActionId, Bound, ClockSyncOptions, ConnectionId, Delay, FederateId, Mode, ModeId, Nanos,
    PortId, ReactionId, ReactorId, Restart, Spacing, Table, TimerId, Transition,
};

/// The name of a federate, however users write it: `camera[1]`, a member of a bank, is `camera__1`.
#[must_use]
pub fn federate_name(text: &str) -> Cow<'_, str> {
    match text.strip_suffix(']').and_then(|text| text.split_once('[')) {
        Some((bank, index)) => format!("{bank}__{index}").into(),
        None => text.into(),
    }
}

/// Whether users mean a federate of that `name` by a text, which may be the name of its bank.
#[must_use]
pub fn means_federate(text: &str, name: &str) -> bool {
    let text = federate_name(text);
    let index = name.strip_prefix(&*text).and_then(|rest| rest.strip_prefix("__"));
    name == text || index.is_some_and(|index| index.parse::<usize>().is_ok())
}

/// How federates agree on when a tag is safe to process.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Default, Serialize, Deserialize)]
pub enum Coordination {
    /// The RTI grants every advance (paper, section III-A).
    #[default]
    Centralized,
    /// Each federate waits by its own clock (paper, section III-B).
    Decentralized,
}

/// How long a process busy-polls, before it lets the kernel put it to sleep.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Default, Serialize, Deserialize)]
pub enum Spin {
    /// For a short time, and only if every process of the federation has a processor of its own.
    #[default]
    Auto,
    /// For that many nanoseconds; zero is never.
    For(Nanos),
}

/// The target properties that the runtime obeys.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Default, Serialize, Deserialize)]
pub struct Properties {
    /// Stop at this time after the start.
    pub timeout: Option<Nanos>,
    /// Start at a physical time that is a multiple of this one, if it is not zero.
    pub start_time_multiple: Nanos,
    /// Do not wait for physical time.
    pub fast: bool,
    /// Do not stop when nothing is left to do. A federate alone never stops for that: it does not know
    /// what others may send.
    pub keepalive: bool,
    /// Of reactions that do not depend on one another, run those first that lead to a tighter deadline.
    pub deadlines_first: bool,
    /// How many reactions that do not depend on one another may run at the same time, each in a
    /// thread. Zero is as many as there are processors; the default is one.
    pub workers: Option<u32>,
    /// How the federates of a federation are coordinated.
    pub coordination: Coordination,
    /// Whether federates and the RTI busy-poll before they sleep.
    pub spin: Spin,
    /// The real-time priority of the processes that run the program, from 1 to 99, if they have one.
    pub realtime: Option<u8>,
    /// The processors of the federates: the first one of the first, and so on, from the start again if
    /// there are more federates. If empty, the system chooses.
    pub cpus: Vec<u32>,
    /// Whether centralized federates report every next event tag, even if no other federate needs it.
    pub reports_all: bool,
    /// How the federates' clocks are compared.
    pub clock_sync: ClockSyncOptions,
}

/// A reactor instance.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub struct Reactor {
    /// Full name from the main reactor down, with bank indices: `Main.bank[2].child`.
    pub name: String,
    /// The reactor that contains it; none for the main reactor.
    pub parent: Option<ReactorId>,
    /// The mode of `parent` in which it is declared, if any.
    pub mode: Option<ModeId>,
    /// The federate that it belongs to; none for the main reactor and in unfederated programs.
    pub federate: Option<FederateId>,
}

/// Whether a port is an input or an output.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub enum Direction {
    /// An input of its reactor.
    Input,
    /// An output of its reactor.
    Output,
}

/// One channel of a port.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub struct Port {
    /// Name within its reactor, with the channel of a multiport: `out` or `out[2]`.
    pub name: String,
    /// The reactor whose port it is.
    pub reactor: ReactorId,
    /// Input or output.
    pub direction: Direction,
}

/// Where an action's events come from.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub enum Origin {
    /// Scheduled relative to the current tag.
    Logical,
    /// Scheduled relative to the physical clock, from any thread.
    Physical,
}

/// A logical or physical action.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub struct Action {
    /// Name within its reactor.
    pub name: String,
    /// The reactor whose action it is.
    pub reactor: ReactorId,
    /// Logical or physical.
    pub origin: Origin,
    /// Added to every delay with which it is scheduled.
    pub min_delay: Nanos,
    /// How close its events may be; without one, events for the same tag get later microsteps.
    pub spacing: Option<Spacing>,
    /// The mode of its reactor that it is declared in.
    pub mode: Option<ModeId>,
}

/// A timer.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub struct Timer {
    /// Name within its reactor.
    pub name: String,
    /// The reactor whose timer it is.
    pub reactor: ReactorId,
    /// Time of the first event after the start.
    pub offset: Nanos,
    /// Time from one event to the next; zero for a single event.
    pub period: Nanos,
    /// The mode of its reactor that it is declared in.
    pub mode: Option<ModeId>,
}

/// What makes a reaction run.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug, Serialize, Deserialize)]
pub enum Trigger {
    /// The start of the program.
    Startup,
    /// The end of the program.
    Shutdown,
    /// The entry of the enclosing mode by a transition that resets it.
    Reset,
    /// An event of a timer.
    Timer(TimerId),
    /// An event of an action.
    Action(ActionId),
    /// A message at a port.
    Port(PortId),
}

/// What a reaction may do.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug, Serialize, Deserialize)]
pub enum Effect {
    /// Set a port: an own output or a contained reactor's input.
    Port(PortId),
    /// Schedule an action.
    Action(ActionId),
    /// Make the reactor change its mode.
    Mode(ModeId, Transition),
}

/// A reaction of one reactor instance.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub struct Reaction {
    /// The reactor whose reaction it is.
    pub reactor: ReactorId,
    /// Position among the reactor's reactions, from 1; zero for those that the front end adds.
    pub number: u32,
    /// What users call it, if the program names it: a method. Only messages depend on it.
    pub label: Option<Box<str>>,
    /// What makes it run.
    pub triggers: Vec<Trigger>,
    /// Ports that it reads without being triggered by them.
    pub sources: Vec<PortId>,
    /// What it may do.
    pub effects: Vec<Effect>,
    /// The lag of physical behind logical time beyond which its deadline handler runs instead.
    pub deadline: Option<Nanos>,
    /// Whether it declares what to do when an input is tardy (`STP`, `STAA` or `tardy`).
    pub handles_tardy: bool,
    /// The mode of its reactor that it is declared in.
    pub mode: Option<ModeId>,
    /// Length of the longest chain of reactions that must run before it at the same tag.
    pub level: u32,
    /// The tightest deadline among it and all reactions that it precedes; [`Nanos::MAX`] if none
    /// has any.
    pub inferred_deadline: Nanos,
}

/// A connection from one channel to another.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub struct Connection {
    /// The channel that is read: an output of a contained reactor or an input of the container.
    pub from: PortId,
    /// The channel that is set.
    pub to: PortId,
    /// What `after` adds to the tag.
    pub delay: Delay,
    /// `~>`: the message gets the physical time at which it arrives.
    pub physical: bool,
    /// The Python package that serializes its values, if not the native one.
    pub serializer: Option<String>,
    /// How much longer than `maxwait` a decentralized receiver waits for this input.
    pub absent_after: Nanos,
    /// Whether agents compress its large values on their way to another machine.
    pub compress: bool,
    /// How many of its messages may wait, if it is physical; none if any number may.
    pub bound: Option<Bound>,
    /// The mode that it is declared in.
    pub mode: Option<ModeId>,
}

impl Connection {
    /// Whether a value appears at both ends at the same tag.
    #[must_use]
    pub fn is_direct(&self) -> bool {
        self.delay == Delay::None && !self.physical
    }
}

/// A federate: a top-level reactor of a federated program.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub struct Federate {
    /// The name of its instance, with the index in a bank: `client__2`.
    pub name: String,
    /// Its reactor.
    pub reactor: ReactorId,
    /// How long it waits for inputs under decentralized coordination (`@maxwait`, `STP_offset`).
    /// [`Nanos::MAX`] waits for ever.
    pub maxwait: Nanos,
    /// The host that the program names for it (`at`).
    pub host: Option<String>,
    /// Whether it may join a federation that runs, leave it, and join again (`@transient`).
    pub transient: bool,
    /// When it is started again, if it is transient (`@restart`).
    pub restart: Option<Restart>,
}

/// A connection between two federates, on which messages are sent.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub struct Channel {
    /// The connection that it carries.
    pub connection: ConnectionId,
    /// The sender.
    pub from: FederateId,
    /// The receiver.
    pub to: FederateId,
    /// What is added to the sender's tag.
    pub delay: Delay,
    /// Whether the receiver tags it with its physical time.
    pub physical: bool,
    /// The highest level of a reaction that writes into it.
    pub last_writer: u32,
    /// The lowest level of a reaction that reads from it.
    pub first_reader: u32,
}

impl Channel {
    /// Whether a value appears at both ends at the same tag.
    #[must_use]
    pub fn is_direct(&self) -> bool {
        self.delay == Delay::None && !self.physical
    }
}

/// A checked program.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct Program {
    /// The name of the main reactor.
    pub name: String,
    /// Target properties.
    pub properties: Properties,
    /// Reactor instances; the first is the main reactor.
    pub reactors: Table<ReactorId, Reactor>,
    /// Channels of ports.
    pub ports: Table<PortId, Port>,
    /// Actions.
    pub actions: Table<ActionId, Action>,
    /// Timers.
    pub timers: Table<TimerId, Timer>,
    /// Reactions: a reactor's own in their order, a container's before its contents'.
    pub reactions: Table<ReactionId, Reaction>,
    /// Modes: a reactor's own in their order, a container's before its contents'.
    pub modes: Table<ModeId, Mode>,
    /// Connections.
    pub connections: Table<ConnectionId, Connection>,
    /// Federates; empty for an unfederated program.
    pub federates: Table<FederateId, Federate>,
    /// Connections between federates that a reaction reads.
    pub channels: Table<crate::ChannelId, Channel>,
}

/// A program never changes while it runs: states of schedulers are told apart without the rest of it.
impl Hash for Program {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.name.hash(state);
    }
}

impl Program {
    /// Whether its top-level reactors are federates.
    #[must_use]
    pub fn is_federated(&self) -> bool {
        !self.federates.is_empty()
    }

    /// The federate of that name.
    #[must_use]
    pub fn federate_named(&self, name: &str) -> Option<FederateId> {
        self.federates.iter().find(|(_, federate)| federate.name == name).map(|(id, _)| id)
    }

    /// The federates that users mean by a text: one by its name, or all members of a bank by that of the bank.
    pub fn federates_meant(&self, text: &str) -> impl Iterator<Item = FederateId> {
        let meant = self.federates.iter().filter(move |(_, it)| means_federate(text, &it.name));
        meant.map(|(id, _)| id)
    }

    /// Whether the two ends of a connection lie in different federates.
    #[must_use]
    pub fn crosses_federates(&self, connection: &Connection) -> bool {
        let federate = |port: PortId| self.reactors[self.ports[port].reactor].federate;
        federate(connection.from) != federate(connection.to)
    }

    /// The ports that a reaction may set.
    pub(crate) fn written_ports(&self, reaction: ReactionId) -> impl Iterator<Item = PortId> {
        self.reactions[reaction].effects.iter().filter_map(|effect| match effect {
            Effect::Port(port) => Some(*port),
            Effect::Action(_) | Effect::Mode(..) => None,
        })
    }

    /// The ports that a reaction reads, whether or not they trigger it.
    pub(crate) fn read_ports(&self, reaction: ReactionId) -> impl Iterator<Item = PortId> {
        let reaction = &self.reactions[reaction];
        let triggers = reaction.triggers.iter().filter_map(|trigger| match trigger {
            Trigger::Port(port) => Some(*port),
            _ => None,
        });
        triggers.chain(reaction.sources.iter().copied())
    }

    /// `Main.bank[2].child.out[1]`.
    #[must_use]
    pub fn port_name(&self, port: PortId) -> String {
        let Port { name, reactor, .. } = &self.ports[port];
        format!("{}.{name}", self.reactors[*reactor].name)
    }

    /// `Main.bank[2].child.3`: by its number, which every reaction has.
    #[must_use]
    pub fn reaction_name(&self, reaction: ReactionId) -> String {
        let Reaction { reactor, number, .. } = &self.reactions[reaction];
        format!("{}.{number}", self.reactors[*reactor].name)
    }

    /// What messages call a reaction: `Main.bank[2].child.detect` if the program names it so, or else by its number.
    #[must_use]
    pub fn reaction_label(&self, reaction: ReactionId) -> String {
        let Reaction { reactor, label, .. } = &self.reactions[reaction];
        match label {
            Some(label) => format!("{}.{label}", self.reactors[*reactor].name),
            None => self.reaction_name(reaction),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_member_of_a_bank_is_meant_by_its_index_and_by_its_bank() {
        let texts = ["sink", "sink[1]", "sink__1", "sink[0]", "sin", "sink__", "sink[]", "sink[1"];
        let meant = texts.map(|text| means_federate(text, "sink__1"));
        assert_eq!(meant, [true, true, true, false, false, false, false, false]);
        assert!(means_federate("camera", "camera"));
        assert!(!means_federate("sink", "sink__x"));
        assert_eq!(["camera", "sink[1]"].map(federate_name), ["camera", "sink__1"]);
    }
}
