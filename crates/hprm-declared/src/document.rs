//! The form of the JSON. Times are nanoseconds; indices count from 0.
//!
//! What is not known here is refused, so that nothing is left out silently.

use hprm_model::Given;
use serde::Deserialize;

/// A program.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Document {
    /// The first one is that of the main reactor.
    pub(crate) files: Vec<File>,
    #[serde(default)]
    pub(crate) properties: Vec<Property>,
    /// Index of the main reactor.
    pub(crate) main: usize,
    pub(crate) reactors: Vec<Reactor>,
    /// Code that federates compare: subject and text.
    #[serde(default)]
    pub(crate) modules: Vec<(String, String)>,
    /// Of an executable, the parameters that it has: names, and types as people know them.
    #[serde(default)]
    pub(crate) parameters: Vec<(String, String)>,
    /// Of an executable, what it is; its reactions may name single members of banks, and single channels.
    pub(crate) executable: Option<Executable>,
    /// Of an executable, why it does not take the parameters that it was given; it declares nothing else then.
    pub(crate) refused: Option<Refusal>,
}

/// What an executable is.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Executable {
    /// A federate of a program that names it.
    Federate,
    /// A program of several processes.
    Federation,
    /// A program that it runs by itself, in one process.
    Program,
}

/// Why an executable does not take its parameters.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Refusal {
    /// It needs this one.
    Missing(String),
    /// It does not have this one.
    Unknown(String),
    /// The value of this one does not fit, or all together do not: why.
    Wrong(Option<String>, String),
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct File {
    pub(crate) path: String,
    /// Empty if it is not known.
    pub(crate) text: String,
}

/// A place: file, line from 1, column and end column in bytes from 0; -1 is the end of the line.
pub(crate) type At = (usize, u32, u32, i64);

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Property {
    pub(crate) name: String,
    pub(crate) at: At,
    pub(crate) value: Value,
}

/// The value of a target property.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
pub(crate) enum Value {
    Bool(bool),
    Integer(i64),
    Named(NamedValue),
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum NamedValue {
    Time(i64),
    /// What `.lf` states without quotes.
    Word(String),
    Text(String),
    List(Vec<Value>),
    Dictionary(Vec<Property>),
}

/// What one reactor instance declares, or several that are equal.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Reactor {
    pub(crate) name: String,
    pub(crate) at: At,
    #[serde(default)]
    pub(crate) federated: bool,
    /// The path of the executable that declares the rest, and the arguments that it gets.
    #[serde(default)]
    pub(crate) executable: Vec<String>,
    /// The names and the values of the parameters of an executable.
    #[serde(default)]
    pub(crate) parameters: Vec<(String, Given)>,
    #[serde(default)]
    pub(crate) ports: Vec<Port>,
    #[serde(default)]
    pub(crate) timers: Vec<Timer>,
    #[serde(default)]
    pub(crate) actions: Vec<Action>,
    #[serde(default)]
    pub(crate) modes: Vec<Mode>,
    #[serde(default)]
    pub(crate) children: Vec<Child>,
    #[serde(default)]
    pub(crate) connections: Vec<Connection>,
    #[serde(default)]
    pub(crate) reactions: Vec<Reaction>,
    /// What federates compare of each instance: subject and text.
    #[serde(default)]
    pub(crate) facts: Vec<(String, String)>,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum PortKind {
    Input,
    Output,
    Mutable,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Port {
    pub(crate) name: String,
    pub(crate) at: At,
    pub(crate) kind: PortKind,
    /// Of a multiport.
    pub(crate) width: Option<i64>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Timer {
    pub(crate) name: String,
    pub(crate) at: At,
    #[serde(default)]
    pub(crate) offset: i64,
    pub(crate) period: Option<i64>,
    pub(crate) mode: Option<usize>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Action {
    pub(crate) name: String,
    pub(crate) at: At,
    pub(crate) physical: bool,
    #[serde(default)]
    pub(crate) min_delay: i64,
    pub(crate) spacing: Option<i64>,
    pub(crate) policy: Option<String>,
    pub(crate) mode: Option<usize>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Mode {
    pub(crate) name: String,
    pub(crate) at: At,
    #[serde(default)]
    pub(crate) initial: bool,
}

/// A contained instance, or a bank of them.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Child {
    pub(crate) name: String,
    pub(crate) at: At,
    /// Indices of reactors.
    pub(crate) members: Vec<usize>,
    #[serde(default)]
    pub(crate) bank: bool,
    pub(crate) mode: Option<usize>,
    pub(crate) host: Option<String>,
    pub(crate) maxwait: Option<i64>,
    #[serde(default)]
    pub(crate) transient: bool,
    /// When it is started again.
    pub(crate) restart: Option<Restart>,
}

/// When a federate is started again, with times in nanoseconds. What is not stated is as the model has it.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Restart {
    pub(crate) condition: String,
    pub(crate) sec: Option<i64>,
    pub(crate) burst: Option<i64>,
    pub(crate) interval: Option<i64>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Connection {
    pub(crate) at: At,
    pub(crate) from: Vec<Reference>,
    pub(crate) to: Vec<Reference>,
    /// Whether the left side is repeated.
    #[serde(default)]
    pub(crate) repeated: bool,
    pub(crate) after: Option<i64>,
    #[serde(default)]
    pub(crate) physical: bool,
    pub(crate) serializer: Option<String>,
    pub(crate) absent_after: Option<i64>,
    #[serde(default)]
    pub(crate) compress: bool,
    /// How many messages may wait, and what becomes of more.
    pub(crate) bound: Option<(i64, String)>,
    pub(crate) mode: Option<usize>,
}

/// A port, an action or a timer of the reactor itself, or a port of a child.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Reference {
    pub(crate) at: At,
    pub(crate) child: Option<String>,
    /// One member of a bank.
    pub(crate) member: Option<u32>,
    pub(crate) name: String,
    /// One channel of a multiport.
    pub(crate) channel: Option<u32>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Reaction {
    pub(crate) name: String,
    pub(crate) at: At,
    #[serde(default)]
    pub(crate) triggers: Vec<Trigger>,
    #[serde(default)]
    pub(crate) sources: Vec<Reference>,
    #[serde(default)]
    pub(crate) effects: Vec<Effect>,
    pub(crate) deadline: Option<i64>,
    /// Whether it handles tardy inputs.
    #[serde(default)]
    pub(crate) tardy: bool,
    pub(crate) mode: Option<usize>,
}

#[derive(Debug, Deserialize)]
#[serde(untagged)]
pub(crate) enum Trigger {
    Event(Event),
    Variable(Reference),
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Event {
    Startup,
    Shutdown,
    Reset,
}

#[derive(Debug, Deserialize)]
#[serde(untagged)]
pub(crate) enum Effect {
    Mode(Transition),
    Variable(Reference),
}

/// A mode that a reaction enters.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Transition {
    pub(crate) at: At,
    pub(crate) mode: usize,
    #[serde(default)]
    pub(crate) history: bool,
}
