//! A program that a federate was handed, in which the parts of its reactors are found by their names.
//!
//! Nothing of it is believed: what is assembled here and what was handed must agree, element by element. They differ if
//! the executable was built anew after the launcher had asked it, or assembles its reactors in another way each time.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use hprm_core::{
    Action, ActionId, Connection, Direction, FederateId, Id, ModalElement, Mode, ModeId, Nanos,
    Origin, Port, PortId, Program, Reaction, ReactionId, ReactionSpec, Reactor, ReactorId, Spacing,
    Timer, TimerId,
};

use crate::{Kind, Report};

/// How many differences are told.
const TOLD: usize = 5;

/// Elements of one kind by the reactor that has them and their names, those of one name in their order. What was found
/// is taken out.
type Named<I> = BTreeMap<(ReactorId, String), VecDeque<I>>;

/// A program that was handed over.
pub(super) struct Handed {
    program: Arc<Program>,
    /// The reactor that is assembled here.
    root: ReactorId,
    reactors: Named<ReactorId>,
    ports: Named<PortId>,
    actions: Named<ActionId>,
    timers: Named<TimerId>,
    modes: Named<ModeId>,
    reactions: BTreeMap<ReactorId, VecDeque<ReactionId>>,
    spacings: Vec<(ActionId, Spacing)>,
    elements: Vec<(ModalElement, ModeId)>,
    differences: Vec<String>,
}

