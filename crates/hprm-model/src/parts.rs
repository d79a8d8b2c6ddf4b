//! The parts of a reactor as bodies know them: for messages on names that a body has wrong.

use crate::check::Models;
use crate::compiled::ReactorPart;
use crate::declaration::{self, PortKind};
use crate::model::{Declarations, Entity, Held, Model, ResolvedInstance, ResolvedReaction, Slot};

/// What a class declares beside parameters, state variables and methods.
pub(crate) fn of_class(declared: &Declarations<'_>, models: &Models<'_>) -> Vec<ReactorPart> {
    let part =
        |name: &declaration::Name, kind| ReactorPart { name: name.text.clone(), kind, class: None };
    let ports = declared.ports.iter().map(|port| part(&port.name, kind_of(port)));
    let actions = declared.actions.iter().map(|action| part(&action.name, "action"));
    let timers = declared.timers.iter().map(|timer| part(&timer.name, "timer"));
    let modes = declared.modes.iter().filter_map(|mode| Some(part(mode.name.as_ref()?, "mode")));
    let instances = declared.instances.iter().map(|instance| ReactorPart {
        name: instance.decl.name.text.clone(),
        kind: kind_of_instance(instance),
        class: models[instance.class.0].as_ref().map(|model| {
            let ports = model.declared.ports.iter();
            let ports = ports.map(|port| (port.name.text.clone(), kind_of(port)));
            (instance.decl.class.text.clone(), ports.collect())
        }),
    });
    ports.chain(actions).chain(timers).chain(modes).chain(instances).collect()
}

/// What the arguments of a reaction are.
pub(crate) fn kinds(
    model: &Model<'_>,
    models: &Models<'_>,
    reaction: &ResolvedReaction<'_>,
) -> Vec<&'static str> {
    let declared = &model.declared;
    let kind = |slot: &Slot| match slot.holds {
        Held::Port(index) => match declared.ports[index].kind {
            PortKind::Output => "output",
            PortKind::Input { mutable: true } => "mutable",
            _ if reaction.variables().any(|entity| entity == Entity::Port(index)) => "input",
            PortKind::Input { .. } => "source",
        },
        Held::Action(_) => "action",
        Held::Mode(..) => "mode",
        Held::Instance(index) => kind_of_instance(&declared.instances[index]),
        // What is set there is an input, and what is read an output.
        Held::Alias { instance, port } => {
            match contained(declared, models, (instance, port)).map(kind_of) {
                Some("input") => "output",
                _ => "input",
            }
        }
    };
    reaction.slots.iter().map(kind).collect()
}

/// The ports of contained reactors that a reaction names.
pub(crate) fn named(
    model: &Model<'_>,
    models: &Models<'_>,
    reaction: &ResolvedReaction<'_>,
) -> Vec<String> {
    let declared = &model.declared;
    let name = |entity| match entity {
        Entity::Contained { instance, port } => {
            let name = &declared.instances[instance].decl.name.text;
            let port = contained(declared, models, (instance, port))?;
            Some(format!("{name}.{}", port.name.text))
        }
        _ => None,
    };
    reaction.mentions().into_iter().filter_map(name).collect()
}

fn contained<'a>(
    declared: &Declarations<'a>,
    models: &'a Models<'a>,
    (instance, port): (usize, usize),
) -> Option<&'a declaration::PortNode> {
    let class = declared.instances[instance].class;
    models[class.0].as_ref().map(|model| model.declared.ports[port])
}

fn kind_of(port: &declaration::PortNode) -> &'static str {
    match port.kind {
        PortKind::Output => "output",
        PortKind::Input { .. } => "input",
    }
}

fn kind_of_instance(instance: &ResolvedInstance<'_>) -> &'static str {
    if instance.decl.width.is_some() { "bank" } else { "instance" }
}
