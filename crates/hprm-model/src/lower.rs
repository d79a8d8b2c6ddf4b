//! From checked classes to the program: instances, then reactions, then connections, then the
//! builder's own checks, whose findings become diagnostics.

use std::collections::BTreeSet;
use std::sync::Arc;

use hprm_core::{
    Effect, ModalElement, PortId, Program, ProgramBuilder, ProgramError, Properties, ReactionId,
    ReactorId, Table, Trigger,
};

use crate::check::{Models, modes, unset};
use crate::class;
use crate::compiled::{Class, Instance, ReactionCode, Runs};
use crate::connections;
use crate::diagnostic::{Diagnostic, Report};
use crate::instance::{self, MAX, Tree};
use crate::legacy::Waits;
use crate::library::{ClassId, Library};
use crate::outline::Outline;
use crate::overrides::Assigned;
use crate::reaction;
use crate::sketch;
use crate::source::Span;
use crate::syntax::Syntax;
use crate::unconnected;

/// What lowering makes of a checked program.
pub(crate) struct Lowered {
    pub(crate) program: Arc<Program>,
    pub(crate) classes: Vec<Class>,
    pub(crate) instances: Table<ReactorId, Instance>,
    pub(crate) bodies: Table<ReactionId, ReactionCode>,
    /// By connection.
    pub(crate) connections: Vec<Span>,
    /// Which the classes are.
    pub(crate) used: Vec<ClassId>,
}

/// What a compilation leaves behind even if the program is refused.
#[derive(Default)]
pub(crate) struct Wanted {
    pub(crate) outline: Option<Outline>,
}

/// The program with main reactor `main`, whose parameters may be assigned; none if an error was reported.
pub(crate) fn lower<'a>(
    library: &'a Library,
    models: &'a Models<'a>,
    (main, assigned): (ClassId, &'a [Assigned]),
    (properties, mut wanted): (Properties, Option<&mut Wanted>),
    report: &mut Report,
) -> Option<Lowered> {
    let coordination = properties.coordination;
    let name = instance::name_of_main(library, library.reactor(main));
    let builder = ProgramBuilder::new(&name, properties);
    let mut tree = instance::instantiate(library, models, (main, assigned), builder, report)?;
    let mut origins = Origins::default();
    let mut waits = Waits::default();
    let bodies = reactions(&mut tree, &mut waits, &mut origins, report);
    let connections = connections::connections(&tree, waits, report);
    if let Some(wanted) = &mut wanted {
        let coordination = tree.is_federated().then_some(coordination);
        wanted.outline = Some(sketch::outline(library, &tree, coordination));
    }
    if report.has_errors() {
        return None;
    }
    for it in &connections {
        tree.builder.connection(it.connection.clone());
        origins.connections.push(it.span);
    }
    let is_federated = tree.is_federated();
    let Tree { nodes, instances, builder, classes: used, .. } = tree;
    origins.reactors = nodes.iter().map(|node| node.model.declared.decl.header).collect();
    let program = match builder.build() {
        Ok(program) => Arc::new(program),
        Err(error) => {
            if let (ProgramError::CausalityLoop { reactions, .. }, Some(outline)) =
                (&error, wanted.and_then(|wanted| wanted.outline.as_mut()))
            {
                outline.cycle = sketch::places(&nodes, reactions);
            }
            report.add(origins.explain(&error, library.reactor(main).header, report.syntax()));
            return None;
        }
    };
    // Of a program that is otherwise right.
    if !library.is_part {
        let written = origins.writers.iter().map(|(port, _)| *port);
        unconnected::check(&nodes, &connections, written, report);
        if is_federated && program.federates.is_empty() {
            let message = "this federation has no reactors, so nothing runs";
            let hint = report.syntax().make_federate();
            let header = library.reactor(main).header;
            report.add(Diagnostic::warning("LF0806", header, message).hint(hint));
        }
    }
    for class in &used {
        models[class.0].iter().for_each(|model| unset::check(model, &library.sources, report));
    }
    let connections = origins.connections;
    let mut lowered =
        Lowered { program, classes: Vec::new(), instances, bodies, connections, used };
    lowered.classes =
        lowered.used.iter().filter_map(|id| emit(library, models, *id, &name)).collect();
    Some(lowered)
}

/// The program of a file that has none.
pub(crate) fn nothing(properties: Properties) -> Lowered {
    let program = ProgramBuilder::new("", properties).build().expect("nothing is in it");
    let (instances, bodies) = (Table::new(), Table::new());
    let (classes, connections, used) = (Vec::new(), Vec::new(), Vec::new());
    Lowered { program: Arc::new(program), classes, instances, bodies, connections, used }
}

/// Adds the classes that have no instances.
pub(crate) fn add_classes(library: &Library, models: &Models<'_>, lowered: &mut Lowered) {
    let used: BTreeSet<ClassId> = lowered.used.iter().copied().collect();
    let idle = library.classes().filter(|id| !used.contains(id));
    lowered.classes.extend(idle.filter_map(|id| emit(library, models, id, "")));
}

/// A class for Python; none if it was not resolved. A main reactor may have no name but `unnamed`.
fn emit(library: &Library, models: &Models<'_>, id: ClassId, unnamed: &str) -> Option<Class> {
    let name = library.reactor(id).name.as_ref().map_or(unnamed, |name| &name.text);
    Some(class::emit(library, models, (id, models[id.0].as_ref()?), name.to_owned()))
}

