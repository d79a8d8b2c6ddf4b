//! Attributes: which exist, where they belong, and which take a value.

use std::collections::{BTreeMap, BTreeSet};

use hprm_core::{Bound, Overflow};

use crate::declaration::{Attribute, AttributeArgument, Expression, ExpressionKind, ReactorKind};
use crate::diagnostic::{Diagnostic, Report, existing};
use crate::executable::ATTRIBUTE;
use crate::model::Model;
use crate::syntax::Syntax;

use super::restart;

/// For diagrams only: accepted anywhere and without effect, if its arguments are strings.
const DRAWING: [&str; 4] = ["icon", "label", "layout", "side"];

const SIDES: [&str; 4] = ["north", "east", "south", "west"];

/// What changes how a program runs.
const OBEYED: [&str; 7] =
    ["maxwait", "absent_after", "bound", "compress", "transient", restart::ATTRIBUTE, ATTRIBUTE];

/// Known to the language, and not there yet.
const UNSUPPORTED: [&str; 1] = ["enclave"];

/// For other tools and targets.
const WITHOUT_EFFECT: [&str; 2] = ["property", "sparse"];

/// Attributes of targets without target properties, which are target properties here.
const PROPERTIES: [&str; 7] =
    ["build_type", "clock_sync", "fast", "keepalive", "logging", "platform", "timeout"];

/// One thing may have several of these.
const REPEATABLE: [&str; 2] = ["layout", "property"];

/// The names of the arguments of an attribute, in their order.
fn names_of(attribute: &str) -> &'static [&'static str] {
    match attribute {
        "bound" => &["n", "policy"],
        "layout" => &["option", "value"],
        restart::ATTRIBUTE => &restart::ARGUMENTS,
        "transient" | "compress" => &[],
        _ => &["value"],
    }
}

/// Where an attribute stands.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Place {
    Reactor,
    Instance,
    Connection { physical: bool },
    Elsewhere,
}

pub(super) fn check(model: &Model<'_>, report: &mut Report) {
    let declared = &model.declared;
    let elsewhere = declared
        .parameters
        .iter()
        .flat_map(|parameter| &parameter.attributes)
        .chain(declared.states.iter().flat_map(|state| &state.attributes))
        .chain(declared.ports.iter().flat_map(|port| &port.attributes))
        .chain(declared.timers.iter().flat_map(|timer| &timer.attributes))
        .chain(declared.actions.iter().flat_map(|action| &action.attributes))
        .chain(declared.reactions.iter().flat_map(|reaction| &reaction.attributes));
    let instances = declared.instances.iter().flat_map(|instance| &instance.decl.attributes);
    let federated = declared.decl.kind == ReactorKind::Federated;
    for attribute in &declared.decl.attributes {
        attribute_fits(attribute, Place::Reactor, federated, report);
    }
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
    stated_once(&declared.decl.attributes, report);
    for instance in &declared.instances {
        stated_once(&instance.decl.attributes, report);
        if federated {
            restart::needs_transient(&instance.decl.attributes, report);
        }
    }
    for connection in &declared.connections {
        stated_once(&connection.attributes, report);
    }
}

/// Reports attributes that one thing has twice: of a second time, nothing would be obeyed.
fn stated_once(attributes: &[Attribute], report: &mut Report) {
    let mut first: BTreeMap<String, &Attribute> = BTreeMap::new();
    for attribute in attributes {
        let name = attribute.name.text.to_ascii_lowercase();
        if REPEATABLE.contains(&&*name) {
            continue;
        }
        if let Some(first) = first.get(&name) {
            let message = format!("`@{name}` is stated twice");
            report.add(
                Diagnostic::error("LF0212", attribute.span, message)
                    .label(first.span, "the first time")
                    .hint("remove one of the two"),
            );
        }
        first.entry(name).or_insert(attribute);
    }
}

