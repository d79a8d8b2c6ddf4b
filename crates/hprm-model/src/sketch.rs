//! The [outline](crate::outline) of a program, from its instances and the declarations of their classes.

use hprm_core::{Coordination, Direction, Nanos, ReactionId};

use crate::check::{attributes, modes};
use crate::declaration::{Attribute, Expression, ExpressionKind, Instantiation, PortKind};
use crate::diagnostic::Report;
use crate::instance::{self, Node, Tree};
use crate::library::Library;
use crate::model::{Entity, ResolvedConnection, ResolvedReaction, ResolvedTrigger};
use crate::outline::{
    Action, Connection, Drawing, Effect, End, Federate, Mode, Outline, Port, Reaction, Reactor,
    Timer, Trigger,
};

/// Draws all instances of `tree`; `coordination` is that of a federated program.
pub(crate) fn outline(
    library: &Library,
    tree: &Tree<'_>,
    coordination: Option<Coordination>,
) -> Outline {
    let mut sketch =
        Sketch { library, tree, report: Report::default(), reactors: Vec::new(), of: Vec::new() };
    sketch.of = vec![None; tree.nodes.len()];
    sketch.reactor(0, None);
    for index in 0..tree.nodes.len() {
        // Of a bank, its first member stands for all.
        if let Some((reactor, true)) = sketch.of[index] {
            sketch.contents(reactor, index);
        }
    }
    let main = tree.nodes[0].model.declared.decl;
    let rti_host = main.host.as_ref().map(|host| host.text.clone());
    Outline { reactors: sketch.reactors, coordination, rti_host, cycle: Vec::new() }
}

