//! A reactor class with its members sorted by kind and its references resolved to indices.
//!
//! Lowering works on the types of this file; they have only references to members that exist.
//! [`resolve`](crate::resolve) resolves the references.

use std::collections::{BTreeMap, BTreeSet};

use hprm_core::Transition;

use crate::declaration::{self, ReactorKind};
use crate::diagnostic::{Diagnostic, Report, existing};
use crate::inherit::{self, Overriding};
use crate::library::{ClassId, Library};
use crate::source::Span;
use crate::syntax::Syntax;

/// The most members of all classes together, with those that they inherit.
pub(crate) const MAX_MEMBERS: usize = 1_000_000;

/// The most modes of one reactor.
const MAX_MODES: usize = 250;

/// The members of a class, after those that it inherits.
#[derive(Debug)]
pub(crate) struct Declarations<'a> {
    pub(crate) decl: &'a declaration::ReactorNode,
    /// Whether an error has been reported for which members are missing here.
    pub(crate) incomplete: bool,
    /// The class and its superclasses; the class is the last.
    pub(crate) lineage: Vec<ClassId>,
    /// The headers of those classes, in the order of the text.
    homes: Vec<Span>,
    /// How many modes the superclasses have of the class whose members are being sorted.
    inherited_modes: usize,
    /// The members by name.
    index: Index<'a>,
    pub(crate) parameters: Vec<&'a declaration::Parameter>,
    pub(crate) preambles: Vec<Span>,
    pub(crate) modes: Vec<&'a declaration::ModeNode>,
    pub(crate) states: Vec<Placed<'a, declaration::StateNode>>,
    pub(crate) methods: Vec<&'a declaration::MethodNode>,
    pub(crate) ports: Vec<&'a declaration::PortNode>,
    pub(crate) timers: Vec<Placed<'a, declaration::TimerNode>>,
    pub(crate) actions: Vec<Placed<'a, declaration::ActionNode>>,
    pub(crate) instances: Vec<ResolvedInstance<'a>>,
    pub(crate) reactions: Vec<Placed<'a, declaration::ReactionNode>>,
    pub(crate) connections: Vec<Placed<'a, declaration::ConnectionNode>>,
}

/// The members that are looked up most often, by name. Of two members of one name, the first.
#[derive(Debug, Default)]
struct Index<'a> {
    variables: BTreeMap<&'a str, Entity>,
    instances: BTreeMap<&'a str, usize>,
    modes: BTreeMap<&'a str, usize>,
    parameters: BTreeMap<&'a str, &'a declaration::Parameter>,
}

/// A member, and the mode that it is declared in, by index.
#[derive(Debug)]
pub(crate) struct Placed<'a, T> {
    pub(crate) decl: &'a T,
    pub(crate) mode: Option<usize>,
}

// Derived, these would ask the same of `T`.
impl<T> Clone for Placed<'_, T> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<T> Copy for Placed<'_, T> {}

impl<T> std::ops::Deref for Placed<'_, T> {
    type Target = T;

    fn deref(&self) -> &T {
        self.decl
    }
}

/// An instantiation and the class that it names.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ResolvedInstance<'a> {
    pub(crate) decl: &'a declaration::Instantiation,
    pub(crate) mode: Option<usize>,
    /// Of a bank, the class of its first member; all others have the same ports.
    pub(crate) class: ClassId,
}

impl ResolvedInstance<'_> {
    /// The class of one member of a bank, or of the one instance.
    pub(crate) fn class_of(&self, member: u32) -> ClassId {
        let members = self.decl.members.as_deref().unwrap_or_default();
        members.get(member as usize).copied().unwrap_or(self.class)
    }

    /// The classes that it is made of, the first member's first; one may be there several times.
    pub(crate) fn classes(&self) -> impl Iterator<Item = ClassId> {
        let others = self.decl.members.iter().flatten().skip(1).copied();
        std::iter::once(self.class).chain(others)
    }
}

/// A class, resolved.
#[derive(Debug)]
pub(crate) struct Model<'a> {
    pub(crate) declared: Declarations<'a>,
    pub(crate) reactions: Vec<ResolvedReaction<'a>>,
    pub(crate) connections: Vec<ResolvedConnection<'a>>,
}

