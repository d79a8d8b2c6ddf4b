//! Names within a class, with those that it inherits: no two things of one kind share one, and
//! Python can bear them.

use std::collections::BTreeMap;

use crate::declaration::Name;
use crate::diagnostic::{Diagnostic, Report};
use crate::model::{Declarations, Model};
use crate::source::Span;

const RESERVED: [&str; 35] = [
    "False", "None", "True", "and", "as", "assert", "async", "await", "break", "class", "continue",
    "def", "del", "elif", "else", "except", "finally", "for", "from", "global", "if", "import",
    "in", "is", "lambda", "nonlocal", "not", "or", "pass", "raise", "return", "try", "while",
    "with", "yield",
];

/// A method or state variable of a superclass gives way to one of the same kind and name.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Gives {
    Not,
    WayToStates,
    WayToMethods,
}

pub(super) fn check(model: &Model<'_>, report: &mut Report) {
    let declared = &model.declared;
    let parameters = declared.parameters.iter().map(|parameter| (Gives::Not, &parameter.name));
    let states = declared.states.iter().map(|state| (Gives::WayToStates, &state.decl.name));
    let methods = declared.methods.iter().map(|method| (Gives::WayToMethods, &method.name));
    let ports = declared.ports.iter().map(|port| &port.name);
    let actions = declared.actions.iter().map(|action| &action.decl.name);
    let timers = declared.timers.iter().map(|timer| &timer.decl.name);
    let modes = declared.modes.iter().filter_map(|mode| mode.name.as_ref());
    let instances = declared.instances.iter().map(|instance| (Gives::Not, &instance.decl.name));
    // Three groups: attributes of `self`, what reactions name directly, and instances.
    distinct(declared, parameters.chain(states).chain(methods), report);
    let direct = ports.chain(actions).chain(timers).chain(modes);
    distinct(declared, direct.map(|name| (Gives::Not, name)), report);
    distinct(declared, instances, report);
    for method in &declared.methods {
        let arguments = method.arguments.iter().map(|argument| (Gives::Not, &argument.name));
        distinct(declared, arguments, report);
    }
    for (_, alias) in model.reactions.iter().flat_map(|reaction| &reaction.aliases) {
        usable(alias, report);
    }
    declared.decl.name.iter().for_each(|name| usable(name, report));
}

fn distinct<'a>(
    declared: &Declarations<'_>,
    names: impl Iterator<Item = (Gives, &'a Name)>,
    report: &mut Report,
) {
    let mut seen: BTreeMap<&str, (Gives, Span)> = BTreeMap::new();
    for (gives, name) in names {
        usable(name, report);
        let Some((gave, first)) = seen.insert(&name.text, (gives, name.span)) else { continue };
        if declared.home(first) == declared.home(name.span) {
            let message = format!("the name `{}` is already taken", name.text);
            report.add(Diagnostic::error("LF0201", name.span, message).label(first, "taken here"));
        } else if gives != gave || gives == Gives::Not {
            report.add(inherited(declared, name, first));
        }
    }
}

/// Two classes of one lineage declare what a reactor can have only once.
fn inherited(declared: &Declarations<'_>, name: &Name, first: Span) -> Diagnostic {
    let header = declared.decl.header;
    let own = |span: Span| declared.home(span) == declared.home(header);
    let text = &name.text;
    let (here, there) = if own(first) { (first, name.span) } else { (name.span, first) };
    let diagnostic = if own(here) {
        let message = format!("the name `{text}` is inherited already");
        Diagnostic::error("LF0217", here, message).label(there, "declared here")
    } else {
        let message = format!("two superclasses of this reactor declare `{text}`");
        Diagnostic::error("LF0217", header, message)
            .label(there, "declared here")
            .label(here, "and here")
    };
    diagnostic.hint(
        "choose another name; only parameters, state variables and methods can be declared \
         again, as the same kind of thing",
    )
}

fn usable(name: &Name, report: &mut Report) {
    let message = if RESERVED.contains(&name.text.as_str()) {
        format!("`{}` is a keyword of Python", name.text)
    } else if name.text == "self" {
        "`self` is the reactor itself, in every body".to_owned()
    } else if name.text.starts_with("__") {
        format!("`{}` starts with two underscores, which Python treats in its own way", name.text)
    } else {
        return;
    };
    report.add(Diagnostic::error("LF0208", name.span, message).hint("choose another name"));
}
