//! The rules of the language for one class, and one rule for all classes together: no class contains
//! itself.
//!
//! References have been resolved before. Rules that depend on the values of parameters are checked when
//! instances are made.

pub(crate) mod attributes;
mod banks;
pub(crate) mod constants;
mod federation;
mod hosts;
pub(crate) mod modes;
mod names;
pub(crate) mod restart;
pub(crate) mod unset;
mod values;

use std::collections::BTreeSet;

use crate::declaration::{Member, Name, ReactorKind, ReactorNode};
use crate::diagnostic::{Diagnostic, Report};
use crate::library::{ClassId, Library};
use crate::model::{Model, ResolvedInstance};
use crate::source::{FileId, Span, stem};
use crate::spacing;

/// What a compiled program takes as options on its command line.
const OPTIONS: [&str; 7] = ["fast", "help", "id", "keepalive", "rti", "timeout", "workers"];

/// The classes in use, by class.
pub(crate) type Models<'a> = [Option<Model<'a>>];

/// Checks all classes in use.
pub(crate) fn check(library: &Library, models: &Models<'_>, report: &mut Report) {
    for model in models.iter().flatten() {
        header(model, report);
        declarations(model, report);
        reactions(model, report);
        names::check(model, report);
        values::check(model, models, report);
        attributes::check(model, report);
        federation::check(library, model, report);
        let inner = model.declared.instances.iter().filter_map(|i| i.decl.host.as_ref());
        for host in model.declared.decl.host.iter().chain(inner) {
            hosts::check(host, report);
        }
        modes::check(model, models, report);
        banks::check(model, models, report);
    }
    cycles(models, report);
    unused_imports(library, report);
}

/// Whether the main file has reactors, but only those that other files can import.
pub(crate) fn is_for_import(library: &Library) -> bool {
    let mut reactors = library.classes_of_main().map(|class| library.reactor(class)).peekable();
    reactors.peek().is_some() && reactors.all(|reactor| reactor.kind == ReactorKind::Plain)
}

/// The main reactor, of which there must be one.
pub(crate) fn main_class(library: &Library, report: &mut Report) -> Option<ClassId> {
    if let Some(main) = library.stated_main() {
        return Some(main);
    }
    let mains: Vec<ClassId> = library
        .classes_of_main()
        .filter(|class| library.reactor(*class).kind != ReactorKind::Plain)
        .collect();
    let Some(main) = mains.first() else {
        let message = "this file has no main reactor";
        report.add(
            Diagnostic::error("LF0206", Span::new(FileId::MAIN, 0..0), message)
                .hint("write `main reactor { ... }` or `federated reactor { ... }`"),
        );
        return None;
    };
    let first = library.reactor(*main);
    for other in &mains[1..] {
        let message = "a file has one main or federated reactor";
        report.add(
            Diagnostic::error("LF0205", library.reactor(*other).header, message)
                .label(first.header, "the first one")
                .hint("make one of the two a plain reactor"),
        );
    }
    let path = library.sources.path(FileId::MAIN);
    if let Some(name) = &first.name
        && name.text != stem(path)
    {
        let message =
            format!("the main reactor `{}` does not have the name of its file", name.text);
        let stem = stem(path);
        let is_name = stem.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
            && !stem.starts_with(|c: char| c.is_ascii_digit());
        let hint = match is_name {
            true => format!("remove the name, or change it to `{stem}`"),
            false => "remove the name".to_owned(),
        };
        report.add(Diagnostic::error("LF0213", name.span, message).hint(hint));
    }
    Some(*main)
}

fn header(model: &Model<'_>, report: &mut Report) {
    let ReactorNode { kind, name, header, type_parameters, host, .. } = model.declared.decl;
    if *kind == ReactorKind::Plain && name.is_none() {
        let message = "only a main reactor can do without a name";
        report.add(
            Diagnostic::error("LF0204", *header, message)
                .hint("name it, or write `main reactor` or `federated reactor`"),
        );
    }
    if let Some(span) = type_parameters {
        types_are_errors(*span, report);
    }
    if *kind != ReactorKind::Plain {
        for parameter in &model.declared.parameters {
            let name = &parameter.name;
            if OPTIONS.contains(&name.text.as_str()) {
                let message =
                    format!("the parameter `{}` has the name of a command-line option", name.text);
                report.add(Diagnostic::warning("LF0218", name.span, message).hint(format!(
                    "choose another name, or set it with `--property main.{}=VALUE`",
                    name.text
                )));
            }
        }
        for port in &model.declared.ports {
            let message = "the main reactor cannot have ports: nothing contains it";
            report.add(
                Diagnostic::error("LF0207", port.name.span, message)
                    .hint("what comes from outside of the program is a physical action"),
            );
        }
    }
    if let Some(host) = host
        && *kind != ReactorKind::Federated
    {
        let message = "only a federated reactor has a host";
        report.add(
            Diagnostic::error("LF0802", host.span, message)
                .hint(report.syntax().federated_or_no_host()),
        );
    }
}