/// A variable that a reaction or a connection names, by index into the [`Declarations`].
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(crate) enum Entity {
    Port(usize),
    Timer(usize),
    Action(usize),
    /// `port` indexes the ports of the instance's class.
    Contained {
        instance: usize,
        port: usize,
    },
    /// A mode, as the effect of a reaction that enters it.
    Mode(usize, Transition),
}

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(crate) enum ResolvedTrigger {
    Startup,
    Shutdown,
    Reset,
    Variable(Entity),
}

/// A parameter of a reaction's Python function.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Slot {
    pub(crate) name: String,
    pub(crate) holds: Held,
}

impl Slot {
    pub(crate) fn is_alias(&self) -> bool {
        matches!(self.holds, Held::Alias { .. })
    }
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Held {
    Port(usize),
    Action(usize),
    /// All ports of a contained instance that the reaction mentions.
    Instance(usize),
    /// One of those ports as a variable of its own, `instance_port`.
    Alias {
        instance: usize,
        port: usize,
    },
    Mode(usize, Transition),
}

#[derive(Debug)]
pub(crate) struct ResolvedReaction<'a> {
    pub(crate) decl: &'a declaration::ReactionNode,
    pub(crate) mode: Option<usize>,
    pub(crate) triggers: Vec<ResolvedTrigger>,
    pub(crate) sources: Vec<Entity>,
    pub(crate) effects: Vec<Entity>,
    /// Of a reaction that names single members and channels: by what it names as what, those that are meant, each once.
    pub(crate) ends: BTreeMap<(Role, Entity), BTreeMap<Part, End>>,
    /// Other names that it gives to ports and actions: `port as name`.
    pub(crate) aliases: Vec<(Entity, &'a declaration::Name)>,
    pub(crate) slots: Vec<Slot>,
}

/// The only member of a bank, and the only channel of a multiport, that are meant.
pub(crate) type Part = (Option<u32>, Option<u32>);

/// What a reference is used for.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(crate) enum Role {
    Trigger,
    Source,
    Effect,
    From,
    To,
}

impl Role {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Trigger => "a trigger",
            Self::Source => "a source",
            Self::Effect => "an effect",
            Self::From => "the source of a connection",
            Self::To => "the destination of a connection",
        }
    }

    pub(crate) fn writes(self) -> bool {
        matches!(self, Self::Effect | Self::To)
    }
}

impl<'a> ResolvedReaction<'a> {
    /// Its name, if the program gives it one. Executables declare reactions with their numbers for names.
    pub(crate) fn name(&self) -> Option<&'a str> {
        let is_number = |name: &str| {
            name.strip_prefix("reaction_").is_some_and(|rest| rest.parse::<u32>().is_ok())
        };
        self.decl.name.as_ref().map(|name| name.text.as_str()).filter(|name| !is_number(name))
    }

    /// The variables that it can read: triggers and sources.
    pub(crate) fn reads(&self) -> impl Iterator<Item = Entity> {
        self.variables().chain(self.sources.iter().copied())
    }

    /// The triggers that have a name.
    pub(crate) fn variables(&self) -> impl Iterator<Item = Entity> {
        self.triggers.iter().filter_map(|trigger| match trigger {
            ResolvedTrigger::Variable(entity) => Some(*entity),
            ResolvedTrigger::Startup | ResolvedTrigger::Shutdown | ResolvedTrigger::Reset => None,
        })
    }

    /// All variables that it names, each once.
    pub(crate) fn mentions(&self) -> Vec<Entity> {
        let mut seen = BTreeSet::new();
        let all = self.reads().chain(self.effects.iter().copied());
        all.filter(|entity| seen.insert(*entity)).collect()
    }
}

/// One port reference of a connection, or of a reaction that names single members and channels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct End {
    pub(crate) entity: Entity,
    pub(crate) interleaved: bool,
    /// The only member of a bank that is meant.
    pub(crate) member: Option<u32>,
    /// The only channel of a multiport that is meant.
    pub(crate) channel: Option<u32>,
    pub(crate) span: Span,
}

impl End {
    /// All members and channels of `entity`.
    pub(crate) fn whole(entity: Entity, span: Span) -> Self {
        Self { entity, interleaved: false, member: None, channel: None, span }
    }

    /// What `reference` says of `entity`.
    pub(crate) fn new(entity: Entity, reference: &declaration::Reference) -> Self {
        let declaration::Reference { interleaved, member, channel, span, .. } = *reference;
        Self { entity, interleaved, member, channel, span }
    }
}

