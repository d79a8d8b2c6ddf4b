//! Names within a class: no two things of one kind share one, and Python can bear them.

use std::collections::BTreeMap;

use crate::ast::Name;
use crate::diagnostic::{Diagnostic, Report};
use crate::model::Model;
use crate::source::Span;

const RESERVED: [&str; 35] = [
    "False", "None", "True", "and", "as", "assert", "async", "await", "break", "class", "continue",
    "def", "del", "elif", "else", "except", "finally", "for", "from", "global", "if", "import",
    "in", "is", "lambda", "nonlocal", "not", "or", "pass", "raise", "return", "try", "while",
    "with", "yield",
];

pub(super) fn check(model: &Model<'_>, report: &mut Report) {
    let declared = &model.declared;
    let parameters = declared.decl.parameters.iter().map(|parameter| &parameter.name);
    let states = declared.states.iter().map(|state| &state.name);
    let methods = declared.methods.iter().map(|method| &method.name);
    let ports = declared.ports.iter().map(|port| &port.name);
    let actions = declared.actions.iter().map(|action| &action.name);
    let timers = declared.timers.iter().map(|timer| &timer.name);
    let instances = declared.instances.iter().map(|instance| &instance.decl.name);
    // Three groups: attributes of `self`, what reactions name directly, and instances.
    distinct(parameters.chain(states).chain(methods), report);
    let modes = declared.modes.iter().filter_map(|mode| mode.name.as_ref());
    distinct(ports.chain(actions).chain(timers).chain(modes), report);
    distinct(instances, report);
    for method in &declared.methods {
        distinct(method.arguments.iter(), report);
    }
    declared.decl.name.iter().for_each(|name| usable(name, report));
}

fn distinct<'a>(names: impl Iterator<Item = &'a Name>, report: &mut Report) {
    let mut seen: BTreeMap<&str, Span> = BTreeMap::new();
    for name in names {
        usable(name, report);
        if let Some(first) = seen.get(name.text.as_str()) {
            let message = format!("the name `{}` is already taken", name.text);
            report.add(Diagnostic::error("LF0201", name.span, message).label(*first, "taken here"));
        } else {
            seen.insert(&name.text, name.span);
        }
    }
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