/// Which reactions of the outline these are: the index of the reactor, and that of the reaction in it.
pub(crate) fn places(tree: &[Node<'_>], wanted: &[ReactionId]) -> Vec<(usize, usize)> {
    let mut all = Vec::new();
    for (index, node) in tree.iter().enumerate() {
        all.extend(modes::resets(&node.model.declared).iter().map(|_| None));
        all.extend((0..node.model.reactions.len()).map(|number| Some((index, number))));
    }
    let standing_for = standing_for(tree);
    let place = |id: &ReactionId| {
        let (node, reaction) = (*all.get(id.index())?)?;
        Some((standing_for[node], reaction))
    };
    let mut places: Vec<_> = wanted.iter().filter_map(place).collect();
    places.sort_unstable();
    places.dedup();
    places
}

/// By node, the index in the outline of the reactor that stands for it.
fn standing_for(tree: &[Node<'_>]) -> Vec<usize> {
    fn assign(tree: &[Node<'_>], node: usize, (next, of): (&mut usize, &mut Vec<usize>)) {
        of[node] = *next;
        *next += 1;
        for bank in &tree[node].children {
            let Some((first, others)) = bank.split_first() else { continue };
            assign(tree, *first, (next, of));
            for other in others {
                same(tree, (*other, *first), of);
            }
        }
    }
    fn same(tree: &[Node<'_>], (node, first): (usize, usize), of: &mut Vec<usize>) {
        of[node] = of[first];
        let pairs = tree[node].children.iter().zip(&tree[first].children);
        for (bank, like) in pairs {
            let (Some(like), members) = (like.first(), bank) else { continue };
            for member in members {
                same(tree, (*member, *like), of);
            }
        }
    }
    let mut of = vec![0; tree.len()];
    assign(tree, 0, (&mut 0, &mut of));
    of
}

struct Sketch<'a, 't> {
    library: &'a Library,
    tree: &'t Tree<'a>,
    /// What is wrong has been reported when the instances were made.
    report: Report,
    reactors: Vec<Reactor>,
    /// By node, the reactor that stands for it, and whether it is the node's own.
    of: Vec<Option<(usize, bool)>>,
}

impl<'a> Sketch<'a, '_> {
    /// Adds the reactor of a node with what it declares itself, and the reactors that it contains.
    fn reactor(&mut self, index: usize, placed: Option<(usize, &'a Instantiation)>) -> usize {
        let node = &self.tree.nodes[index];
        let declared = &node.model.declared;
        let own = self.reactors.len();
        self.of[index] = Some((own, true));
        let name = match placed {
            Some((_, decl)) => decl.name.text.clone(),
            None => instance::name_of_main(self.library, declared.decl),
        };
        let class = declared.decl.name.as_ref().map_or(&name, |name| &name.text).clone();
        let mut drawing = drawing(&declared.decl.attributes);
        if let Some((_, decl)) = placed {
            drawing = over(self::drawing(&decl.attributes), drawing);
        }
        let parent = placed.map(|(parent, _)| parent);
        let named = |mode: &&crate::declaration::ModeNode| Mode {
            name: mode.name.as_ref().map_or_else(String::new, |name| name.text.clone()),
            initial: mode.initial,
        };
        let modes = declared.modes.iter().map(named).collect();
        let ports = declared.ports.iter().zip(&node.ports).map(|(port, channels)| Port {
            name: port.name.text.clone(),
            direction: match port.kind {
                PortKind::Input { .. } => Direction::Input,
                PortKind::Output => Direction::Output,
            },
            width: channels.width,
            drawing: self::drawing(&port.attributes),
        });
        let reactor = Reactor {
            name,
            class,
            parent,
            drawing,
            modes,
            ports: ports.collect(),
            ..Reactor::default()
        };
        self.reactors.push(reactor);
        self.events(own, index);
        for (number, instance) in declared.instances.iter().enumerate() {
            let bank = node.children[number].clone();
            let Some((first, others)) = bank.split_first() else { continue };
            let child = self.reactor(*first, Some((own, instance.decl)));
            others.iter().for_each(|member| self.of[*member] = Some((child, false)));
            let members = u32::try_from(bank.len()).unwrap_or(u32::MAX);
            let federate = (index == 0).then(|| self.federate(instance.decl, *first)).flatten();
            let drawn = &mut self.reactors[child];
            drawn.width = instance.decl.width.is_some().then_some(members);
            drawn.mode = instance.mode;
            drawn.federate = federate;
            self.reactors[own].children.push(child);
        }
        own
    }

    fn federate(&mut self, decl: &'a Instantiation, member: usize) -> Option<Federate> {
        if !self.tree.is_federated() {
            return None;
        }
        let (outer, inner) =
            (&self.tree.nodes[0].environment, &self.tree.nodes[member].environment);
        Some(Federate {
            maxwait: instance::maxwait(decl, outer, inner, &mut self.report),
            host: decl.host.as_ref().map(|host| host.text.clone()),
            transient: attributes::is_there(&decl.attributes, "transient"),
            executable: self.library.executables.contains_key(
                &self.tree.classes[self.tree.instances[self.tree.nodes[member].reactor].class],
            ),
        })
    }

    fn events(&mut self, own: usize, index: usize) {
        let node = &self.tree.nodes[index];
        let report = &mut self.report;
        let mut time = |expression: Option<&'a Expression>| -> Nanos {
            expression.and_then(|it| node.environment.time(it, report)).unwrap_or_default()
        };
        let declared = &node.model.declared;
        let mut timers = Vec::new();
        for timer in &declared.timers {
            timers.push(Timer {
                name: timer.name.text.clone(),
                offset: time(timer.decl.offset.as_ref()),
                period: time(timer.decl.period.as_ref()),
                mode: timer.mode,
                drawing: drawing(&timer.attributes),
            });
        }
        let mut actions = Vec::new();
        for action in &declared.actions {
            actions.push(Action {
                name: action.name.text.clone(),
                physical: action.physical == Some(true),
                min_delay: time(action.decl.min_delay.as_ref()),
                mode: action.mode,
                drawing: drawing(&action.attributes),
            });
        }
        self.reactors[own].timers = timers;
        self.reactors[own].actions = actions;
    }

    /// Adds the reactions and the connections of a node, when all reactors are there.
    fn contents(&mut self, own: usize, index: usize) {
        let node = &self.tree.nodes[index];
        for reaction in &node.model.reactions {
            let reaction = self.reaction(own, node, reaction);
            self.reactors[own].reactions.push(reaction);
        }
        for connection in &node.model.connections {
            let connections = self.connection(own, node, connection);
            self.reactors[own].connections.extend(connections);
        }
    }

    fn reaction(
        &mut self,
        own: usize,
        node: &Node<'a>,
        reaction: &ResolvedReaction<'a>,
    ) -> Reaction {
        let trigger = |trigger: &ResolvedTrigger| match trigger {
            ResolvedTrigger::Startup => Some(Trigger::Startup),
            ResolvedTrigger::Shutdown => Some(Trigger::Shutdown),
            ResolvedTrigger::Reset => Some(Trigger::Reset),
            ResolvedTrigger::Variable(Entity::Timer(timer)) => Some(Trigger::Timer(*timer)),
            ResolvedTrigger::Variable(Entity::Action(action)) => Some(Trigger::Action(*action)),
            ResolvedTrigger::Variable(entity) => self.end(own, node, *entity).map(Trigger::Port),
        };
        let effect = |effect: &Entity| match effect {
            Entity::Action(action) => Some(Effect::Action(*action)),
            Entity::Mode(mode, transition) => Some(Effect::Mode(*mode, *transition)),
            entity => self.end(own, node, *entity).map(Effect::Port),
        };
        let triggers = reaction.triggers.iter().filter_map(trigger).collect();
        let sources = reaction.sources.iter().filter_map(|it| self.end(own, node, *it)).collect();
        let effects = reaction.effects.iter().filter_map(effect).collect();
        let deadline = reaction.decl.deadline.as_ref();
        Reaction {
            name: reaction.name().map(str::to_owned),
            mode: reaction.mode,
            triggers,
            sources,
            effects,
            deadline: deadline.and_then(|it| node.environment.time(&it.delay, &mut self.report)),
            drawing: drawing(&reaction.decl.attributes),
        }
    }

    /// The port that a reaction or a connection of a node names.
    fn end(&self, own: usize, node: &Node<'_>, entity: Entity) -> Option<End> {
        match entity {
            Entity::Port(port) => Some(End { reactor: own, port }),
            Entity::Contained { instance, port } => {
                let first = node.children[instance].first()?;
                Some(End { reactor: self.of[*first]?.0, port })
            }
            Entity::Timer(_) | Entity::Action(_) | Entity::Mode(..) => None,
        }
    }

    /// A connection as pairs of ports that share a channel, each pair once.
    fn connection(
        &mut self,
        own: usize,
        node: &Node<'a>,
        connection: &ResolvedConnection<'a>,
    ) -> Vec<Connection> {
        let side = |ends: &[crate::model::End]| -> Vec<(End, usize)> {
            let counted = |end: &crate::model::End| {
                Some((self.end(own, node, end.entity)?, self.channels(node, *end)))
            };
            ends.iter().filter_map(counted).collect()
        };
        let (left, right) = (side(&connection.left), side(&connection.right));
        let decl = connection.decl;
        let pairs = shared(&left, &right, decl.iterated);
        let mut time = |written: &'a Expression| node.environment.time(written, &mut self.report);
        let delay = decl.delay.as_ref().and_then(&mut time);
        let absent_after =
            attributes::argument(&decl.attributes, "absent_after").and_then(&mut time);
        let drawing = drawing(&decl.attributes);
        let drawn = |(from, to)| Connection {
            from,
            to,
            physical: decl.physical,
            delay,
            absent_after,
            mode: connection.mode,
            drawing: drawing.clone(),
        };
        pairs.into_iter().map(drawn).collect()
    }

    /// How many channels one end of a connection has.
    fn channels(&self, node: &Node<'_>, end: crate::model::End) -> usize {
        let width = |ports: crate::compiled::Ports| {
            if end.channel.is_some() { 1 } else { ports.width.unwrap_or(1) as usize }
        };
        match end.entity {
            Entity::Port(port) => width(node.ports[port]),
            Entity::Contained { instance, port } => {
                let members = node.children[instance].iter().enumerate();
                let meant = members
                    .filter(|(index, _)| end.member.is_none_or(|member| member as usize == *index));
                meant.map(|(_, member)| width(self.tree.nodes[*member].ports[port])).sum()
            }
            Entity::Timer(_) | Entity::Action(_) | Entity::Mode(..) => 0,
        }
    }
}

/// The pairs of ends that share a channel if both sides are joined in order, each once.
fn shared(left: &[(End, usize)], right: &[(End, usize)], repeated: bool) -> Vec<(End, End)> {
    let mut pairs = Vec::new();
    let mut from = 0;
    let mut free = left.first().map_or(0, |(_, channels)| *channels);
    let total: usize = left.iter().map(|(_, channels)| channels).sum();
    if total == 0 {
        return pairs;
    }
    for (to, channels) in right {
        let mut open = *channels;
        while open > 0 {
            if free == 0 {
                from += 1;
                if from == left.len() {
                    if !repeated {
                        return pairs;
                    }
                    from = 0;
                }
                free = left[from].1;
                continue;
            }
            let pair = (left[from].0, *to);
            if !pairs.contains(&pair) {
                pairs.push(pair);
            }
            let joined = open.min(free);
            open -= joined;
            free -= joined;
        }
    }
    pairs
}

/// What the attributes say about how something is drawn.
fn drawing(attributes: &[Attribute]) -> Drawing {
    let text =
        |attribute: &Attribute, place: usize| match &attribute.arguments.get(place)?.value.kind {
            ExpressionKind::String(text) => Some(text.clone()),
            _ => None,
        };
    let stated = |name: &str| text(attributes::find(attributes, name)?, 0);
    let is_layout = |it: &&Attribute| it.name.text.eq_ignore_ascii_case("layout");
    let option = |it: &Attribute| {
        // Stated by name, they may come in any order.
        let swapped = it.arguments.first().and_then(|first| first.name.as_ref());
        let swapped = usize::from(swapped.is_some_and(|name| name.text == "value"));
        Some((text(it, swapped)?, text(it, 1 - swapped)?))
    };
    Drawing {
        label: stated("label"),
        icon: stated("icon"),
        side: stated("side").map(|side| side.to_ascii_lowercase()),
        layout: attributes.iter().filter(is_layout).filter_map(option).collect(),
    }
}

/// What an instance says comes before what its class says.
fn over(instance: Drawing, class: Drawing) -> Drawing {
    Drawing {
        label: instance.label.or(class.label),
        icon: instance.icon.or(class.icon),
        side: instance.side.or(class.side),
        layout: class.layout.into_iter().chain(instance.layout).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::{End, shared};

    #[test]
    fn ends_share_channels_in_the_order_of_both_sides() {
        let end = |reactor| End { reactor, port: 0 };
        let pairs = |left: &[usize], right: &[usize], repeated| -> Vec<(usize, usize)> {
            let side = |widths: &[usize], first: usize| -> Vec<_> {
                widths.iter().enumerate().map(|(at, width)| (end(first + at), *width)).collect()
            };
            let pairs = shared(&side(left, 0), &side(right, 10), repeated);
            pairs.iter().map(|(from, to)| (from.reactor, to.reactor)).collect()
        };
        assert_eq!(pairs(&[1, 1], &[1, 1], false), [(0, 10), (1, 11)]);
        assert_eq!(pairs(&[4], &[1, 3], false), [(0, 10), (0, 11)]);
        assert_eq!(pairs(&[1, 3], &[4], false), [(0, 10), (1, 10)]);
        assert_eq!(pairs(&[1], &[4, 2], true), [(0, 10), (0, 11)]);
        assert_eq!(pairs(&[1], &[4, 2], false), [(0, 10)]);
        assert_eq!(pairs(&[0], &[4], true), []);
    }
}