#[derive(Debug)]
pub(crate) struct ResolvedConnection<'a> {
    pub(crate) decl: &'a declaration::ConnectionNode,
    pub(crate) mode: Option<usize>,
    pub(crate) left: Vec<End>,
    pub(crate) right: Vec<End>,
}

impl<'a> Declarations<'a> {
    /// Sorts the members of a class. Instances of unknown classes are reported and left out.
    pub(crate) fn new(library: &'a Library, class: ClassId, report: &mut Report) -> Self {
        let decl = library.reactor(class);
        let mut declared = Self {
            decl,
            incomplete: false,
            lineage: Vec::new(),
            homes: Vec::new(),
            inherited_modes: 0,
            index: Index::default(),
            parameters: Vec::new(),
            preambles: Vec::new(),
            modes: Vec::new(),
            states: Vec::new(),
            methods: Vec::new(),
            ports: Vec::new(),
            timers: Vec::new(),
            actions: Vec::new(),
            instances: Vec::new(),
            reactions: Vec::new(),
            connections: Vec::new(),
        };
        let inherit::Lineage { classes, incomplete } = inherit::lineage(library, class, report);
        declared.incomplete = incomplete;
        let mut parameters = Overriding::default();
        for home in &classes {
            let ancestor = library.reactor(*home);
            declared.inherited_modes = declared.modes.len();
            parameters.extend(&ancestor.parameters, |parameter| &parameter.name);
            for member in &ancestor.members {
                declared.member((library, *home), member, None, report);
            }
            if declared.size() > MAX_MEMBERS {
                let message = format!("a reactor has at most {MAX_MEMBERS} members");
                declared.miss(Diagnostic::error("LF0406", decl.header, message), report);
                break;
            }
        }
        declared.parameters = parameters.all;
        declared.homes = classes.iter().map(|home| library.reactor(*home).header).collect();
        declared.homes.sort_unstable();
        declared.lineage = classes;
        declared.index = Index::new(&declared);
        declared
    }

    /// How many members there are, with those that are inherited.
    pub(crate) fn size(&self) -> usize {
        [
            self.preambles.len(),
            self.modes.len(),
            self.states.len(),
            self.methods.len(),
            self.ports.len(),
            self.timers.len(),
            self.actions.len(),
            self.instances.len(),
            self.reactions.len(),
            self.connections.len(),
        ]
        .into_iter()
        .sum()
    }

    /// The number of the class in the lineage that declares what is at `span`.
    pub(crate) fn home(&self, span: Span) -> usize {
        if self.homes.len() == 1 {
            // Its members may be anywhere.
            return 0;
        }
        self.homes.partition_point(|home| (home.file, home.start) <= (span.file, span.start))
    }

    fn member(
        &mut self,
        (library, class): (&'a Library, ClassId),
        member: &'a declaration::Member,
        mode: Option<usize>,
        report: &mut Report,
    ) {
        match member {
            declaration::Member::Preamble(text) => self.preambles.push(*text),
            declaration::Member::State(decl) => self.states.push(Placed { decl, mode }),
            declaration::Member::Method(method) => self.methods.push(method),
            declaration::Member::Port(port) => self.ports.push(port),
            declaration::Member::Timer(decl) => self.timers.push(Placed { decl, mode }),
            declaration::Member::Action(decl) => self.actions.push(Placed { decl, mode }),
            declaration::Member::Reaction(decl) => self.reactions.push(Placed { decl, mode }),
            declaration::Member::Connection(decl) => {
                self.connections.push(Placed { decl, mode });
            }
            declaration::Member::Instantiation(_) if report.is_full() => self.incomplete = true,
            declaration::Member::Instantiation(decl) => {
                match class_of(library, class, decl, report.syntax()) {
                    Ok(class) => self.instances.push(ResolvedInstance { decl, mode, class }),
                    Err(diagnostic) => self.miss(*diagnostic, report),
                }
            }
            declaration::Member::Watchdog(watchdog) => {
                let instead = "use a physical action, or a deadline";
                let span = watchdog.name.span;
                self.miss(Diagnostic::unsupported(span, "watchdogs are", instead), report);
            }
            declaration::Member::Mode(decl) if self.modes.len() == MAX_MODES => {
                let message = format!("a reactor has at most {MAX_MODES} modes");
                self.miss(Diagnostic::error("LF0406", decl.header, message), report);
            }
            declaration::Member::Mode(decl) => {
                let index = self.modes.len();
                self.modes.push(decl);
                for member in &decl.members {
                    if may_be_in_mode(member, report) {
                        self.member((library, class), member, Some(index), report);
                    }
                }
            }
            declaration::Member::InMode(number, member) => {
                if may_be_in_mode(member, report) {
                    let place = Some(self.inherited_modes + number);
                    self.member((library, class), member, place, report);
                }
            }
        }
    }

    /// Reports why a member is missing.
    fn miss(&mut self, why: Diagnostic, report: &mut Report) {
        self.incomplete = true;
        report.add(why);
    }

    /// The port, action or timer of this name.
    pub(crate) fn variable(&self, name: &str) -> Option<Entity> {
        self.index.variables.get(name).copied()
    }

    /// The instance of this name, by index.
    pub(crate) fn instance(&self, name: &str) -> Option<usize> {
        self.index.instances.get(name).copied()
    }

    /// The mode of this name, by index.
    pub(crate) fn mode(&self, name: &str) -> Option<usize> {
        self.index.modes.get(name).copied()
    }

    /// The port of this name, by index.
    pub(crate) fn port(&self, name: &str) -> Option<usize> {
        match self.variable(name) {
            Some(Entity::Port(port)) => Some(port),
            _ => None,
        }
    }

    pub(crate) fn parameter(&self, name: &str) -> Option<&'a declaration::Parameter> {
        self.index.parameters.get(name).copied()
    }
}

