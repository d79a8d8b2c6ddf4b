//! The instance tree: every reactor of the running program, with its ports, actions and timers.
//!
//! Reactions and connections come later, when all ports exist; see [`lower`](crate::lower).

use std::collections::BTreeMap;

use hprm_core::{
    ActionId, Direction, ModalElement, ModeId, Nanos, Origin, ProgramBuilder, ReactorId, Table,
    TimerId, limits,
};

use crate::check::{Models, attributes, restart};
use crate::compiled::{Instance, Ports};
use crate::declaration::{self, PortKind};
use crate::diagnostic::{Diagnostic, Report};
use crate::environment::Environment;
use crate::legacy;
use crate::library::{ClassId, Library};
use crate::model::{self, Model, Placed};
use crate::overrides::Assigned;
use crate::source::{FileId, Span, stem};
use crate::spacing;
use crate::value::Value;

/// The most parts of one program: reactors with what they declare, and channels; and the most
/// channels that its connections and reactions name, together.
pub(crate) const MAX: usize = 2_000_000;

/// What a reactor counts for among them: the memory that it takes beside its members.
const REACTOR: usize = 2;

/// The deepest nesting of reactors.
const DEEPEST: usize = 200;

/// An instance and what it is made of, by index into the declarations of its class.
#[derive(Debug)]
pub(crate) struct Node<'a> {
    pub(crate) model: &'a Model<'a>,
    pub(crate) reactor: ReactorId,
    pub(crate) environment: Environment<'a>,
    pub(crate) ports: Vec<Ports>,
    pub(crate) actions: Vec<ActionId>,
    pub(crate) timers: Vec<TimerId>,
    pub(crate) modes: Vec<ModeId>,
    /// By instantiation, the members of the bank; one if it is not a bank.
    pub(crate) children: Vec<Vec<usize>>,
}

/// All instances: node `i` is reactor `i`.
pub(crate) struct Tree<'a> {
    pub(crate) nodes: Vec<Node<'a>>,
    pub(crate) instances: Table<ReactorId, Instance>,
    pub(crate) builder: ProgramBuilder,
    /// Classes that have instances, in the order of the first one.
    pub(crate) classes: Vec<ClassId>,
    size: usize,
    /// Where the program declares each federate, by name.
    federates: BTreeMap<String, Span>,
    federated: bool,
}

/// Makes the instances of `main`, or reports why there are none.
pub(crate) fn instantiate<'a>(
    library: &'a Library,
    models: &'a Models<'a>,
    (main, assigned): (ClassId, &'a [Assigned]),
    builder: ProgramBuilder,
    report: &mut Report,
) -> Option<Tree<'a>> {
    let decl = library.reactor(main);
    let tree = Tree {
        nodes: Vec::new(),
        instances: Table::new(),
        builder,
        classes: Vec::new(),
        size: 0,
        federates: BTreeMap::new(),
        federated: decl.kind == declaration::ReactorKind::Federated,
    };
    let indices = vec![None; models.len()];
    let mut growth = Growth { library, models, tree, indices, report };
    let reactor = growth.tree.builder.main();
    let name = name_of_main(library, decl);
    let parameters = &models[main.0].as_ref()?.declared.parameters;
    let environment = Environment::of_main(parameters, assigned);
    let sources = &library.sources;
    let value = |assigned: &Assigned| Value::new(sources, &assigned.value);
    let assignments = assigned.iter().map(|assigned| (assigned.name.clone(), value(assigned)));
    growth.node(main, reactor, environment, (name, None, assignments.collect()))?;
    growth.contents(0, 1)?;
    Some(growth.tree)
}

struct Growth<'a, 'r> {
    library: &'a Library,
    models: &'a Models<'a>,
    tree: Tree<'a>,
    /// By class, its index among those that have instances.
    indices: Vec<Option<usize>>,
    report: &'r mut Report,
}

