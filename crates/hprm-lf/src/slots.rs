//! The parameters of a reaction's Python function: which there are, in which order, and what they
//! are called.
//!
//! Triggers come first, then sources, then effects, each once. A contained instance is one
//! parameter with its ports as attributes; each of those ports is a variable of its own as well,
//! unless something else has that name.

use crate::ast;
use crate::diagnostic::{Diagnostic, Report};
use crate::model::{Declarations, Entity, Held, Reaction, Slot};

/// The slots of `reaction`; `ports_of` knows the ports of a contained instance.
pub(crate) fn slots<'p, 'a: 'p>(
    declared: &Declarations<'a>,
    ports_of: impl Fn(usize) -> &'p [&'a ast::Port],
    reaction: &Reaction<'_>,
    report: &mut Report,
) -> Vec<Slot> {
    let mut slots: Vec<Slot> = Vec::new();
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
                if !slots.iter().any(|slot| slot.holds == holds) {
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
    without_clashes(slots, reaction.decl, report)
}

/// An alias gives way to any other slot of its name; two others of one name are an error.
fn without_clashes(slots: Vec<Slot>, decl: &ast::Reaction, report: &mut Report) -> Vec<Slot> {
    let mut kept = Vec::new();
    for slot in &slots {
        let mut rivals = slots.iter().filter(|other| *other != slot && other.name == slot.name);
        if slot.is_alias() && rivals.next().is_some() {
            continue;
        }
        if kept.iter().any(|earlier: &Slot| earlier.name == slot.name) {
            let message = format!("two things are called `{}` in this reaction", slot.name);
            report.add(
                Diagnostic::error("LF0215", decl.header, message)
                    .hint("rename the instance, the port, the action or the mode"),
            );
        }
        kept.push(slot.clone());
    }
    kept
}
