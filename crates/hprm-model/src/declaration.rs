//! What a program declares: reactors with their members, as written, nothing resolved.
//!
//! A front end makes these values, from text or from whatever else a program is written in, and adds
//! them to a [`Library`](crate::Library). Names, references and values have a [`Span`] of a source, which
//! diagnostics show; what has no place of its own gets the place of what declares it.
//!
//! Parts of the language that are not supported yet are here too, so that they can be reported with
//! their place. Nothing here is checked; [`compile()`](crate::compile()) does that.

use hprm_core::{Nanos, Transition};

use crate::given::Given;
use crate::library::ClassId;
use crate::source::Span;

/// A name and its place. It is an identifier of at most 255 characters: the front end sees to that.
#[derive(Clone, PartialEq, Debug)]
pub struct Name {
    /// The name.
    pub text: String,
    /// Its place.
    pub span: Span,
}

impl Name {
    /// The name `text` at `span`.
    pub fn new(text: impl Into<String>, span: Span) -> Self {
        Self { text: text.into(), span }
    }
}

/// What a reaction, one of its handlers, or a method runs.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Body {
    /// Python, which is text of a source: what is between `{=` and `=}`.
    Text(Span),
    /// A function that the front end has and gives to the host itself. It is known by its class and
    /// its number among the reactions or methods of the class.
    Bound,
    /// What an executable has itself. Only such a reaction may name single members of banks and single channels.
    OfExecutable,
}

impl Body {
    /// The place of the text, if there is one.
    pub(crate) fn text(self) -> Option<Span> {
        match self {
            Self::Text(span) => Some(span),
            Self::Bound | Self::OfExecutable => None,
        }
    }
}

/// A target property, or an entry of a dictionary.
#[derive(Clone, PartialEq, Debug)]
pub struct Property {
    /// Its name.
    pub name: Name,
    /// Its value.
    pub value: Element,
}

/// The value of a target property.
#[derive(Clone, PartialEq, Debug)]
pub struct Element {
    /// What it is.
    pub kind: ElementKind,
    /// Its place.
    pub span: Span,
}

/// The kinds of an [`Element`].
#[derive(Clone, PartialEq, Debug)]
pub enum ElementKind {
    /// `{ name: value, ... }`.
    Dictionary(Vec<Property>),
    /// `[value, ...]`.
    List(Vec<Element>),
    /// A literal.
    Value(Expression),
    /// A word or a path without quotes.
    Path(String),
}

/// What a reactor is in its program.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum ReactorKind {
    /// One that others instantiate, extend and import.
    Plain,
    /// The main reactor of a program in one process.
    Main,
    /// The main reactor of a federation.
    Federated,
}

/// A reactor class.
#[derive(Clone, PartialEq, Debug)]
pub struct ReactorNode {
    /// What stands before it with an `@`.
    pub attributes: Vec<Attribute>,
    /// Plain, main or federated.
    pub kind: ReactorKind,
    /// Its name; a main reactor may have none, and is called as its file is.
    pub name: Option<Name>,
    /// `<T, U>`.
    pub type_parameters: Option<Span>,
    /// Its parameters.
    pub parameters: Vec<Parameter>,
    /// The host of a federated reactor (`at`), where the RTI runs.
    pub host: Option<Name>,
    /// The classes that it inherits from, as they are called in its file.
    pub extends: Vec<Name>,
    /// Its members, in their order.
    pub members: Vec<Member>,
    /// From the first keyword to the last token before the brace. In its file, the members of the class
    /// come after the start of this, and before that of the next class.
    pub header: Span,
}

impl ReactorNode {
    /// A reactor without members.
    #[must_use]
    pub fn new(kind: ReactorKind, name: Option<Name>, header: Span) -> Self {
        Self {
            attributes: Vec::new(),
            kind,
            name,
            type_parameters: None,
            parameters: Vec::new(),
            host: None,
            extends: Vec::new(),
            members: Vec::new(),
            header,
        }
    }
}

/// A parameter of a reactor.
#[derive(Clone, PartialEq, Debug)]
pub struct Parameter {
    /// What stands before it with an `@`.
    pub attributes: Vec<Attribute>,
    /// Its name.
    pub name: Name,
    /// Its type, which the Python target does not have.
    pub ty: Option<Span>,
    /// Its value where an instance is made without one.
    pub default: Option<Expression>,
    /// Its value in all instances, if the front end knows instances; there is no default then.
    pub given: Option<Given>,
}