impl<'a> Growth<'a, '_> {
    /// Counts more parts; `None` when there are too many.
    fn count(&mut self, more: usize, span: Span) -> Option<()> {
        self.tree.size += more;
        if self.tree.size <= MAX {
            return Some(());
        }
        let message = format!("the program has more than {MAX} reactors, channels and other parts");
        self.report
            .add(Diagnostic::error("LF0406", span, message).hint("reduce the widths of its banks"));
        None
    }

    /// One instance with what it declares itself, without what it contains.
    fn node(
        &mut self,
        class: ClassId,
        reactor: ReactorId,
        environment: Environment<'a>,
        (name, bank_index, assignments): (String, Option<u32>, Vec<(String, Value)>),
    ) -> Option<usize> {
        let model = self.models[class.0].as_ref()?;
        // Whatever is made or copied for each instance; long texts count for more.
        let copied = assignments.iter().map(|(name, _)| name.len()).sum::<usize>() + name.len();
        let members = model.declared.size() + model.declared.parameters.len();
        self.count(REACTOR + members + copied / 100, model.declared.decl.header)?;
        let index = *self.indices[class.0].get_or_insert_with(|| {
            self.tree.classes.push(class);
            self.tree.classes.len() - 1
        });
        self.tree.instances.push(Instance { class: index, name, bank_index, assignments });
        let mut node = Node {
            model,
            reactor,
            environment,
            ports: Vec::new(),
            actions: Vec::new(),
            timers: Vec::new(),
            modes: Vec::new(),
            children: Vec::new(),
        };
        for port in &model.declared.ports {
            let ports = self.port(&node, port)?;
            node.ports.push(ports);
        }
        for mode in &model.declared.modes {
            let name = mode.name.as_ref().map_or("", |name| &name.text);
            node.modes.push(self.tree.builder.mode(reactor, name, mode.initial));
        }
        self.events(&mut node);
        self.tree.nodes.push(node);
        Some(self.tree.nodes.len() - 1)
    }

    fn port(&mut self, node: &Node<'a>, port: &'a declaration::PortNode) -> Option<Ports> {
        let direction = match port.kind {
            PortKind::Input { .. } => Direction::Input,
            PortKind::Output => Direction::Output,
        };
        let name = &port.name.text;
        let builder = &mut self.tree.builder;
        let Some(written) = &port.width else {
            return Some(Ports { first: builder.port(node.reactor, name, direction), width: None });
        };
        // A wrong width has been reported; one channel keeps the rest checkable.
        let width = node.environment.width(written, self.report).unwrap_or(1);
        self.count(width as usize * (1 + name.len() / 100), written.span)?;
        let builder = &mut self.tree.builder;
        let first = builder.port(node.reactor, &format!("{name}[0]"), direction);
        for channel in 1..width {
            builder.port(node.reactor, &format!("{name}[{channel}]"), direction);
        }
        Some(Ports { first, width: Some(width) })
    }

    fn events(&mut self, node: &mut Node<'a>) {
        let environment = &node.environment;
        let time =
            |expression: Option<&'a declaration::Expression>, report: &mut Report| -> Nanos {
                expression.and_then(|e| environment.time(e, report)).unwrap_or_default()
            };
        for Placed { decl: action, mode } in &node.model.declared.actions {
            let min_delay = time(action.min_delay.as_ref(), self.report);
            let physical = action.physical == Some(true);
            let origin = if physical { Origin::Physical } else { Origin::Logical };
            let name = &action.name.text;
            let id = self.tree.builder.action(node.reactor, name, origin, min_delay);
            if let Some(spacing) = spacing::of(action, environment, self.report) {
                self.tree.builder.space(id, spacing);
            }
            if let Some(mode) = mode {
                self.tree.builder.put_in_mode(ModalElement::Action(id), node.modes[*mode]);
            }
            node.actions.push(id);
        }
        for Placed { decl: timer, mode } in &node.model.declared.timers {
            let offset = time(timer.offset.as_ref(), self.report);
            let period = time(timer.period.as_ref(), self.report);
            let name = &timer.name.text;
            let id = self.tree.builder.timer(node.reactor, name, offset, period);
            if let Some(mode) = mode {
                self.tree.builder.put_in_mode(ModalElement::Timer(id), node.modes[*mode]);
            }
            node.timers.push(id);
        }
    }

    /// Everything inside node `parent`, depth first.
    fn contents(&mut self, parent: usize, depth: usize) -> Option<()> {
        let model = self.tree.nodes[parent].model;
        for instance in &model.declared.instances {
            if depth > DEEPEST {
                let message = format!("reactors are nested more than {DEEPEST} deep");
                let span = instance.decl.name.span;
                self.report.add(Diagnostic::error("LF0406", span, message));
                return None;
            }
            let width = match &instance.decl.width {
                None => None,
                Some(written) => {
                    let environment = &self.tree.nodes[parent].environment;
                    Some(environment.width(written, self.report).unwrap_or(1))
                }
            };
            let mut members = Vec::new();
            let width = match &instance.decl.members {
                Some(members) => width.map(|_| u32::try_from(members.len()).unwrap_or(u32::MAX)),
                None => width,
            };
            for member in 0..width.unwrap_or(1) {
                let bank_index = width.map(|_| member);
                let node = self.member(parent, *instance, bank_index)?;
                members.push(node);
                self.contents(node, depth + 1)?;
            }
            self.tree.nodes[parent].children.push(members);
        }
        Some(())
    }

    fn member(
        &mut self,
        parent: usize,
        instance: model::ResolvedInstance<'a>,
        bank_index: Option<u32>,
    ) -> Option<usize> {
        let model::ResolvedInstance { decl, mode, .. } = instance;
        let class = instance.class_of(bank_index.unwrap_or(0));
        let container = &self.tree.nodes[parent];
        let parameters = &self.models[class.0].as_ref()?.declared.parameters;
        let environment = container.environment.of_instance(decl, parameters, bank_index);
        let name = &decl.name.text;
        let place = bank_index.map_or_else(|| name.clone(), |index| format!("{name}[{index}]"));
        let reactor = self.tree.builder.reactor(container.reactor, &place);
        if let Some(mode) = mode {
            self.tree.builder.put_in_mode(ModalElement::Reactor(reactor), container.modes[mode]);
        }
        let full_name = format!("{}.{place}", self.tree.instances[container.reactor].name);
        if self.tree.federated && parent == 0 {
            self.federate(reactor, decl, &environment, bank_index)?;
        }
        let written = decl.assignments.iter().map(|assignment| assignment.value.span.range().len());
        self.count(written.sum::<usize>() / 100, decl.name.span)?;
        let sources = &self.library.sources;
        let assignments = decl
            .assignments
            .iter()
            .map(|assignment| {
                (assignment.name.text.clone(), Value::new(sources, &assignment.value))
            })
            .collect();
        self.node(class, reactor, environment, (full_name, bank_index, assignments))
    }

    fn federate(
        &mut self,
        reactor: ReactorId,
        decl: &'a declaration::Instantiation,
        environment: &Environment<'a>,
        bank_index: Option<u32>,
    ) -> Option<()> {
        if self.tree.federates.len() == limits::FEDERATES {
            let message = format!("a federation has at most {} federates", limits::FEDERATES);
            self.report.add(Diagnostic::error("LF0406", decl.name.span, message));
            return None;
        }
        let outer = &self.tree.nodes[0].environment;
        let maxwait = maxwait(decl, outer, environment, self.report);
        let name = &decl.name.text;
        let name = bank_index.map_or_else(|| name.clone(), |index| format!("{name}__{index}"));
        if let Some(first) = self.tree.federates.insert(name.clone(), decl.name.span) {
            let message = format!("two federates are called `{name}`");
            let error = Diagnostic::error("LF0201", decl.name.span, message);
            self.report.add(error.label(first, "the first one").hint(
                "the members of a bank are federates that have its name with `__` and their index",
            ));
            return None;
        }
        let host = decl.host.as_ref().map(|host| host.text.clone());
        let maxwait = maxwait.unwrap_or(Nanos::MAX);
        let federate = self.tree.builder.federate(reactor, &name, maxwait, host);
        if attributes::is_there(&decl.attributes, "transient") {
            self.tree.builder.make_transient(federate);
        }
        if let Some(restart) = restart::of(&decl.attributes) {
            self.tree.builder.restart(federate, restart);
        }
        Some(())
    }
}

impl Tree<'_> {
    /// Whether the main reactor is a federated one.
    pub(crate) fn is_federated(&self) -> bool {
        self.federated
    }
}

/// How long a federate waits for its inputs, if the program says so.
pub(crate) fn maxwait<'a>(
    decl: &'a declaration::Instantiation,
    outer: &Environment<'a>,
    inner: &Environment<'a>,
    report: &mut Report,
) -> Option<Nanos> {
    match legacy::maxwait(inner) {
        Some(written) => inner.time(written, report),
        None => outer.time(attributes::argument(&decl.attributes, "maxwait")?, report),
    }
}

/// The name of the main reactor: its own, or else its file's.
pub(crate) fn name_of_main(library: &Library, main: &declaration::ReactorNode) -> String {
    let path = library.sources.path(FileId::MAIN);
    main.name.as_ref().map_or_else(|| stem(path).to_owned(), |name| name.text.clone())
}