fn reactions(
    tree: &mut Tree<'_>,
    waits: &mut Waits,
    origins: &mut Origins,
    report: &mut Report,
) -> Table<ReactionId, ReactionCode> {
    let mut bodies = Table::new();
    let mut named = 0;
    for index in 0..tree.nodes.len() {
        let node = &tree.nodes[index];
        let (model, reactor) = (node.model, node.reactor);
        let class = tree.instances[reactor].class;
        for (mode, states) in modes::resets(&model.declared) {
            let place = mode.map(|mode| node.modes[mode]);
            let id = tree.builder.added_reaction(reactor, Trigger::Reset);
            if let Some(mode) = place {
                tree.builder.put_in_mode(ModalElement::Reaction(id), mode);
            }
            origins.reactions.push(model.declared.decl.header);
            bodies.push(ReactionCode { class, runs: Runs::ResetState(states), arguments: vec![] });
        }
        for (number, reaction) in model.reactions.iter().enumerate() {
            let node = &tree.nodes[index];
            let spec = reaction::spec(tree, node, reaction, report);
            named += 1 + spec.triggers.len() + spec.sources.len() + spec.effects.len();
            if named > MAX {
                let message = format!("the reactions name more than {MAX} channels");
                report.add(
                    Diagnostic::error("LF0406", reaction.decl.header, message)
                        .hint("reduce the widths of banks, or name fewer ports"),
                );
                return bodies;
            }
            let arguments = reaction::arguments(tree, node, reaction);
            reaction::note_wait(tree, node, reaction, waits, report);
            let writes = spec.effects.iter().filter_map(|effect| match effect {
                Effect::Port(port) => Some((*port, reaction.decl.header)),
                Effect::Action(_) | Effect::Mode(..) => None,
            });
            origins.writers.extend(writes);
            origins.reactions.push(reaction.decl.header);
            let place = reaction.mode.map(|mode| node.modes[mode]);
            let id = tree.builder.reaction(reactor, spec);
            if let Some(mode) = place {
                tree.builder.put_in_mode(ModalElement::Reaction(id), mode);
            }
            bodies.push(ReactionCode { class, runs: Runs::Reaction(number), arguments });
        }
    }
    bodies
}

/// The most reactions of a cycle that have a label.
const SHOWN: usize = 20;

/// Where the parts of the program are written.
#[derive(Default)]
struct Origins {
    reactors: Vec<Span>,
    reactions: Vec<Span>,
    connections: Vec<Span>,
    writers: Vec<(PortId, Span)>,
}

impl Origins {
    /// The builder's finding, at the place in the text that causes it.
    fn explain(&self, error: &ProgramError, main: Span, syntax: Syntax) -> Diagnostic {
        match error {
            ProgramError::CausalityLoop { reactions, names } => {
                self.causality(reactions, names, syntax)
            }
            ProgramError::TwoSources { port, name, connections } => {
                self.two_sources(*port, name, connections.iter().map(|c| c.index()))
            }
            ProgramError::Blocking { connection, name, why } => {
                let span = self.connections.get(connection.index()).copied().unwrap_or(main);
                let message = format!("the sender on {name} cannot wait for its receiver: {why}");
                let bound = syntax.option_with("bound", "10, \"replace\"");
                Diagnostic::error("LF0507", span, message)
                    .hint(format!("drop messages instead: {bound} or \"drop\""))
            }
            ProgramError::OutsideFederates { reactor, name } => {
                let span = self.reactors.get(reactor.index()).copied().unwrap_or(main);
                let message = format!("`{name}` belongs to no federate");
                Diagnostic::error("LF0801", span, message).hint(syntax.move_into_federate())
            }
            other => Diagnostic::error("LF0504", main, other.to_string()),
        }
    }

    fn causality(&self, reactions: &[ReactionId], names: &str, syntax: Syntax) -> Diagnostic {
        let span = |reaction: &ReactionId| self.reactions[reaction.index()];
        let mut seen = BTreeSet::new();
        let spans: Vec<Span> =
            reactions.iter().map(span).filter(|span| seen.insert(*span)).take(SHOWN).collect();
        let message = match reactions {
            [_] => format!("the reaction {names} waits for itself: it reads what it sets"),
            _ => format!("reactions wait for one another in a cycle: {names}"),
        };
        let diagnostic = Diagnostic::error("LF0503", spans[0], message).hint(format!(
            "give one of the connections a delay, such as {}, or reorder the reactions",
            syntax.shortest_delay()
        ));
        spans[1..].iter().fold(diagnostic, |diagnostic, span| {
            diagnostic.label(*span, "this reaction is in the cycle")
        })
    }

    fn two_sources(
        &self,
        port: PortId,
        name: &str,
        connections: impl Iterator<Item = usize>,
    ) -> Diagnostic {
        let mut spans: Vec<Span> = connections.map(|index| self.connections[index]).collect();
        spans.sort_unstable();
        let writer = self.writers.iter().find(|(written, _)| *written == port);
        let last = spans.pop().unwrap_or(self.reactors[0]);
        let message = format!("the port `{name}` has two sources");
        let diagnostic = Diagnostic::error("LF0502", last, message)
            .hint("a port is set by one connection, or by the reactions of one reactor");
        match (spans.first(), writer) {
            (Some(first), _) if *first != last => diagnostic.label(*first, "it is also set here"),
            (Some(_), _) => {
                // As in a loop.
                let count = spans.len() + 1;
                diagnostic.hint(format!(
                    "it is connected {count} times here; a port is set by one connection, or by \
                     the reactions of one reactor"
                ))
            }
            (None, Some((_, reaction))) => diagnostic.label(*reaction, "this reaction sets it too"),
            _ => diagnostic,
        }
    }
}