/// A member of a reactor, or of one of its modes.
#[derive(Clone, PartialEq, Debug)]
pub enum Member {
    /// Python that becomes part of the class body.
    Preamble(Span),
    /// A state variable.
    State(StateNode),
    /// A method.
    Method(MethodNode),
    /// An input or output port.
    Port(PortNode),
    /// A timer.
    Timer(TimerNode),
    /// An action.
    Action(ActionNode),
    /// A watchdog, which is not supported yet.
    Watchdog(Watchdog),
    /// An instance of another reactor, or a bank of them.
    Instantiation(Instantiation),
    /// A connection.
    Connection(ConnectionNode),
    /// A reaction.
    Reaction(ReactionNode),
    /// A mode, with members of its own.
    Mode(ModeNode),
    /// A member of a mode that is declared elsewhere in this class: the number of the mode among those of
    /// the class. So the order of reactions need not be that of the modes which they belong to.
    InMode(usize, Box<Self>),
}

/// A state variable.
#[derive(Clone, PartialEq, Debug)]
pub struct StateNode {
    /// What stands before it with an `@`.
    pub attributes: Vec<Attribute>,
    /// The place of `reset`, in `reset state`.
    pub reset: Option<Span>,
    /// Its name.
    pub name: Name,
    /// Its type, which the Python target does not have.
    pub ty: Option<Span>,
    /// Its first value.
    pub init: Option<Expression>,
}

/// A method.
#[derive(Clone, PartialEq, Debug)]
pub struct MethodNode {
    /// Its name.
    pub name: Name,
    /// Its arguments after `self`.
    pub arguments: Vec<ArgumentNode>,
    /// The types of arguments and result, which the Python target does not have.
    pub types: Vec<Span>,
    /// What it runs.
    pub body: Body,
}

/// An argument of a method.
#[derive(Clone, PartialEq, Debug)]
pub struct ArgumentNode {
    /// Its name.
    pub name: Name,
    /// Its value if a call leaves it out.
    pub default: Option<Expression>,
}

/// The direction of a port.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum PortKind {
    /// An input port.
    Input {
        /// Whether reactions may change the value that they read, of which they get a copy.
        mutable: bool,
    },
    /// An output port.
    Output,
}

/// A port, or a multiport.
#[derive(Clone, PartialEq, Debug)]
pub struct PortNode {
    /// What stands before it with an `@`.
    pub attributes: Vec<Attribute>,
    /// Input or output.
    pub kind: PortKind,
    /// The width of a multiport.
    pub width: Option<Width>,
    /// Its name.
    pub name: Name,
    /// Its type, which the Python target does not have.
    pub ty: Option<Span>,
}

impl PortNode {
    /// A port that is no multiport.
    #[must_use]
    pub fn new(kind: PortKind, name: Name) -> Self {
        Self { attributes: Vec::new(), kind, width: None, name, ty: None }
    }
}

/// The width of a bank or a multiport: `[4]`, `[n + 1]` or `[]`.
#[derive(Clone, PartialEq, Debug)]
pub struct Width {
    /// What it is the sum of.
    pub terms: Vec<WidthTerm>,
    /// Its place.
    pub span: Span,
}

/// A term of a [`Width`].
#[derive(Clone, PartialEq, Debug)]
pub enum WidthTerm {
    /// A number or a parameter.
    Value(Expression),
    /// `widthof(...)`, which is not supported yet.
    WidthOf(Span),
}

/// A timer.
#[derive(Clone, PartialEq, Debug)]
pub struct TimerNode {
    /// What stands before it with an `@`.
    pub attributes: Vec<Attribute>,
    /// Its name.
    pub name: Name,
    /// When it is due for the first time, after the start.
    pub offset: Option<Expression>,
    /// How often it is due from then on; without one, or with 0, it is due once.
    pub period: Option<Expression>,
}

/// An action.
#[derive(Clone, PartialEq, Debug)]
pub struct ActionNode {
    /// What stands before it with an `@`.
    pub attributes: Vec<Attribute>,
    /// `logical` is false, `physical` is true; neither is an error of the program.
    pub physical: Option<bool>,
    /// Its name.
    pub name: Name,
    /// The minimum delay.
    pub min_delay: Option<Expression>,
    /// The minimum spacing of its events.
    pub spacing: Option<Expression>,
    /// What happens to an event that is too close: a string, if the program is correct.
    pub policy: Option<Expression>,
    /// Its type, which the Python target does not have.
    pub ty: Option<Span>,
}

