//! Attributes: which exist, where they belong, and which take a value.

use hprm_core::{Bound, Overflow};

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
    Connection { physical: bool },
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
    let federated = declared.decl.kind == ReactorKind::Federated;
    for attribute in elsewhere {
        attribute_fits(attribute, Place::Elsewhere, federated, report);
    }
    for attribute in instances {
        attribute_fits(attribute, Place::Instance, federated, report);
    }
    for connection in &declared.connections {
        let place = Place::Connection { physical: connection.physical };
        for attribute in &connection.attributes {
            attribute_fits(attribute, place, federated, report);
        }
    }
}

fn attribute_fits(attribute: &Attribute, place: Place, federated: bool, report: &mut Report) {
    let name = attribute.name.text.to_ascii_lowercase();
    match name.as_str() {
        name if DRAWING.contains(&name) => drawing(attribute, name, report),
        "maxwait" | "absent_after" => wait(attribute, &name, place, federated, report),
        "bound" => bounded(attribute, place, report),
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
        let known = DRAWING.into_iter().chain(["maxwait", "absent_after", "bound", "transient"]);
        existing(name, "attributes", known)
    };
    report.add(Diagnostic::error("LF0211", attribute.span, message).hint(hint));
}

/// How long to wait for inputs: of a federate, or of one connection between two.
fn wait(attribute: &Attribute, name: &str, place: Place, federated: bool, report: &mut Report) {
    let on_connection = matches!(place, Place::Connection { .. });
    let (is_home, description) = match name {
        "maxwait" => (place == Place::Instance, "an instance"),
        _ => (on_connection, "a connection"),
    };
    if federated && on_connection && name == "maxwait" {
        report.add(
            Diagnostic::warning("LF0220", attribute.span, "`@maxwait` has no effect here")
                .hint("write it at the instance, or `@absent_after` at the connection"),
        );
    } else if !federated || !is_home {
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

/// How many messages of a physical connection may wait, and what becomes of one that is too many.
fn bounded(attribute: &Attribute, place: Place, report: &mut Report) {
    if !matches!(place, Place::Connection { physical: true }) {
        let message = "`@bound` does not belong here";
        report.add(
            Diagnostic::error("LF0212", attribute.span, message)
                .hint("it belongs to a physical connection: `~>`"),
        );
    } else if read_bound(attribute).is_none() {
        let message = "`@bound` takes a number of messages, and what to do when more arrive";
        report.add(
            Diagnostic::error("LF0212", attribute.span, message)
                .hint("write `@bound(10, \"replace\")`, or \"drop\" to keep the first 10"),
        );
    }
}

fn read_bound(attribute: &Attribute) -> Option<Bound> {
    let (number, policy) = match attribute.arguments.as_slice() {
        [number] => (number, "drop"),
        [number, Expression { kind: ExpressionKind::String(policy), .. }] => (number, &**policy),
        _ => return None,
    };
    let ExpressionKind::Integer(messages) = number.kind else { return None };
    let overflow = match policy {
        "drop" => Overflow::Drop,
        "replace" => Overflow::Replace,
        _ => return None,
    };
    let messages = u32::try_from(messages).ok().filter(|messages| *messages > 0)?;
    Some(Bound { messages, overflow })
}

/// The bound that is among `attributes`, if it is right.
pub(crate) fn bound(attributes: &[Attribute]) -> Option<Bound> {
    let named = |attribute: &&Attribute| attribute.name.text.eq_ignore_ascii_case("bound");
    attributes.iter().find(named).and_then(read_bound)
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