fn attribute_fits(attribute: &Attribute, place: Place, federated: bool, report: &mut Report) {
    let name = attribute.name.text.to_ascii_lowercase();
    let is_obeyed = (OBEYED.contains(&&*name) && name != ATTRIBUTE) || DRAWING.contains(&&*name);
    if is_obeyed && !arguments_are_known(attribute, &name, report) {
        return;
    }
    match name.as_str() {
        name if DRAWING.contains(&name) => drawing(attribute, name, report),
        "maxwait" | "absent_after" => wait(attribute, &name, place, federated, report),
        // What it states has been read before.
        ATTRIBUTE if place == Place::Reactor => {}
        ATTRIBUTE => {
            let message = format!("{} does not belong here", report.syntax().option(&name));
            report.add(
                Diagnostic::error("LF0212", attribute.span, message)
                    .hint("it belongs to a reactor, which states its ports only"),
            );
        }
        "bound" => bounded(attribute, place, report),
        "compress" if !federated || !matches!(place, Place::Connection { .. }) => {
            report.add(misplaced(attribute, &name, true, report.syntax()));
        }
        "transient" | restart::ATTRIBUTE if place != Place::Instance || !federated => {
            report.add(misplaced(attribute, &name, false, report.syntax()));
        }
        restart::ATTRIBUTE => restart::check(attribute, report),
        "transient" | "compress" => flag(attribute, &name, report),
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

/// Whether all named arguments have names that the attribute knows, each once; what is wrong is reported.
fn arguments_are_known(attribute: &Attribute, name: &str, report: &mut Report) -> bool {
    let known = names_of(name);
    let mut taken = BTreeSet::new();
    for (place, argument) in attribute.arguments.iter().enumerate() {
        let Some(stated) = &argument.name else {
            taken.extend(known.get(place));
            continue;
        };
        let Some(index) = known.iter().position(|known| *known == stated.text) else {
            let message = format!("`@{name}` has no argument `{}`", stated.text);
            let hint = existing(&stated.text, "its arguments", known.iter().copied());
            report.add(Diagnostic::error("LF0212", stated.span, message).hint(hint));
            return false;
        };
        if !taken.insert(known[index]) {
            let message = format!("the argument `{}` is stated twice", stated.text);
            report.add(Diagnostic::error("LF0212", stated.span, message));
            return false;
        }
    }
    true
}

/// The value of an argument, which has a name or stands in its place.
pub(super) fn value_of<'a>(attribute: &'a Attribute, argument: &str) -> Option<&'a Expression> {
    let names = names_of(&attribute.name.text.to_ascii_lowercase());
    let of = |(place, stated): (usize, &'a AttributeArgument)| {
        let name = stated.name.as_ref().map(|name| &*name.text);
        (name.or(names.get(place).copied()) == Some(argument)).then_some(&stated.value)
    };
    attribute.arguments.iter().enumerate().find_map(of)
}

fn misplaced(attribute: &Attribute, name: &str, on_connection: bool, syntax: Syntax) -> Diagnostic {
    let message = format!("{} does not belong here", syntax.option(name));
    Diagnostic::error("LF0212", attribute.span, message).hint(syntax.home(on_connection))
}

fn unknown(attribute: &Attribute, name: &str, report: &mut Report) {
    let message = format!("there is no attribute `@{}`", attribute.name.text);
    let hint = if PROPERTIES.contains(&name) {
        let property = name.replace('_', "-");
        format!("write it as a target property: `target Python {{ {property}: ... }}`")
    } else {
        let known = DRAWING.into_iter().chain(OBEYED);
        existing(name, "attributes", known)
    };
    report.add(Diagnostic::error("LF0211", attribute.span, message).hint(hint));
}