/// A reaction.
#[derive(Clone, PartialEq, Debug)]
pub struct ReactionNode {
    /// What stands before it with an `@`.
    pub attributes: Vec<Attribute>,
    /// Its name, if it has one.
    pub name: Option<Name>,
    /// What triggers it; nothing stands for all inputs.
    pub triggers: Vec<TriggerNode>,
    /// What it reads beside its triggers.
    pub sources: Vec<Reference>,
    /// What it may set, schedule or enter.
    pub effects: Vec<EffectNode>,
    /// What it runs; a reaction without a body is an error of the program.
    pub body: Option<Body>,
    /// What it does when an input is tardy.
    pub late: Option<Late>,
    /// When it has to be over, and what it does otherwise.
    pub deadline: Option<Deadline>,
    /// From the keyword to the last token before the body.
    pub header: Span,
}

impl ReactionNode {
    /// A reaction that runs `body`, without triggers, sources and effects.
    #[must_use]
    pub fn new(body: Body, header: Span) -> Self {
        Self {
            attributes: Vec::new(),
            name: None,
            triggers: Vec::new(),
            sources: Vec::new(),
            effects: Vec::new(),
            body: Some(body),
            late: None,
            deadline: None,
            header,
        }
    }
}

/// A trigger of a reaction.
#[derive(Clone, PartialEq, Debug)]
pub enum TriggerNode {
    /// The start of the program.
    Startup,
    /// The end of the program.
    Shutdown,
    /// The mode of the reaction is entered by a reset; the place of the word.
    Reset(Span),
    /// A port, an action or a timer.
    Variable(Reference),
}

/// An effect of a reaction.
#[derive(Clone, PartialEq, Debug)]
pub enum EffectNode {
    /// A port or an action; or a mode, if it does not say how the mode is entered.
    Variable(Reference),
    /// `reset(M)` or `history(M)`.
    Mode(Transition, Name),
}

/// What to do when an input is tardy.
#[derive(Clone, PartialEq, Debug)]
pub struct Late {
    /// How long to wait, in the old spellings `STP(t)` and `STAA(t)`.
    pub wait: Option<Expression>,
    /// What runs; none if the reaction's own body handles that.
    pub body: Option<Body>,
}

/// The deadline of a reaction.
#[derive(Clone, PartialEq, Debug)]
pub struct Deadline {
    /// How long after its tag the reaction may begin.
    pub delay: Expression,
    /// What runs if it begins later.
    pub body: Body,
}

/// A watchdog, which is not supported yet.
#[derive(Clone, PartialEq, Debug)]
pub struct Watchdog {
    /// Its name.
    pub name: Name,
}

/// A mode.
#[derive(Clone, PartialEq, Debug)]
pub struct ModeNode {
    /// Whether the reactor starts in it.
    pub initial: bool,
    /// Its name.
    pub name: Option<Name>,
    /// Its members, in their order.
    pub members: Vec<Member>,
    /// From the first keyword to the last token before the brace.
    pub header: Span,
}

/// An instance of a reactor, or a bank of them.
#[derive(Clone, PartialEq, Debug)]
pub struct Instantiation {
    /// What stands before it with an `@`.
    pub attributes: Vec<Attribute>,
    /// Its name.
    pub name: Name,
    /// The width of a bank.
    pub width: Option<Width>,
    /// Its class, as it is called in the file of the container.
    pub class: Name,
    /// The class of each member of a bank, or of the one instance, if names do not tell them; `class` is
    /// then what messages call it. All have the same ports in the same order, but these may have other
    /// widths, and the rest may differ.
    pub members: Option<Vec<ClassId>>,
    /// `<int>`, which the Python target does not have.
    pub type_arguments: Option<Span>,
    /// The parameters that get a value.
    pub assignments: Vec<Assignment>,
    /// The host of a federate (`at`).
    pub host: Option<Name>,
}

impl Instantiation {
    /// One instance whose parameters have their defaults.
    #[must_use]
    pub fn new(name: Name, class: Name) -> Self {
        Self {
            attributes: Vec::new(),
            name,
            width: None,
            class,
            members: None,
            type_arguments: None,
            assignments: Vec::new(),
            host: None,
        }
    }
}

