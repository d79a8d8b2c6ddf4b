//! From an outline to the boxes and lines of a diagram.

use hprm_core::{Coordination, Direction, Transition};
use hprm_model::outline::{Connection, Drawing, Effect, End, Outline, Trigger};

use crate::cycle::Cycle;
use crate::graph::{
    CLASS, Caption, CaptionKind, Edge, EdgeKind, Graph, Kind, Node, Port, PortShape, REACTION,
    Reactor, Rect, SMALL, Side, TITLE,
};
use crate::scope::{Place, Scopes, Symbol};
use crate::time::time;

/// The diagram of a program in which the contents of those reactors are drawn that `open` says, by their indices.
#[must_use]
pub fn build(outline: &Outline, open: &dyn Fn(usize) -> bool) -> Graph {
    let mut build = Build {
        outline,
        cycle: Cycle::of(outline),
        graph: Graph::default(),
        of: vec![None; outline.reactors.len()],
    };
    build.reactor(0, None, open);
    bring_back(&mut build.graph);
    build.graph
}

/// Moves ports that `@side` puts above or below, and to which lines lead from inside only, to the side where they are
/// without it: there is no layout otherwise.
fn bring_back(graph: &mut Graph) {
    let Graph { nodes, edges, .. } = graph;
    for (index, node) in nodes.iter_mut().enumerate() {
        let ports = node.ports.iter_mut().enumerate();
        for (number, port) in ports.filter(|(_, port)| port.side.is_vertical()) {
            let is_end = |edge: &&Edge| [edge.from, edge.to].contains(&(index, number));
            let mut lines = edges.iter().filter(is_end).peekable();
            if lines.peek().is_some() && lines.all(|edge| edge.container == index) {
                port.side = Side::of(port.direction);
            }
        }
    }
}

/// Whether a reactor has something that its box hides while it is closed.
pub(crate) fn has_contents(outline: &Outline, index: usize) -> bool {
    let reactor = &outline.reactors[index];
    !(reactor.children.is_empty() && reactor.reactions.is_empty() && reactor.modes.is_empty())
}

struct Build<'a> {
    outline: &'a Outline,
    cycle: Cycle,
    graph: Graph,
    /// By reactor, its node.
    of: Vec<Option<usize>>,
}