impl<'a> Index<'a> {
    fn new(declared: &Declarations<'a>) -> Self {
        let mut index = Self::default();
        for (i, port) in declared.ports.iter().enumerate() {
            index.variables.entry(&port.name.text).or_insert(Entity::Port(i));
        }
        for (i, action) in declared.actions.iter().enumerate() {
            index.variables.entry(&action.decl.name.text).or_insert(Entity::Action(i));
        }
        for (i, timer) in declared.timers.iter().enumerate() {
            index.variables.entry(&timer.decl.name.text).or_insert(Entity::Timer(i));
        }
        for (i, instance) in declared.instances.iter().enumerate() {
            index.instances.entry(&instance.decl.name.text).or_insert(i);
        }
        for (i, mode) in declared.modes.iter().enumerate() {
            if let Some(name) = &mode.name {
                index.modes.entry(&name.text).or_insert(i);
            }
        }
        for parameter in &declared.parameters {
            index.parameters.entry(&parameter.name.text).or_insert(parameter);
        }
        index
    }
}

/// The class of an instance; of a bank, that of its first member.
fn class_of(
    library: &Library,
    container: ClassId,
    decl: &declaration::Instantiation,
    syntax: Syntax,
) -> Result<ClassId, Box<Diagnostic>> {
    let name = &decl.class;
    let found = library.find(library.file_of(container), &name.text);
    let classes = match &decl.members {
        Some(members) => members.as_slice(),
        None => found.as_slice(),
    };
    let is_plain = |class: &ClassId| library.reactor(*class).kind == ReactorKind::Plain;
    match classes {
        [first, ..] if classes.iter().all(is_plain) => Ok(*first),
        [] if decl.members.is_some() => {
            let message = format!("the bank `{}` has no members", decl.name.text);
            Err(Box::new(
                Diagnostic::error("LF0405", decl.name.span, message)
                    .hint("a bank has at least one"),
            ))
        }
        [] => {
            let message = format!("there is no reactor `{}`", name.text);
            let names = library.names(library.file_of(container));
            let hint = existing(&name.text, "reactors", names);
            Err(Box::new(Diagnostic::error("LF0301", name.span, message).hint(hint)))
        }
        _ => {
            let message = syntax.is_main(&name.text);
            Err(Box::new(
                Diagnostic::error("LF0307", name.span, message)
                    .hint("put what both need into a plain reactor"),
            ))
        }
    }
}

/// Reports a member that cannot be in a mode.
fn may_be_in_mode(member: &declaration::Member, report: &mut Report) -> bool {
    let (what, span) = match member {
        declaration::Member::Preamble(text) => ("a preamble", *text),
        declaration::Member::Method(method) => ("a method", method.name.span),
        declaration::Member::Port(port) => ("a port", port.name.span),
        declaration::Member::Mode(mode) => ("another mode", mode.header),
        _ => return true,
    };
    let message = format!("{what} cannot be declared in a mode");
    report.add(
        Diagnostic::error("LF0909", span, message).hint("declare it in the reactor, outside modes"),
    );
    false
}
