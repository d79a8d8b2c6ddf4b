//! The parameters of a reaction's Python function: which there are, in which order, and what they
//! are called.
//!
//! Triggers come first, then sources, then effects, each once. A contained instance is one
//! parameter with its ports as attributes; each of those ports is a variable of its own as well,
//! unless something else has that name. What the reaction calls by another name (`port as name`)
//! comes last, in addition.

use std::collections::{BTreeMap, BTreeSet};

use crate::declaration;
use crate::diagnostic::{Diagnostic, Report};
use crate::model::{Declarations, Entity, Held, ResolvedReaction, Slot};

/// The slots of `reaction`; `ports_of` knows the ports of a contained instance.
pub(crate) fn slots<'p, 'a: 'p>(
    declared: &Declarations<'a>,
    ports_of: impl Fn(usize) -> &'p [&'a declaration::PortNode],
    reaction: &ResolvedReaction<'_>,
    report: &mut Report,
) -> Vec<Slot> {
    let mut slots: Vec<Slot> = Vec::new();
    let mut instances = BTreeSet::new();
    for entity in reaction.mentions() {
        match entity {
            Entity::Port(port) => {
                let name = declared.ports[port].name.text.clone();
                slots.push(Slot { name, holds: Held::Port(port) });
            }
            Entity::Action(action) => {
                let name = declared.actions[action].name.text.clone();
                slots.push(Slot { name, holds: Held::Action(action) });
            }
            Entity::Timer(_) => {}
            Entity::Mode(mode, transition) => {
                if let Some(name) = &declared.modes[mode].name {
                    let holds = Held::Mode(mode, transition);
                    slots.push(Slot { name: name.text.clone(), holds });
                }
            }
            Entity::Contained { instance, port } => {
                let decl = declared.instances[instance].decl;
                let holds = Held::Instance(instance);
                if instances.insert(instance) {
                    slots.push(Slot { name: decl.name.text.clone(), holds });
                }
                if decl.width.is_none() {
                    let port_name = &ports_of(instance)[port].name.text;
                    let name = format!("{}_{port_name}", decl.name.text);
                    slots.push(Slot { name, holds: Held::Alias { instance, port } });
                }
            }
        }
    }
    for (entity, alias) in &reaction.aliases {
        let holds = match *entity {
            Entity::Port(port) => Held::Port(port),
            Entity::Action(action) => Held::Action(action),
            Entity::Contained { instance, port } => Held::Alias { instance, port },
            // Other names for these have been refused.
            Entity::Timer(_) | Entity::Mode(..) => continue,
        };
        let slot = Slot { name: alias.text.clone(), holds };
        if !slots.contains(&slot) {
            slots.push(slot);
        }
    }
    without_clashes(slots, reaction, report)
}

/// A name that is not in the program text, `instance_port`, is dropped if another slot has that name; two
/// other slots of one name are an error.
fn without_clashes(
    slots: Vec<Slot>,
    reaction: &ResolvedReaction<'_>,
    report: &mut Report,
) -> Vec<Slot> {
    let written: BTreeSet<&str> =
        reaction.aliases.iter().map(|(_, name)| name.text.as_str()).collect();
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    for slot in &slots {
        *counts.entry(slot.name.clone()).or_default() += 1;
    }
    let mut taken = BTreeSet::new();
    let mut kept = Vec::new();
    for slot in slots {
        let rivals = counts.get(&slot.name).is_some_and(|count| *count > 1);
        if rivals && slot.is_alias() && !written.contains(slot.name.as_str()) {
            continue;
        }
        if !taken.insert(slot.name.clone()) {
            let message = format!("two things are called `{}` in this reaction", slot.name);
            report.add(
                Diagnostic::error("LF0215", reaction.decl.header, message)
                    .hint("rename the instance, the port, the action or the mode"),
            );
        }
        kept.push(slot);
    }
    kept
}