impl Build<'_> {
    fn add(&mut self, node: Node) -> usize {
        self.graph.nodes.push(node);
        self.graph.nodes.len() - 1
    }

    fn reactor(&mut self, index: usize, parent: Option<usize>, open: &dyn Fn(usize) -> bool) {
        let node = self.reactor_box(index, parent, open(index));
        let is_open = self.graph.nodes[node].is_container();
        self.of[index] = Some(node);
        if !is_open {
            return;
        }
        let outline = self.outline;
        let mut scopes = Scopes::new(node);
        self.modes(index, &mut scopes);
        for child in &outline.reactors[index].children {
            let scope = scopes.of_mode(outline.reactors[*child].mode);
            self.reactor(*child, Some(scope), open);
        }
        for number in 0..outline.reactors[index].reactions.len() {
            self.reaction((index, number), &mut scopes);
        }
        self.unused(index, &mut scopes);
        for connection in &outline.reactors[index].connections {
            self.connection(index, connection, &mut scopes);
        }
        self.order(index, &scopes);
    }

    fn reactor_box(&mut self, index: usize, parent: Option<usize>, open: bool) -> usize {
        let outline = self.outline;
        let reactor = &outline.reactors[index];
        let opens = has_contents(outline, index);
        let federate = reactor.federate.as_ref();
        let kind = Reactor {
            index,
            open: open && opens,
            opens,
            sign: false,
            bank: reactor.width,
            federated: index == 0 && outline.coordination.is_some(),
            transient: federate.is_some_and(|it| it.transient),
        };
        let mut node = Node::new(Kind::Reactor(kind), parent);
        node.title.push((reactor.name.clone(), TITLE));
        if !alike(&reactor.name, &reactor.class) {
            node.title.push((format!(": {}", reactor.class), CLASS));
        }
        if index == 0 {
            let coordination = outline.coordination.map(|it| match it {
                Coordination::Centralized => "centralized coordination",
                Coordination::Decentralized => "decentralized coordination",
            });
            node.captions.extend(coordination.map(|it| caption(it, CaptionKind::Plain)));
            let rti = outline.rti_host.as_ref().map(|host| format!("RTI at {host}"));
            node.captions.extend(rti.map(|it| caption(&it, CaptionKind::Host)));
        }
        if let Some(federate) = federate {
            node.captions.extend(federate.host.as_ref().map(|it| caption(it, CaptionKind::Host)));
            let kinds = [(federate.transient, "transient"), (federate.executable, "executable")];
            let kinds = kinds.into_iter().filter(|(is, _)| *is);
            node.captions.extend(kinds.map(|(_, kind)| caption(kind, CaptionKind::Plain)));
            let wait = federate.maxwait.map(|wait| format!("maxwait: {}", time(wait)));
            node.captions.extend(wait.map(|it| caption(&it, CaptionKind::Note)));
        }
        node.captions.extend(note(&reactor.drawing));
        node.layout.clone_from(&reactor.drawing.layout);
        node.icon.clone_from(&reactor.drawing.icon);
        for (number, port) in reactor.ports.iter().enumerate() {
            let width = port.width.map(|width| format!("[{width}]")).unwrap_or_default();
            let label = port.drawing.label.as_ref().map(|label| format!(" ({label})"));
            let name = format!("{}{width}{}", port.name, label.unwrap_or_default());
            let side = port.drawing.side.as_deref().and_then(Side::named);
            node.ports.push(Port {
                name,
                side: side.unwrap_or(Side::of(port.direction)),
                shape: if port.width.is_some() { PortShape::Multi } else { PortShape::Single },
                red: self.cycle.has_port(End { reactor: index, port: number }),
                ..Port::hidden(port.direction)
            });
        }
        self.add(node)
    }

    /// The boxes of the modes of a reactor.
    fn modes(&mut self, index: usize, scopes: &mut Scopes) {
        let modes = &self.outline.reactors[index].modes;
        if modes.is_empty() {
            return;
        }
        let around = self.add(Node::new(Kind::Modes, Some(scopes.reactor)));
        for mode in modes {
            let mut node = Node::new(Kind::Mode { initial: mode.initial }, Some(around));
            node.title.push((mode.name.clone(), TITLE));
            let node = self.add(node);
            scopes.modes.push(node);
        }
        scopes.around = Some(around);
    }

    /// The timers and actions of a reactor that no reaction names.
    fn unused(&mut self, index: usize, scopes: &mut Scopes) {
        let reactor = &self.outline.reactors[index];
        let timers = reactor.timers.iter().enumerate();
        let timers = timers.map(|(number, timer)| (Symbol::Timer(number), timer.mode));
        let actions = reactor.actions.iter().enumerate();
        let actions = actions.map(|(number, action)| (Symbol::Action(number), action.mode));
        for (symbol, mode) in timers.chain(actions) {
            if !scopes.symbols.keys().any(|(drawn, _)| *drawn == symbol) {
                self.symbol(index, symbol, scopes.of_mode(mode), scopes);
            }
        }
    }

    /// What triggers a reaction of this scope and is no port; it is drawn in each scope that names it.
    fn symbol(&mut self, index: usize, symbol: Symbol, scope: usize, scopes: &mut Scopes) -> usize {
        if let Some(node) = scopes.symbols.get(&(symbol, scope)) {
            return *node;
        }
        let reactor = &self.outline.reactors[index];
        let plain = |text: &str| caption(text, CaptionKind::Plain);
        let (kind, captions, drawing) = match symbol {
            Symbol::Startup => (Kind::Startup, vec![plain("startup")], None),
            Symbol::Shutdown => (Kind::Shutdown, vec![plain("shutdown")], None),
            Symbol::Reset => (Kind::Reset, vec![plain("reset")], None),
            Symbol::Timer(number) => {
                let timer = &reactor.timers[number];
                let mut captions = vec![plain(&timer.name)];
                if timer.offset != 0 || timer.period != 0 {
                    let text = format!("({}, {})", time(timer.offset), time(timer.period));
                    captions.push(plain(&text));
                }
                (Kind::Timer, captions, Some(&timer.drawing))
            }
            Symbol::Action(number) => {
                let action = &reactor.actions[number];
                let mut captions = vec![plain(&action.name)];
                if action.min_delay != 0 {
                    captions.push(plain(&format!("min delay: {}", time(action.min_delay))));
                }
                (Kind::Action { physical: action.physical }, captions, Some(&action.drawing))
            }
        };
        let mut node = Node::new(kind, Some(scope));
        node.captions = captions;
        node.captions.extend(drawing.and_then(note));
        node.ports.push(Port::hidden(Direction::Output));
        if matches!(node.kind, Kind::Action { .. }) {
            node.ports.push(Port::hidden(Direction::Input));
        }
        let node = self.add(node);
        scopes.symbols.insert((symbol, scope), node);
        node
    }

    fn reaction(&mut self, (index, number): (usize, usize), scopes: &mut Scopes) {
        let outline = self.outline;
        let reactor = &outline.reactors[index];
        let reaction = &reactor.reactions[number];
        let red = self.cycle.has_reaction(index, number);
        let scope = scopes.of_mode(reaction.mode);
        let deadline = reaction.deadline.map(time);
        let mut node = Node::new(Kind::Reaction { deadline }, Some(scope));
        let several = (reactor.reactions.len() > 1).then(|| (number + 1).to_string());
        let words: Vec<&str> =
            several.as_deref().into_iter().chain(reaction.name.as_deref()).collect();
        node.title.push((words.join(" "), REACTION));
        node.captions.extend(note(&reaction.drawing));
        node.red = red;
        node.layout.clone_from(&reaction.drawing.layout);
        node.ports = vec![Port::hidden(Direction::Input), Port::hidden(Direction::Output)];
        let node = self.add(node);
        scopes.reactions.push(node);
        let (inward, outward) = (Place { node, port: 0, scope }, Place { node, port: 1, scope });
        for trigger in &reaction.triggers {
            let symbol = match trigger {
                Trigger::Startup => Symbol::Startup,
                Trigger::Shutdown => Symbol::Shutdown,
                Trigger::Reset => Symbol::Reset,
                Trigger::Timer(timer) => Symbol::Timer(*timer),
                Trigger::Action(action) => Symbol::Action(*action),
                Trigger::Port(_) => continue,
            };
            let symbol = self.symbol(index, symbol, scope, scopes);
            let from = Place { node: symbol, port: 0, scope };
            self.join((from, inward), (EdgeKind::Dependency, &[], false), scopes);
        }
        let ports = reaction.triggers.iter().filter_map(|trigger| match trigger {
            Trigger::Port(port) => Some(*port),
            _ => None,
        });
        for port in ports.chain(reaction.sources.iter().copied()) {
            let red = red && self.cycle.has_port(port);
            let from = self.end(index, port, Some(scope), scopes);
            self.join((from, inward), (EdgeKind::Dependency, &[], red), scopes);
        }
        for effect in &reaction.effects {
            let (to, red) = match *effect {
                Effect::Action(action) => {
                    let symbol = self.symbol(index, Symbol::Action(action), scope, scopes);
                    (Place { node: symbol, port: 1, scope }, false)
                }
                Effect::Port(port) => {
                    let red = red && self.cycle.has_port(port);
                    (self.end(index, port, Some(scope), scopes), red)
                }
                Effect::Mode(mode, transition) => {
                    self.transition((index, number), outward, (mode, transition), scopes);
                    continue;
                }
            };
            self.join((outward, to), (EdgeKind::Dependency, &[], red), scopes);
        }
    }

    /// A reaction that can enter a mode: a line between two modes, or from the reaction to the modes.
    fn transition(
        &mut self,
        (index, number): (usize, usize),
        reaction: Place,
        (mode, transition): (usize, Transition),
        scopes: &mut Scopes,
    ) {
        let reactor = &self.outline.reactors[index];
        let Some(around) = scopes.around else { return };
        let kind = EdgeKind::Transition { history: transition == Transition::History };
        let Some(own) = reactor.reactions[number].mode else {
            let name = reactor.modes[mode].name.clone();
            let port = self.hidden_port(around, Direction::Input);
            let to = Place { node: around, port, scope: scopes.reactor };
            self.join((reaction, to), (kind, &[name], false), scopes);
            return;
        };
        let label = self.triggers_of(index, number);
        let (from, to) = (scopes.modes[own], scopes.modes[mode]);
        let drawn = self.graph.edges.iter_mut().find(|edge| {
            edge.from.0 == from && edge.to.0 == to && edge.kind == kind && edge.container == around
        });
        if let Some(drawn) = drawn {
            drawn.label.push(label);
            return;
        }
        let out = self.hidden_port(from, Direction::Output);
        let into = self.hidden_port(to, Direction::Input);
        let from = Place { node: from, port: out, scope: around };
        let to = Place { node: to, port: into, scope: around };
        self.join((from, to), (kind, &[label], false), scopes);
    }

    /// What triggers a reaction, by name.
    fn triggers_of(&self, index: usize, number: usize) -> String {
        let reactor = &self.outline.reactors[index];
        let name = |trigger: &Trigger| match *trigger {
            Trigger::Startup => "startup".to_owned(),
            Trigger::Shutdown => "shutdown".to_owned(),
            Trigger::Reset => "reset".to_owned(),
            Trigger::Timer(timer) => reactor.timers[timer].name.clone(),
            Trigger::Action(action) => reactor.actions[action].name.clone(),
            Trigger::Port(end) => {
                let port = &self.outline.reactors[end.reactor].ports[end.port].name;
                if end.reactor == index {
                    port.clone()
                } else {
                    format!("{}.{port}", self.outline.reactors[end.reactor].name)
                }
            }
        };
        let names: Vec<String> = reactor.reactions[number].triggers.iter().map(name).collect();
        names.join(", ")
    }

    fn hidden_port(&mut self, node: usize, direction: Direction) -> usize {
        let ports = &mut self.graph.nodes[node].ports;
        ports.push(Port::hidden(direction));
        ports.len() - 1
    }

    /// Where a port is that a part of `scope` names. In a mode, a port of the reactor has a counterpart.
    fn end(&mut self, index: usize, end: End, scope: Option<usize>, scopes: &mut Scopes) -> Place {
        let node = self.of[end.reactor].expect("a container before its contents");
        let own = Place { node, port: end.port, scope: scopes.reactor };
        if end.reactor == index {
            return match scope {
                Some(scope) if scope != scopes.reactor => self.counterpart(own, scope, scopes),
                _ => own,
            };
        }
        let home = self.graph.nodes[node].parent.expect("it is in this reactor");
        let own = Place { scope: home, ..own };
        match scope {
            Some(scope) if scope != home => self.counterpart(own, scope, scopes),
            _ => own,
        }
    }

    /// The port of a mode that stands for one outside it; there is a line to the box around the modes.
    fn counterpart(&mut self, original: Place, scope: usize, scopes: &mut Scopes) -> Place {
        let Some(around) = scopes.around.filter(|_| scope != scopes.reactor) else {
            return original;
        };
        let port = self.graph.nodes[original.node].ports[original.port].clone();
        let is_own = original.node == scopes.reactor;
        let name = match is_own {
            true => port.name.clone(),
            false => format!("{}.{}", self.graph.nodes[original.node].title[0].0, port.name),
        };
        // What a contained reactor sets is read in the mode.
        let direction = match (is_own, port.direction) {
            (true, direction) => direction,
            (false, Direction::Input) => Direction::Output,
            (false, Direction::Output) => Direction::Input,
        };
        let counterpart = Port { name: name.clone(), direction, side: Side::of(direction), ..port };
        if self.graph.nodes[around].port(&name).is_none() {
            self.graph.nodes[around]
                .ports
                .push(Port { shape: PortShape::Bar, ..counterpart.clone() });
            let bar = self.graph.nodes[around].ports.len() - 1;
            let bar = Place { node: around, port: bar, scope: scopes.reactor };
            let ends =
                if direction == Direction::Input { (original, bar) } else { (bar, original) };
            let wide = port.shape == PortShape::Multi;
            let kind = EdgeKind::Connection { physical: false, wide };
            self.join(ends, (kind, &[], false), scopes);
        }
        let port = self.graph.nodes[scope].port(&name).unwrap_or_else(|| {
            self.graph.nodes[scope].ports.push(counterpart);
            self.graph.nodes[scope].ports.len() - 1
        });
        Place { node: scope, port, scope }
    }

    fn connection(&mut self, index: usize, connection: &Connection, scopes: &mut Scopes) {
        let scope = connection.mode.map(|mode| scopes.modes[mode]);
        let from = self.end(index, connection.from, scope, scopes);
        let to = self.end(index, connection.to, scope, scopes);
        let width = |end: End| {
            let reactor = &self.outline.reactors[end.reactor];
            reactor.ports[end.port].width.is_some()
                || (end.reactor != index && reactor.width.is_some())
        };
        let wide = width(connection.from) || width(connection.to);
        let kind = EdgeKind::Connection { physical: connection.physical, wide };
        let delay = connection.delay.map(|delay| format!("after {}", time(delay)));
        let wait = connection.absent_after.map(|wait| format!("absent_after: {}", time(wait)));
        let label = connection.drawing.label.clone();
        let lines: Vec<String> = delay.into_iter().chain(wait).chain(label).collect();
        let red = self.cycle.has_connection(connection);
        self.join((from, to), (kind, &lines, red), scopes);
    }

    /// The order of the reactions of a causality loop, without which it would not be one.
    fn order(&mut self, index: usize, scopes: &Scopes) {
        let reactions = self.cycle.reactions_of(index);
        for pair in reactions.windows(2) {
            let (from, to) = (scopes.reactions[pair[0]], scopes.reactions[pair[1]]);
            let scope = self.graph.nodes[from].parent.expect("a reaction is in a reactor");
            if self.graph.nodes[to].parent == Some(scope) {
                self.edge((from, 1), (to, 0), (EdgeKind::Order, &[], true), scope);
            }
        }
    }

    /// A line between two places; one that is there already is not drawn twice.
    fn join(
        &mut self,
        (from, to): (Place, Place),
        drawn: (EdgeKind, &[String], bool),
        scopes: &Scopes,
    ) {
        // Places in two scopes are a reactor's own and its mode's: what is in the mode has a counterpart.
        let scope = if from.scope == to.scope {
            from.scope
        } else if from.scope == scopes.reactor {
            to.scope
        } else {
            from.scope
        };
        self.edge((from.node, from.port), (to.node, to.port), drawn, scope);
    }

    fn edge(
        &mut self,
        from: (usize, usize),
        to: (usize, usize),
        (kind, label, red): (EdgeKind, &[String], bool),
        container: usize,
    ) {
        let label = label.to_vec();
        let edge =
            Edge { container, from, to, kind, label, red, label_rect: None, points: Vec::new() };
        if !self.graph.edges.contains(&edge) {
            self.graph.edges.push(edge);
        }
    }
}

