//! The tree of a `.lf` file: the whole grammar, as written, nothing resolved.
//!
//! Parts of the language that the checker does not support yet are in the tree too, so that they can be
//! reported with their place.

use hprm_core::Transition;

use crate::source::Span;

/// A name and its place.
#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Name {
    pub(crate) text: String,
    pub(crate) span: Span,
}

/// A file.
#[derive(Clone, PartialEq, Debug, Default)]
pub(crate) struct FileNode {
    pub(crate) target: Option<Target>,
    pub(crate) imports: Vec<Import>,
    pub(crate) preambles: Vec<Body>,
    pub(crate) reactors: Vec<ReactorNode>,
}

/// The text between `{=` and `=}`.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) struct Body {
    pub(crate) inner: Span,
}

#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Target {
    pub(crate) name: Name,
    pub(crate) properties: Vec<Property>,
}

#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Property {
    pub(crate) name: Name,
    pub(crate) value: Element,
}

/// The value of a target property.
#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Element {
    pub(crate) kind: ElementKind,
    pub(crate) span: Span,
}

#[derive(Clone, PartialEq, Debug)]
pub(crate) enum ElementKind {
    Dictionary(Vec<Property>),
    List(Vec<Element>),
    Value(Expression),
    /// A word or a path without quotes.
    Path(String),
}

#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Import {
    pub(crate) reactors: Vec<ImportedReactor>,
    pub(crate) from: ImportSource,
}

#[derive(Clone, PartialEq, Debug)]
pub(crate) struct ImportedReactor {
    pub(crate) name: Name,
    pub(crate) alias: Option<Name>,
}

#[derive(Clone, PartialEq, Debug)]
pub(crate) enum ImportSource {
    File(Name),
    /// The text between `<` and `>`.
    Package(Name),
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum ReactorKind {
    Plain,
    Main,
    Federated,
}

#[derive(Clone, PartialEq, Debug)]
pub(crate) struct ReactorNode {
    pub(crate) attributes: Vec<Attribute>,
    pub(crate) kind: ReactorKind,
    pub(crate) name: Option<Name>,
    /// `<T, U>`.
    pub(crate) type_parameters: Option<Span>,
    pub(crate) parameters: Vec<Parameter>,
    pub(crate) host: Option<Name>,
    pub(crate) extends: Vec<Name>,
    pub(crate) members: Vec<Member>,
    /// From the first keyword to the last token before the brace.
    pub(crate) header: Span,
}

#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Parameter {
    pub(crate) attributes: Vec<Attribute>,
    pub(crate) name: Name,
    pub(crate) ty: Option<Span>,
    pub(crate) default: Option<Expression>,
}

#[derive(Clone, PartialEq, Debug)]
pub(crate) enum Member {
    Preamble(Body),
    State(StateNode),
    Method(MethodNode),
    Port(PortNode),
    Timer(TimerNode),
    Action(ActionNode),
    Watchdog(Watchdog),
    Instantiation(Instantiation),
    Connection(ConnectionNode),
    Reaction(ReactionNode),
    Mode(ModeNode),
}

#[derive(Clone, PartialEq, Debug)]
pub(crate) struct StateNode {
    pub(crate) attributes: Vec<Attribute>,
    /// `reset state`.
    pub(crate) reset: Option<Span>,
    pub(crate) name: Name,
    pub(crate) ty: Option<Span>,
    pub(crate) init: Option<Expression>,
}

#[derive(Clone, PartialEq, Debug)]
pub(crate) struct MethodNode {
    pub(crate) name: Name,
    pub(crate) arguments: Vec<ArgumentNode>,
    pub(crate) types: Vec<Span>,
    pub(crate) body: Body,
}

/// An argument of a method.
#[derive(Clone, PartialEq, Debug)]
pub(crate) struct ArgumentNode {
    pub(crate) name: Name,
    pub(crate) default: Option<Expression>,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum PortKind {
    Input { mutable: bool },
    Output,
}

#[derive(Clone, PartialEq, Debug)]
pub(crate) struct PortNode {
    pub(crate) attributes: Vec<Attribute>,
    pub(crate) kind: PortKind,
    pub(crate) width: Option<Width>,
    pub(crate) name: Name,
    pub(crate) ty: Option<Span>,
}

/// `[4]`, `[n + 1]` or `[]`.
#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Width {
    pub(crate) terms: Vec<WidthTerm>,
    pub(crate) span: Span,
}

#[derive(Clone, PartialEq, Debug)]
pub(crate) enum WidthTerm {
    Value(Expression),
    WidthOf(Span),
}

