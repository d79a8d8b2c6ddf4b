//! Attributes: which exist, where they belong, and which take a value.

use crate::ast::{Attribute, Expression, ExpressionKind, ReactorKind};
use crate::diagnostic::{Diagnostic, Report, existing};
use crate::model::Model;

/// For diagrams only: accepted anywhere and without effect, if its arguments are strings.
const DRAWING: [&str; 4] = ["icon", "label", "layout", "side"];

const SIDES: [&str; 4] = ["north", "east", "south", "west"];

/// Known to the language, and not there yet.
const UNSUPPORTED: [&str; 1] = ["enclave"];

/// For other tools and targets.
const WITHOUT_EFFECT: [&str; 2] = ["property", "sparse"];

/// Attributes of targets without target properties, which are target properties here.
const PROPERTIES: [&str; 7] =
    ["build_type", "clock_sync", "fast", "keepalive", "logging", "platform", "timeout"];

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
    match name.as_str() {
        name if DRAWING.contains(&name) => drawing(attribute, name, report),
        "maxwait" | "absent_after" => wait(attribute, &name, place, federated, report),
        "transient" if place != Place::Instance || !federated => {
            report.add(misplaced(attribute, &name, "an instance"));
        }
        "transient" => flag(attribute, &name, report),
        name if UNSUPPORTED.contains(&name) => {
            let what = format!("the attribute `@{name}` is");
            report.add(Diagnostic::unsupported(attribute.span, &what, "remove it"));
        }
        name if WITHOUT_EFFECT.contains(&name) => {
            let message = format!("`@{name}` has no effect");
            report.add(Diagnostic::warning("LF0220", attribute.span, message).hint("remove it"));
        }
        _ => unknown(attribute, &name, report),
    }
}

fn misplaced(attribute: &Attribute, name: &str, home: &str) -> Diagnostic {
    let message = format!("`@{name}` does not belong here");
    Diagnostic::error("LF0212", attribute.span, message)
        .hint(format!("it belongs to {home} of a federated reactor"))
}

fn unknown(attribute: &Attribute, name: &str, report: &mut Report) {
    let message = format!("there is no attribute `@{}`", attribute.name.text);
    let hint = if PROPERTIES.contains(&name) {
        let property = name.replace('_', "-");
        format!("write it as a target property: `target Python {{ {property}: ... }}`")
    } else {
        let known = DRAWING.into_iter().chain(["maxwait", "absent_after", "transient"]);
        existing(name, "attributes", known)
    };
    report.add(Diagnostic::error("LF0211", attribute.span, message).hint(hint));
}

/// How long to wait for inputs: of a federate, or of one connection between two.
fn wait(attribute: &Attribute, name: &str, place: Place, federated: bool, report: &mut Report) {
    let (home, description) = match name {
        "maxwait" => (Place::Instance, "an instance"),
        _ => (Place::Connection, "a connection"),
    };
    if federated && place == Place::Connection && name == "maxwait" {
        report.add(
            Diagnostic::warning("LF0220", attribute.span, "`@maxwait` has no effect here")
                .hint("write it at the instance, or `@absent_after` at the connection"),
        );
    } else if !federated || place != home {
        report.add(misplaced(attribute, name, description));
    }
    if attribute.arguments.len() != 1 {
        let message = format!("`@{name}` takes one time");
        report.add(
            Diagnostic::error("LF0212", attribute.name.span, message)
                .hint(format!("write `@{name}(10 ms)`")),
        );
    }
}

/// An attribute that says all by its name.
fn flag(attribute: &Attribute, name: &str, report: &mut Report) {
    if !attribute.arguments.is_empty() {
        let message = format!("`@{name}` takes no argument");
        let diagnostic = Diagnostic::error("LF0212", attribute.span, message);
        report.add(diagnostic.hint(format!("write `@{name}`")));
    }
}

fn drawing(attribute: &Attribute, name: &str, report: &mut Report) {
    let text = |argument: &Expression| match &argument.kind {
        ExpressionKind::String(text) => Some(text.clone()),
        _ => None,
    };
    let texts: Option<Vec<String>> = attribute.arguments.iter().map(text).collect();
    let (right, form) = match (name, texts.as_deref()) {
        ("layout", texts) => (texts.is_some(), "option=\"name\", value=\"value\""),
        ("side", Some([side])) => (SIDES.contains(&side.to_ascii_lowercase().as_str()), "north"),
        (_, Some([_])) => (true, ""),
        ("side", _) => (false, "north"),
        _ => (false, "..."),
    };
    if !right {
        let form = if name == "layout" { form.to_owned() } else { format!("\"{form}\"") };
        let what = if name == "side" { "one of the four sides" } else { "text in double quotes" };
        let message = format!("`@{name}` takes {what}");
        report.add(
            Diagnostic::error("LF0212", attribute.span, message)
                .hint(format!("write `@{name}({form})`")),
        );
    }
}

/// Whether the attribute `name` is among `attributes`.
pub(crate) fn is_there(attributes: &[Attribute], name: &str) -> bool {
    attributes.iter().any(|attribute| attribute.name.text.eq_ignore_ascii_case(name))
}

/// The time of the attribute `name`, if it is among `attributes`.
pub(crate) fn argument<'a>(attributes: &'a [Attribute], name: &str) -> Option<&'a Expression> {
    let named = |attribute: &&Attribute| attribute.name.text.eq_ignore_ascii_case(name);
    attributes.iter().find(named)?.arguments.first()
}