/// A parameter of an instance, and its value.
#[derive(Clone, PartialEq, Debug)]
pub struct Assignment {
    /// The parameter.
    pub name: Name,
    /// Its value, in which parameters of the container may stand.
    pub value: Expression,
}

/// A connection, between as many ports as it names.
#[derive(Clone, PartialEq, Debug)]
pub struct ConnectionNode {
    /// What stands before it with an `@`.
    pub attributes: Vec<Attribute>,
    /// Where it comes from.
    pub left: Vec<Reference>,
    /// `(a, b)+`: the left side is repeated.
    pub iterated: bool,
    /// `~>`.
    pub physical: bool,
    /// Where it leads.
    pub right: Vec<Reference>,
    /// `after`.
    pub delay: Option<Expression>,
    /// The module that encodes its values.
    pub serializer: Option<Name>,
    /// Its place.
    pub span: Span,
}

impl ConnectionNode {
    /// A logical connection without a delay.
    #[must_use]
    pub fn new(left: Vec<Reference>, right: Vec<Reference>, span: Span) -> Self {
        Self {
            attributes: Vec::new(),
            left,
            iterated: false,
            physical: false,
            right,
            delay: None,
            serializer: None,
            span,
        }
    }
}

/// `port`, `instance.port` or `interleaved(instance.port)`; in connections, it may be of one member or one
/// channel.
#[derive(Clone, PartialEq, Debug)]
pub struct Reference {
    /// The instance, if it names a port of one.
    pub container: Option<Name>,
    /// The one member of a bank that is meant; without it, all are.
    pub member: Option<u32>,
    /// The port, action, timer or mode.
    pub variable: Name,
    /// The one channel of a multiport that is meant; without it, all are.
    pub channel: Option<u32>,
    /// Whether the channels of a bank of multiports are taken in turns.
    pub interleaved: bool,
    /// What a reaction calls it: `port as name`.
    pub alias: Option<Name>,
    /// Its place.
    pub span: Span,
}

impl Reference {
    /// A member of the reactor itself.
    #[must_use]
    pub fn own(variable: Name) -> Self {
        let span = variable.span;
        let (container, member, channel, alias) = (None, None, None, None);
        Self { container, member, variable, channel, interleaved: false, alias, span }
    }

    /// A port of an instance that the reactor contains.
    #[must_use]
    pub fn contained(instance: Name, port: Name) -> Self {
        let span = instance.span.to(port.span);
        Self { container: Some(instance), span, ..Self::own(port) }
    }
}

/// An attribute: `@name` or `@name(argument, ...)`.
#[derive(Clone, PartialEq, Debug)]
pub struct Attribute {
    /// Its name, without the `@`.
    pub name: Name,
    /// Its arguments.
    pub arguments: Vec<AttributeArgument>,
    /// Its place.
    pub span: Span,
}

/// An argument of an attribute: `value`, or `name = value`.
#[derive(Clone, PartialEq, Debug)]
pub struct AttributeArgument {
    /// Its name, if it has one.
    pub name: Option<Name>,
    /// Its value.
    pub value: Expression,
}

/// A value, as written.
#[derive(Clone, PartialEq, Debug)]
pub struct Expression {
    /// What it is.
    pub kind: ExpressionKind,
    /// Its place.
    pub span: Span,
}

impl Expression {
    /// A time at `span`.
    #[must_use]
    pub fn time(time: Nanos, span: Span) -> Self {
        Self { kind: ExpressionKind::Time(time), span }
    }
}

/// The kinds of an [`Expression`].
#[derive(Clone, PartialEq, Debug)]
pub enum ExpressionKind {
    /// A whole number.
    Integer(i64),
    /// A number with a point.
    Float(f64),
    /// `true` or `false`.
    Bool(bool),
    /// A string, without quotes and escapes.
    String(String),
    /// A character in single quotes.
    Character(char),
    /// In nanoseconds. `forever` is [`i64::MAX`], `never` is [`i64::MIN`].
    Time(Nanos),
    /// The name of a parameter.
    Parameter(String),
    /// Python, which is text of a source: what is between `{=` and `=}`.
    Code(Span),
    /// `[...]`.
    List(Vec<Expression>),
    /// `(...)`.
    Tuple(Vec<Expression>),
}