#[derive(Clone, PartialEq, Debug)]
pub(crate) struct TimerNode {
    pub(crate) attributes: Vec<Attribute>,
    pub(crate) name: Name,
    pub(crate) offset: Option<Expression>,
    pub(crate) period: Option<Expression>,
}

#[derive(Clone, PartialEq, Debug)]
pub(crate) struct ActionNode {
    pub(crate) attributes: Vec<Attribute>,
    /// `logical` is false, `physical` is true; neither is an error of the checker.
    pub(crate) physical: Option<bool>,
    pub(crate) name: Name,
    pub(crate) min_delay: Option<Expression>,
    pub(crate) spacing: Option<Expression>,
    /// What happens to an event that is too close: a string, if the program is correct.
    pub(crate) policy: Option<Expression>,
    pub(crate) ty: Option<Span>,
}

#[derive(Clone, PartialEq, Debug)]
pub(crate) struct ReactionNode {
    pub(crate) attributes: Vec<Attribute>,
    pub(crate) name: Option<Name>,
    pub(crate) triggers: Vec<TriggerNode>,
    pub(crate) sources: Vec<Reference>,
    pub(crate) effects: Vec<EffectNode>,
    pub(crate) body: Option<Body>,
    pub(crate) late: Option<Late>,
    pub(crate) deadline: Option<Deadline>,
    /// From the keyword to the last token before the body.
    pub(crate) header: Span,
}

#[derive(Clone, PartialEq, Debug)]
pub(crate) enum TriggerNode {
    Startup,
    Shutdown,
    Reset(Span),
    Variable(Reference),
}

#[derive(Clone, PartialEq, Debug)]
pub(crate) enum EffectNode {
    Variable(Reference),
    /// `reset(M)` or `history(M)`.
    Mode(Transition, Name),
}

/// What to do when an input is tardy.
#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Late {
    /// How long to wait, in the old spellings `STP(t)` and `STAA(t)`.
    pub(crate) wait: Option<Expression>,
    pub(crate) body: Option<Body>,
}

#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Deadline {
    pub(crate) delay: Expression,
    pub(crate) body: Body,
}

#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Watchdog {
    pub(crate) name: Name,
}

#[derive(Clone, PartialEq, Debug)]
pub(crate) struct ModeNode {
    pub(crate) initial: bool,
    pub(crate) name: Option<Name>,
    pub(crate) members: Vec<Member>,
    pub(crate) header: Span,
}

#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Instantiation {
    pub(crate) attributes: Vec<Attribute>,
    pub(crate) name: Name,
    pub(crate) width: Option<Width>,
    pub(crate) class: Name,
    pub(crate) type_arguments: Option<Span>,
    pub(crate) assignments: Vec<Assignment>,
    pub(crate) host: Option<Name>,
}

#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Assignment {
    pub(crate) name: Name,
    pub(crate) value: Expression,
}

#[derive(Clone, PartialEq, Debug)]
pub(crate) struct ConnectionNode {
    pub(crate) attributes: Vec<Attribute>,
    pub(crate) left: Vec<Reference>,
    /// `(a, b)+`.
    pub(crate) iterated: bool,
    /// `~>`.
    pub(crate) physical: bool,
    pub(crate) right: Vec<Reference>,
    pub(crate) delay: Option<Expression>,
    pub(crate) serializer: Option<Name>,
    pub(crate) span: Span,
}

/// `port`, `instance.port` or `interleaved(instance.port)`.
#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Reference {
    pub(crate) container: Option<Name>,
    pub(crate) variable: Name,
    pub(crate) interleaved: bool,
    pub(crate) alias: Option<Name>,
    pub(crate) span: Span,
}

#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Attribute {
    pub(crate) name: Name,
    pub(crate) arguments: Vec<AttributeArgument>,
    pub(crate) span: Span,
}

/// An argument of an attribute: `value`, or `name = value`.
#[derive(Clone, PartialEq, Debug)]
pub(crate) struct AttributeArgument {
    pub(crate) name: Option<Name>,
    pub(crate) value: Expression,
}

#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Expression {
    pub(crate) kind: ExpressionKind,
    pub(crate) span: Span,
}

#[derive(Clone, PartialEq, Debug)]
pub(crate) enum ExpressionKind {
    Integer(i64),
    Float(f64),
    Bool(bool),
    String(String),
    Character(char),
    /// In nanoseconds; a wrong unit has been reported.
    Time(i64),
    Parameter(String),
    Code(Body),
    /// `[..]` and `{..}`.
    List(Vec<Expression>),
    /// `(..)`.
    Tuple(Vec<Expression>),
}
