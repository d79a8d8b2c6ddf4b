//! Reaction instances: what the scheduler needs to know of each, and what its Python function gets.

use std::collections::{BTreeMap, BTreeSet};

use hprm_core::{Effect, PortId, ReactionSpec, Trigger};

use crate::compiled::{Access, Argument, ContainedPort, Ports};
use crate::connections;
use crate::declaration::PortKind;
use crate::diagnostic::Report;
use crate::instance::{Node, Tree};
use crate::legacy::Waits;
use crate::model::{self, End, Entity, Held, Model, Role, Slot};

/// The reaction `reaction` of `node`, for the scheduler.
pub(crate) fn spec<'a>(
    tree: &Tree<'a>,
    node: &Node<'a>,
    reaction: &model::ResolvedReaction<'a>,
    report: &mut Report,
) -> ReactionSpec {
    let mut spec =
        ReactionSpec { label: reaction.name().map(Into::into), ..ReactionSpec::default() };
    for trigger in &reaction.triggers {
        match trigger {
            model::ResolvedTrigger::Startup => spec.triggers.push(Trigger::Startup),
            model::ResolvedTrigger::Shutdown => spec.triggers.push(Trigger::Shutdown),
            model::ResolvedTrigger::Reset => spec.triggers.push(Trigger::Reset),
            model::ResolvedTrigger::Variable(Entity::Action(action)) => {
                spec.triggers.push(Trigger::Action(node.actions[*action]));
            }
            model::ResolvedTrigger::Variable(Entity::Timer(timer)) => {
                spec.triggers.push(Trigger::Timer(node.timers[*timer]));
            }
            model::ResolvedTrigger::Variable(entity) => {
                let ports = named(tree, node, (reaction, Role::Trigger), *entity, report);
                spec.triggers.extend(ports.into_iter().map(Trigger::Port));
            }
        }
    }
    for source in &reaction.sources {
        spec.sources.extend(named(tree, node, (reaction, Role::Source), *source, report));
    }
    for effect in &reaction.effects {
        match effect {
            Entity::Action(action) => spec.effects.push(Effect::Action(node.actions[*action])),
            Entity::Mode(mode, transition) => {
                spec.effects.push(Effect::Mode(node.modes[*mode], *transition));
            }
            port => {
                let ports = named(tree, node, (reaction, Role::Effect), *port, report);
                spec.effects.extend(ports.into_iter().map(Effect::Port));
            }
        }
    }
    let deadline = reaction.decl.deadline.as_ref();
    spec.deadline = deadline.and_then(|d| node.environment.time(&d.delay, report));
    spec.handles_tardy = reaction.decl.late.is_some();
    spec
}

/// Notes the time of `STP(t)` or `STAA(t)` for every port that the reaction reads.
pub(crate) fn note_wait<'a>(
    tree: &Tree<'a>,
    node: &Node<'a>,
    reaction: &model::ResolvedReaction<'a>,
    waits: &mut Waits,
    report: &mut Report,
) {
    let written = reaction.decl.late.as_ref().and_then(|late| late.wait.as_ref());
    let Some(wait) = written.and_then(|written| node.environment.time(written, report)) else {
        return;
    };
    for entity in reaction.reads() {
        for port in whole(tree, node, (reaction, entity), report) {
            waits.add(port, wait);
        }
    }
}

/// The channels that a reaction names: those of the members that it says, or all.
fn named<'a>(
    tree: &Tree<'a>,
    node: &Node<'a>,
    (reaction, role): (&model::ResolvedReaction<'a>, Role),
    entity: Entity,
    report: &mut Report,
) -> Vec<PortId> {
    match reaction.ends.get(&(role, entity)) {
        Some(ends) => {
            ends.values().flat_map(|end| connections::channels(tree, node, *end, report)).collect()
        }
        None => whole(tree, node, (reaction, entity), report),
    }
}

/// All channels of a port that the reaction names: of a contained one, in all members of its bank.
fn whole<'a>(
    tree: &Tree<'a>,
    node: &Node<'a>,
    (reaction, entity): (&model::ResolvedReaction<'a>, Entity),
    report: &mut Report,
) -> Vec<PortId> {
    connections::channels(tree, node, End::whole(entity, reaction.decl.header), report)
}

/// What the Python function of the reaction gets, by slot.
pub(crate) fn arguments<'a>(
    tree: &Tree<'a>,
    node: &Node<'a>,
    reaction: &model::ResolvedReaction<'a>,
) -> Vec<Argument> {
    let declared = &node.model.declared;
    let effects: BTreeSet<Entity> = reaction.effects.iter().copied().collect();
    let access = |entity: Entity| {
        if effects.contains(&entity) { Access::Write } else { Access::Read }
    };
    let mut mentioned: BTreeMap<usize, Vec<(usize, Access)>> = BTreeMap::new();
    for entity in reaction.mentions() {
        if let Entity::Contained { instance, port } = entity {
            mentioned.entry(instance).or_default().push((port, access(entity)));
        }
    }
    let argument = |slot: &Slot| {
        let name = slot.name.clone();
        match slot.holds {
            Held::Port(index) => Argument::Port {
                name,
                ports: node.ports[index],
                access: access(Entity::Port(index)),
                mutable: declared.ports[index].kind == PortKind::Input { mutable: true },
            },
            Held::Action(index) => Argument::Action { name, action: node.actions[index] },
            Held::Mode(index, transition) => {
                Argument::Mode { name, mode: node.modes[index], transition }
            }
            Held::Instance(instance) => Argument::Contained {
                name,
                bank: declared.instances[instance].decl.width.is_some(),
                members: members(tree, node, instance, mentioned.get(&instance)),
            },
            Held::Alias { instance, port } => Argument::Alias {
                name,
                instance: declared.instances[instance].decl.name.text.clone(),
                port: port_name(model_of(tree, node, instance), port),
            },
        }
    };
    reaction.slots.iter().map(argument).collect()
}

fn members<'a>(
    tree: &Tree<'a>,
    node: &Node<'a>,
    instance: usize,
    mentioned: Option<&Vec<(usize, Access)>>,
) -> Vec<Vec<ContainedPort>> {
    let member = |index: &usize| {
        let member = &tree.nodes[*index];
        let port = |(port, access): &(usize, Access)| {
            let ports: Ports = member.ports[*port];
            ContainedPort { name: port_name(member.model, *port), ports, access: *access }
        };
        mentioned.into_iter().flatten().map(port).collect()
    };
    node.children[instance].iter().map(member).collect()
}

fn model_of<'a>(tree: &Tree<'a>, node: &Node<'a>, instance: usize) -> &'a Model<'a> {
    // A bank has at least one member.
    tree.nodes[node.children[instance][0]].model
}

fn port_name(model: &Model<'_>, port: usize) -> String {
    model.declared.ports[port].name.text.clone()
}