/// How long to wait for inputs: of a federate, or of one connection between two.
fn wait(attribute: &Attribute, name: &str, place: Place, federated: bool, report: &mut Report) {
    let on_connection = matches!(place, Place::Connection { .. });
    let is_of_instance = name == "maxwait";
    let is_home = if is_of_instance { place == Place::Instance } else { on_connection };
    if federated && on_connection && name == "maxwait" {
        report.add(
            Diagnostic::warning("LF0220", attribute.span, "`@maxwait` has no effect here")
                .hint("write it at the instance, or `@absent_after` at the connection"),
        );
    } else if !federated || !is_home {
        report.add(misplaced(attribute, name, !is_of_instance, report.syntax()));
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
        let message = format!("{} does not belong here", report.syntax().option("bound"));
        let hint = format!("it belongs to a physical connection: {}", report.syntax().physical());
        report.add(Diagnostic::error("LF0212", attribute.span, message).hint(hint));
    } else if let Err(Wrong { message, hint }) = read_bound(attribute, report.syntax()) {
        report.add(Diagnostic::error("LF0212", attribute.span, message).hint(hint));
    }
}

/// What is wrong with the arguments of an attribute.
pub(super) struct Wrong {
    pub(super) message: String,
    pub(super) hint: String,
}

fn read_bound(attribute: &Attribute, syntax: Syntax) -> Result<Bound, Wrong> {
    const POLICIES: [(&str, Overflow); 3] =
        [("drop", Overflow::Drop), ("replace", Overflow::Replace), ("block", Overflow::Block)];
    let name = syntax.option("bound");
    let example = syntax.option_with("bound", "10, \"replace\"");
    let wrong = |message: String| Wrong {
        message,
        hint: format!(
            "write {example}, \"drop\" to keep the first 10, or \"block\" to make the sender wait"
        ),
    };
    let form = format!("{name} takes a number of messages, and what to do when more arrive");
    let Some(Expression { kind: ExpressionKind::Integer(messages), .. }) = value_of(attribute, "n")
    else {
        return Err(wrong(form));
    };
    let overflow = match value_of(attribute, "policy").map(|policy| &policy.kind) {
        None if attribute.arguments.len() == 1 => Overflow::Drop,
        Some(ExpressionKind::String(policy)) if attribute.arguments.len() == 2 => {
            let found = POLICIES.iter().find(|(name, _)| name == policy);
            let Some((_, overflow)) = found else {
                let message = format!("{name} has no policy `{policy}`");
                let hint = existing(policy, "its policies", POLICIES.map(|(name, _)| name));
                return Err(Wrong { message, hint });
            };
            *overflow
        }
        _ => return Err(wrong(form)),
    };
    let most = u32::MAX;
    let messages = u32::try_from(*messages).ok().filter(|messages| *messages > 0);
    let messages = messages.ok_or_else(|| {
        wrong(format!("the number of messages of {name} must be from 1 to {most}"))
    })?;
    Ok(Bound { messages, overflow })
}

/// The bound that is among `attributes`, if it is right.
pub(crate) fn bound(attributes: &[Attribute]) -> Option<Bound> {
    let named = |attribute: &&Attribute| attribute.name.text.eq_ignore_ascii_case("bound");
    let read = |attribute: &Attribute| read_bound(attribute, Syntax::default()).ok();
    attributes.iter().find(named).and_then(read)
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
    let text = |argument: &AttributeArgument| match &argument.value.kind {
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

/// The attribute `name`, if it is among `attributes`.
pub(crate) fn find<'a>(attributes: &'a [Attribute], name: &str) -> Option<&'a Attribute> {
    attributes.iter().find(|attribute| attribute.name.text.eq_ignore_ascii_case(name))
}

/// The time of the attribute `name`, if it is among `attributes`.
pub(crate) fn argument<'a>(attributes: &'a [Attribute], name: &str) -> Option<&'a Expression> {
    let named = |attribute: &&Attribute| attribute.name.text.eq_ignore_ascii_case(name);
    Some(&attributes.iter().find(named)?.arguments.first()?.value)
}

/// The values of all arguments of attributes.
pub(crate) fn arguments(attributes: &[Attribute]) -> impl Iterator<Item = &Expression> {
    let all = attributes.iter().flat_map(|attribute| &attribute.arguments);
    all.map(|argument| &argument.value)
}