fn types_are_errors(span: Span, report: &mut Report) {
    report.add(
        Diagnostic::error("LF0202", span, "types are not allowed in the Python target")
            .hint("remove the type: every value is a Python object"),
    );
}

fn declarations(model: &Model<'_>, report: &mut Report) {
    let declared = &model.declared;
    let parameters = declared.parameters.iter().map(|parameter| parameter.ty);
    let types = parameters
        .chain(declared.states.iter().map(|state| state.ty))
        .chain(declared.ports.iter().map(|port| port.ty))
        .chain(declared.actions.iter().map(|action| action.ty))
        .chain(declared.methods.iter().flat_map(|method| method.types.iter().map(|ty| Some(*ty))))
        .chain(declared.instances.iter().map(|instance| instance.decl.type_arguments));
    types.flatten().for_each(|span| types_are_errors(span, report));
    for action in &declared.actions {
        if action.physical.is_none() {
            let message =
                format!("the action `{}` is neither logical nor physical", action.name.text);
            report.add(
                Diagnostic::error("LF0209", action.name.span, message)
                    .hint("write `logical action` or `physical action`"),
            );
        }
        spacing::check(action, report);
    }
}

fn reactions(model: &Model<'_>, report: &mut Report) {
    for reaction in &model.declared.reactions {
        if reaction.body.is_none() {
            let names_ports = !reaction.sources.is_empty() || !reaction.effects.is_empty();
            let hint = if names_ports {
                "write `{= ... =}` behind it; without that, a connection that follows is taken for \
                 what the reaction reads and sets"
            } else {
                "write `{= ... =}` behind it; `{= pass =}` does nothing"
            };
            report.add(
                Diagnostic::error("LF0210", reaction.header, "this reaction has no body")
                    .hint(hint),
            );
        }
    }
}

/// No class contains itself, directly or through others.
fn cycles<'m>(models: &'m Models<'m>, report: &mut Report) {
    #[derive(Clone, Copy, PartialEq, Eq)]
    enum Visit {
        Not,
        Open,
        Done,
    }
    let inside = |model: &'m Option<Model<'m>>| -> Vec<(usize, &'m Name)> {
        let instances = model.iter().flat_map(|model| &model.declared.instances);
        let classes = |instance: &'m ResolvedInstance<'m>| {
            instance.classes().map(|class| (class.0, &instance.decl.class))
        };
        instances.flat_map(classes).collect()
    };
    let inside: Vec<_> = models.iter().map(inside).collect();
    let mut visits = vec![Visit::Not; models.len()];
    for root in 0..models.len() {
        if visits[root] != Visit::Not {
            continue;
        }
        visits[root] = Visit::Open;
        let mut stack = vec![(root, 0)];
        while let Some((class, next)) = stack.pop() {
            let Some((inside, name)) = inside[class].get(next) else {
                visits[class] = Visit::Done;
                continue;
            };
            stack.push((class, next + 1));
            match visits[*inside] {
                Visit::Done => {}
                Visit::Open => {
                    let message = format!("`{}` contains itself, without end", name.text);
                    report.add(Diagnostic::error("LF0308", name.span, message));
                }
                Visit::Not => {
                    visits[*inside] = Visit::Open;
                    stack.push((*inside, 0));
                }
            }
        }
    }
}

fn unused_imports(library: &Library, report: &mut Report) {
    fn instances<'a>(members: &'a [Member], used: &mut BTreeSet<&'a str>) {
        for member in members {
            match member {
                Member::Instantiation(instance) => {
                    used.insert(&instance.class.text);
                }
                Member::Mode(mode) => instances(&mode.members, used),
                Member::InMode(_, member) => instances(std::slice::from_ref(member), used),
                _ => {}
            }
        }
    }
    let mut used = BTreeSet::new();
    for reactor in library.classes_of_main().map(|class| library.reactor(class)) {
        used.extend(reactor.extends.iter().map(|name| name.text.as_str()));
        instances(&reactor.members, &mut used);
    }
    for name in library.imported(FileId::MAIN) {
        if !used.contains(name.text.as_str()) {
            let message = format!("`{}` is imported and not used", name.text);
            report.add(
                Diagnostic::warning("LF0104", name.span, message)
                    .hint(format!("remove it, or make an instance: `new {}()`", name.text)),
            );
        }
    }
}