impl Handed {
    /// A program of which `root` is assembled here, and what is inside it.
    pub(super) fn new(program: Arc<Program>, root: ReactorId) -> Self {
        fn named<'p, I>(elements: impl Iterator<Item = (I, ReactorId, &'p str)>) -> Named<I> {
            let mut named = Named::<I>::new();
            for (id, reactor, name) in elements {
                named.entry((reactor, name.to_owned())).or_default().push_back(id);
            }
            named
        }
        let p = &*program;
        let mut reactions: BTreeMap<_, VecDeque<_>> = BTreeMap::new();
        // A reaction without a number was added by a front end.
        for (id, reaction) in p.reactions.iter().filter(|(_, reaction)| reaction.number > 0) {
            reactions.entry(reaction.reactor).or_default().push_back(id);
        }
        let inside = |(id, reactor): (ReactorId, &'_ Reactor)| Some((id, reactor.parent?));
        let names = p.reactors.iter().filter_map(inside);
        let names = names.map(|(id, parent)| (id, parent, p.reactors[id].name.as_str()));
        Self {
            reactors: named(names),
            ports: named(p.ports.iter().map(|(id, it)| (id, it.reactor, it.name.as_str()))),
            actions: named(p.actions.iter().map(|(id, it)| (id, it.reactor, it.name.as_str()))),
            timers: named(p.timers.iter().map(|(id, it)| (id, it.reactor, it.name.as_str()))),
            modes: named(p.modes.iter().map(|(id, it)| (id, it.reactor, it.name.as_str()))),
            reactions,
            spacings: Vec::new(),
            elements: Vec::new(),
            differences: Vec::new(),
            root,
            program,
        }
    }

    pub(super) fn root(&self) -> ReactorId {
        self.root
    }

    pub(super) fn program_name(&self) -> &str {
        &self.program.name
    }

    pub(super) fn reactor_name(&self, reactor: ReactorId) -> &str {
        self.program.reactors.get(reactor).map_or("?", |reactor| &reactor.name)
    }

    pub(super) fn port_name(&self, port: PortId) -> String {
        match self.program.ports.get(port) {
            Some(_) => self.program.port_name(port),
            None => "?".to_owned(),
        }
    }

    pub(super) fn reactor(&mut self, parent: ReactorId, name: &str) -> ReactorId {
        let full = format!("{}.{name}", self.reactor_name(parent));
        let found = take(&mut self.reactors, parent, &full);
        self.found("reactor", full, found, |_| None)
    }

    pub(super) fn federate(&mut self, name: &str) -> FederateId {
        let found = self.program.federate_named(name);
        self.found("federate", name.to_owned(), found, |_| None)
    }

    pub(super) fn port(&mut self, reactor: ReactorId, name: &str, direction: Direction) -> PortId {
        let found = take(&mut self.ports, reactor, name);
        let what = match direction {
            Direction::Input => "input",
            Direction::Output => "output",
        };
        self.found(what, self.full_name(reactor, name), found, |program| {
            let Port { direction: theirs, .. } = program.ports[found?];
            (theirs != direction).then(|| "has the other direction".to_owned())
        })
    }

    pub(super) fn action(
        &mut self,
        reactor: ReactorId,
        name: &str,
        origin: Origin,
        min_delay: Nanos,
    ) -> ActionId {
        let found = take(&mut self.actions, reactor, name);
        self.found("action", self.full_name(reactor, name), found, |program| {
            let Action { origin: kind, min_delay: delay, .. } = program.actions[found?];
            ((kind, delay) != (origin, min_delay)).then(|| "is of another kind or delay".to_owned())
        })
    }

    pub(super) fn space(&mut self, action: ActionId, spacing: Spacing) {
        self.spacings.push((action, spacing));
    }

    pub(super) fn timer(
        &mut self,
        reactor: ReactorId,
        name: &str,
        offset: Nanos,
        period: Nanos,
    ) -> TimerId {
        let found = take(&mut self.timers, reactor, name);
        self.found("timer", self.full_name(reactor, name), found, |program| {
            let Timer { offset: first, period: then, .. } = program.timers[found?];
            ((first, then) != (offset, period)).then(|| "has another offset or period".to_owned())
        })
    }

    pub(super) fn mode(&mut self, reactor: ReactorId, name: &str, initial: bool) -> ModeId {
        let found = take(&mut self.modes, reactor, name);
        self.found("mode", self.full_name(reactor, name), found, |program| {
            let Mode { initial: theirs, .. } = program.modes[found?];
            (theirs != initial).then(|| "is initial in one of them only".to_owned())
        })
    }

    pub(super) fn reaction(&mut self, reactor: ReactorId, spec: ReactionSpec) -> ReactionId {
        let found = self.reactions.get_mut(&reactor).and_then(VecDeque::pop_front);
        let name = match found {
            Some(found) => self.program.reaction_name(found),
            None => format!("of {}", self.reactor_name(reactor)),
        };
        self.found("reaction", name, found, |program| {
            let theirs = &program.reactions[found?];
            (!is_same(theirs, spec)).then(|| "has other triggers, effects or deadlines".to_owned())
        })
    }

    pub(super) fn put_in_mode(&mut self, element: ModalElement, mode: ModeId) {
        self.elements.push((element, mode));
    }

    /// The program, if what was assembled agrees with it. `connections` are those that were made.
    ///
    /// # Errors
    ///
    /// How the two differ.
    pub(super) fn program(
        mut self,
        connections: &[Connection],
    ) -> Result<Arc<Program>, Box<Report>> {
        self.compare_modes();
        self.compare_connections(connections);
        self.compare_rest();
        if self.differences.is_empty() {
            return Ok(self.program);
        }
        let more = self.differences.len().saturating_sub(TOLD);
        self.differences.truncate(TOLD);
        if more > 0 {
            self.differences.push(format!("{more} more differences"));
        }
        let what = format!(
            "this executable assembles another program than it has declared to its launcher: {}",
            self.differences.join("; ")
        );
        let hint = "start the federation again if the executable was built meanwhile; otherwise: what a program \
                    declares must not depend on the time, the process or chance";
        Err(Box::new(Report::new(Kind::Program, what).hint(hint)))
    }

    /// Modes and spacings, which are stated after what has them.
    fn compare_modes(&mut self) {
        let program = Arc::clone(&self.program);
        for (action, spacing) in &self.spacings {
            let theirs = program.actions.get(*action).and_then(|action| action.spacing);
            if theirs != Some(*spacing) {
                self.differences.push("an action has another spacing".to_owned());
            }
        }
        for (element, mode) in &self.elements {
            let theirs = match *element {
                ModalElement::Reactor(id) => program.reactors.get(id).and_then(|it| it.mode),
                ModalElement::Action(id) => program.actions.get(id).and_then(|it| it.mode),
                ModalElement::Timer(id) => program.timers.get(id).and_then(|it| it.mode),
                ModalElement::Reaction(id) => program.reactions.get(id).and_then(|it| it.mode),
                ModalElement::Connection(id) => program.connections.get(id).and_then(|it| it.mode),
            };
            if theirs != Some(*mode) {
                self.differences.push("an element is in another mode".to_owned());
            }
        }
    }

    fn compare_connections(&mut self, ours: &[Connection]) {
        let key = |it: &Connection| (it.from, it.to, it.delay, it.physical);
        let reactor = |port: PortId| self.program.ports.get(port).map(|port| port.reactor);
        let is_here = |connection: &&Connection| {
            let lies_in = |port| reactor(port).is_some_and(|reactor| self.is_inside(reactor));
            lies_in(connection.from) && lies_in(connection.to)
        };
        let mut theirs: Vec<_> =
            self.program.connections.values().filter(is_here).map(key).collect();
        let mut ours: Vec<_> = ours.iter().map(key).collect();
        theirs.sort_unstable();
        ours.sort_unstable();
        if ours != theirs {
            self.differences.push("the connections differ".to_owned());
        }
    }

    /// What was handed and has not been assembled.
    fn compare_rest(&mut self) {
        fn names<I>(left: &Named<I>) -> impl Iterator<Item = (ReactorId, String)> {
            left.iter().filter(|(_, ids)| !ids.is_empty()).map(|(key, _)| key.clone())
        }
        let parts = [names(&self.ports).collect::<Vec<_>>(), names(&self.actions).collect()];
        let others = [names(&self.timers).collect::<Vec<_>>(), names(&self.modes).collect()];
        let inside: Vec<_> = parts.into_iter().chain(others).flatten().collect();
        for (reactor, name) in inside {
            if self.is_inside(reactor) {
                let name = self.full_name(reactor, &name);
                self.differences.push(format!("{name} is missing here"));
            }
        }
        let reactors: Vec<_> = names(&self.reactors).collect();
        for (parent, name) in reactors {
            if self.is_inside(parent) {
                self.differences.push(format!("{name} is missing here"));
            }
        }
        for (reactor, left) in std::mem::take(&mut self.reactions) {
            if !left.is_empty() && self.is_inside(reactor) {
                let name = self.reactor_name(reactor);
                self.differences.push(format!("{name} has {} more reactions there", left.len()));
            }
        }
    }

    /// Whether a reactor is the root or inside it.
    fn is_inside(&self, mut reactor: ReactorId) -> bool {
        loop {
            if reactor == self.root {
                return true;
            }
            match self.program.reactors.get(reactor).and_then(|reactor| reactor.parent) {
                Some(parent) => reactor = parent,
                None => return false,
            }
        }
    }

    fn full_name(&self, reactor: ReactorId, name: &str) -> String {
        format!("{}.{name}", self.reactor_name(reactor))
    }

    /// What was found; otherwise, or if it differs, that is noted, and any id does.
    fn found<I: Id>(
        &mut self,
        kind: &str,
        name: String,
        found: Option<I>,
        differs: impl FnOnce(&Program) -> Option<String>,
    ) -> I {
        let difference = match found {
            Some(_) => differs(&self.program),
            None => Some("is not in the program of the launcher".to_owned()),
        };
        if let Some(difference) = difference {
            self.differences.push(format!("{kind} {name} {difference}"));
        }
        found.unwrap_or_else(|| I::from_index(0))
    }
}

/// The first of that name that is left.
fn take<I>(named: &mut Named<I>, reactor: ReactorId, name: &str) -> Option<I> {
    named.get_mut(&(reactor, name.to_owned()))?.pop_front()
}

/// Whether a reaction of the handed program is what was assembled, in any order.
fn is_same(theirs: &Reaction, mut ours: ReactionSpec) -> bool {
    fn sorted<T: Ord + Clone>(items: &[T]) -> Vec<T> {
        let mut items = items.to_vec();
        items.sort_unstable();
        items.dedup();
        items
    }
    ours.triggers = sorted(&ours.triggers);
    ours.triggers == sorted(&theirs.triggers)
        && sorted(&ours.sources) == sorted(&theirs.sources)
        && sorted(&ours.effects) == sorted(&theirs.effects)
        && ours.deadline == theirs.deadline
        && ours.handles_tardy == theirs.handles_tardy
}