fn caption(text: &str, kind: CaptionKind) -> Caption {
    Caption { text: text.to_owned(), kind }
}

fn note(drawing: &Drawing) -> Option<Caption> {
    drawing.label.as_ref().map(|label| caption(label, CaptionKind::Note))
}

/// Whether a class is called as its instance, but for the case and underscores.
fn alike(instance: &str, class: &str) -> bool {
    let plain = |name: &str| name.replace('_', "").to_lowercase();
    plain(instance) == plain(class)
}

/// The size of a row of texts.
pub(crate) fn title_width(node: &Node) -> f64 {
    node.title.iter().map(|(text, style)| style.width(text)).sum()
}

/// The size of what is written below a title or a symbol.
pub(crate) fn captions_size(node: &Node) -> Rect {
    let widths = node.captions.iter().map(|caption| match caption.kind {
        CaptionKind::Plain => SMALL.width(&caption.text),
        CaptionKind::Note => SMALL.width(&caption.text) + 12.0,
        CaptionKind::Host => SMALL.width(&caption.text) + 20.0,
    });
    let w = widths.fold(0.0, f64::max);
    let h = node.captions.iter().map(caption_height).sum();
    Rect { x: 0.0, y: 0.0, w, h }
}

/// The height of a line below a title or a symbol.
pub(crate) fn caption_height(caption: &Caption) -> f64 {
    match caption.kind {
        CaptionKind::Plain | CaptionKind::Host => SMALL.line(),
        CaptionKind::Note => SMALL.line() + 8.0,
    }
}
