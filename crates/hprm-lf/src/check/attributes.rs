//! Attributes: which exist, where they belong, and which take a value.

use crate::ast::{Attribute, Expression, ReactorKind};
use crate::diagnostic::{Diagnostic, Report, existing};
use crate::model::Model;

/// For diagrams only: accepted anywhere and without effect.
const DRAWING: [&str; 4] = ["icon", "label", "layout", "side"];

/// Known to the language, without effect in this target or not yet there.
const UNSUPPORTED: [&str; 4] = ["enclave", "property", "sparse", "transient"];

/// Where an attribute stands.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Place {
    Instance,
    Connection,
    Elsewhere,
}

pub(super) fn check(model: &Model<'_>, report: &mut Report) {
    let declared = &model.declared;
    let elsewhere = declared
        .decl
        .attributes
        .iter()
        .chain(declared.parameters.iter().flat_map(|parameter| &parameter.attributes))
        .chain(declared.states.iter().flat_map(|state| &state.attributes))
        .chain(declared.ports.iter().flat_map(|port| &port.attributes))
        .chain(declared.timers.iter().flat_map(|timer| &timer.attributes))
        .chain(declared.actions.iter().flat_map(|action| &action.attributes))
        .chain(declared.reactions.iter().flat_map(|reaction| &reaction.attributes));
    let instances = declared.instances.iter().flat_map(|instance| &instance.decl.attributes);
    let connections = declared.connections.iter().flat_map(|connection| &connection.attributes);
    let federated = declared.decl.kind == ReactorKind::Federated;
    for attribute in elsewhere {
        attribute_fits(attribute, Place::Elsewhere, federated, report);
    }
    for attribute in instances {
        attribute_fits(attribute, Place::Instance, federated, report);
    }
    for attribute in connections {
        attribute_fits(attribute, Place::Connection, federated, report);
    }
}

fn attribute_fits(attribute: &Attribute, place: Place, federated: bool, report: &mut Report) {
    let name = attribute.name.text.to_ascii_lowercase();
    let span = attribute.span;
    let right_place = match name.as_str() {
        name if DRAWING.contains(&name) => return,
        "maxwait" => place == Place::Instance,
        "absent_after" => place == Place::Connection,
        name if UNSUPPORTED.contains(&name) => {
            let what = format!("the attribute `@{name}` is");
            report.add(Diagnostic::unsupported(span, &what, "remove it"));
            return;
        }
        _ => {
            let message = format!("there is no attribute `@{}`", attribute.name.text);
            let known = DRAWING.into_iter().chain(["maxwait", "absent_after"]);
            let hint = existing(&name, "attributes", known);
            report.add(Diagnostic::error("LF0211", span, message).hint(hint));
            return;
        }
    };
    if !right_place || !federated {
        let home = if name == "maxwait" { "an instance" } else { "a connection" };
        let message = format!("`@{name}` does not belong here");
        report.add(
            Diagnostic::error("LF0212", span, message)
                .hint(format!("it belongs to {home} of a federated reactor")),
        );
    }
    if attribute.arguments.len() != 1 {
        let message = format!("`@{name}` takes one time");
        report.add(
            Diagnostic::error("LF0212", attribute.name.span, message)
                .hint(format!("write `@{name}(10 ms)`")),
        );
    }
}

/// The time of the attribute `name`, if it is among `attributes`.
pub(crate) fn argument<'a>(attributes: &'a [Attribute], name: &str) -> Option<&'a Expression> {
    let named = |attribute: &&Attribute| attribute.name.text.eq_ignore_ascii_case(name);
    attributes.iter().find(named)?.arguments.first()
}
