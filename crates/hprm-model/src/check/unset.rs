//! Outputs that nothing ever sets, neither a body nor a contained reactor; and modes that reactions name and never
//! enter.
//!
//! A body is text here. One that does not contain the name of an output or a mode cannot set it; one that does
//! is believed.

use std::collections::BTreeSet;

use crate::declaration::{Body, PortKind};
use crate::diagnostic::{Diagnostic, Report};
use crate::model::{Entity, Held, Model, ResolvedReaction};
use crate::source::Sources;

/// Warns about outputs and modes of a class that has instances.
pub(crate) fn check(model: &Model<'_>, sources: &Sources, report: &mut Report) {
    if model.reactions.is_empty() && model.declared.instances.is_empty() {
        // A sketch, or what others extend.
        return;
    }
    check_modes(model, sources, report);
    let connected: BTreeSet<usize> = model
        .connections
        .iter()
        .flat_map(|connection| &connection.right)
        .filter_map(|end| own_port(end.entity))
        .collect();
    for (index, port) in model.declared.ports.iter().enumerate() {
        if port.kind != PortKind::Output || connected.contains(&index) {
            continue;
        }
        if model
            .reactions
            .iter()
            .any(|reaction| says(reaction, &[port.name.text.as_str()], sources))
        {
            // Perhaps a reaction only lacks the effect, which is found where names are looked at.
            continue;
        }
        let names_it =
            |reaction: &&ResolvedReaction<'_>| reaction.effects.contains(&Entity::Port(index));
        let reactions: Vec<&ResolvedReaction<'_>> =
            model.reactions.iter().filter(names_it).collect();
        if reactions.iter().any(|reaction| mentions(reaction, index, sources)) {
            continue;
        }
        let name = &port.name.text;
        let message = format!("nothing sets the output `{name}`");
        let warning = Diagnostic::warning("LF0506", port.name.span, message);
        report.add(match reactions.first() {
            Some(reaction) => warning
                .label(reaction.decl.header, "this names it as an effect")
                .hint(format!("call `{}.set(value)` in its body", called(reaction, index))),
            None => warning.hint(report.syntax().set_output(name)),
        });
    }
}

/// Warns about modes that some reaction names as an effect, and none enters.
fn check_modes(model: &Model<'_>, sources: &Sources, report: &mut Report) {
    for (index, mode) in model.declared.modes.iter().enumerate() {
        let Some(name) = &mode.name else { continue };
        let names_it = |reaction: &&ResolvedReaction<'_>| {
            reaction.effects.iter().any(|it| matches!(it, Entity::Mode(mode, _) if *mode == index))
        };
        let mut reactions = model.reactions.iter().filter(names_it);
        let enters = |reaction: &ResolvedReaction<'_>| {
            is_elsewhere(reaction) || says(reaction, &[name.text.as_str(), "locals"], sources)
        };
        let Some(first) = reactions.next() else { continue };
        if enters(first) || reactions.any(enters) {
            continue;
        }
        report.add(
            Diagnostic::warning(
                "LF0911",
                name.span,
                format!("nothing enters the mode `{}`", name.text),
            )
            .label(first.decl.header, "this names it as an effect")
            .hint(format!("call `{}.set()` in its body", name.text)),
        );
    }
}

fn own_port(entity: Entity) -> Option<usize> {
    match entity {
        Entity::Port(port) => Some(port),
        _ => None,
    }
}

/// What the reaction calls the port.
fn called<'r>(reaction: &'r ResolvedReaction<'_>, port: usize) -> &'r str {
    let mut slots = reaction.slots.iter().filter(|slot| slot.holds == Held::Port(port));
    slots.next_back().map_or("", |slot| &slot.name)
}

/// Whether a body of the reaction contains one of the names that it has for the port.
fn mentions(reaction: &ResolvedReaction<'_>, port: usize, sources: &Sources) -> bool {
    let names = reaction.slots.iter().filter(|slot| slot.holds == Held::Port(port));
    // All arguments at once.
    let names: Vec<&str> = names.map(|slot| slot.name.as_str()).chain(["locals"]).collect();
    // What the front end has may set it.
    is_elsewhere(reaction) || says(reaction, &names, sources)
}

/// Whether a body of the reaction is no text.
fn is_elsewhere(reaction: &ResolvedReaction<'_>) -> bool {
    bodies(reaction).any(|body| body.text().is_none())
}

fn says(reaction: &ResolvedReaction<'_>, names: &[&str], sources: &Sources) -> bool {
    let mut texts = bodies(reaction).filter_map(Body::text).map(|span| sources.slice(span));
    texts.any(|text| words(text).any(|word| names.contains(&word)))
}

/// The body of a reaction and those of its handlers.
fn bodies(reaction: &ResolvedReaction<'_>) -> impl Iterator<Item = Body> {
    let decl = reaction.decl;
    let handlers = decl.deadline.iter().map(|deadline| deadline.body);
    let tardy = decl.late.iter().filter_map(|late| late.body);
    decl.body.into_iter().chain(handlers).chain(tardy)
}

fn words(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| !(c.is_alphanumeric() || c == '_'))
}
