//! Parameters and the places that use them: each has a default, each use and each assignment names
//! one that exists.

use std::collections::BTreeSet;

use crate::declaration::{Expression, ExpressionKind, Width, WidthTerm};
use crate::diagnostic::{Diagnostic, Report, did_you_mean, existing};
use crate::model::{Declarations, Model};

use super::{Models, attributes};

pub(super) fn check(model: &Model<'_>, models: &Models<'_>, report: &mut Report) {
    let declared = &model.declared;
    defaults(declared, report);
    assignments(declared, models, report);
    methods(declared, report);
    for expression in expressions(declared) {
        parameters_exist(expression, declared, report);
    }
}

fn defaults(declared: &Declarations<'_>, report: &mut Report) {
    for parameter in &declared.parameters {
        let name = &parameter.name;
        match &parameter.default {
            None if parameter.given.is_some() => {}
            None => {
                let message = format!("the parameter `{}` has no default value", name.text);
                report.add(
                    Diagnostic::error("LF0203", name.span, message)
                        .hint(format!("write `{} = value`", name.text)),
                );
            }
            Some(default) => {
                let hint = "write the value; where instances are made, parameters may be used";
                no_parameters(default, declared, ("a default", hint), report);
            }
        }
    }
}

fn no_parameters(
    expression: &Expression,
    declared: &Declarations<'_>,
    (what, hint): (&str, &str),
    report: &mut Report,
) {
    match &expression.kind {
        ExpressionKind::Parameter(other) => {
            let message = format!("{what} cannot be a parameter, `{other}`");
            let hint = match declared.parameter(other) {
                Some(_) => hint.to_owned(),
                None => of_python(other),
            };
            report.add(Diagnostic::error("LF0203", expression.span, message).hint(hint));
        }
        ExpressionKind::List(items) | ExpressionKind::Tuple(items) => {
            items.iter().for_each(|item| no_parameters(item, declared, (what, hint), report));
        }
        _ => {}
    }
}

/// What to write if a name is none of the program but one of Python.
fn of_python(name: &str) -> String {
    format!("a value of Python is written `{{= {name} =}}`")
}

/// Python evaluates the default of an argument where the method is defined.
fn methods(declared: &Declarations<'_>, report: &mut Report) {
    for method in &declared.methods {
        let mut defaults = false;
        for argument in &method.arguments {
            let name = &argument.name;
            match &argument.default {
                Some(default) => {
                    let hint = "write the value, or read `self` in the body";
                    let what = "the default of an argument";
                    no_parameters(default, declared, (what, hint), report);
                    defaults = true;
                }
                None if defaults => {
                    let message = format!("`{}` has no default, but one before it has", name.text);
                    report.add(
                        Diagnostic::error("LF0203", name.span, message)
                            .hint("give it a default as well, or move it to the front"),
                    );
                }
                None => {}
            }
        }
    }
}

fn assignments(declared: &Declarations<'_>, models: &Models<'_>, report: &mut Report) {
    for instance in &declared.instances {
        let Some(model) = &models[instance.class.0] else { continue };
        let mut seen = BTreeSet::new();
        for assignment in &instance.decl.assignments {
            let name = &assignment.name;
            let known = model.declared.parameter(&name.text).is_some() || name.text == "bank_index";
            if !known && !report.is_full() {
                let class = &instance.decl.class.text;
                let message = format!("`{class}` has no parameter `{}`", name.text);
                let all = model.declared.parameters.iter().map(|p| p.name.text.as_str());
                let hint = existing(&name.text, "its parameters", all);
                report.add(Diagnostic::error("LF0306", name.span, message).hint(hint));
            }
            if !seen.insert(name.text.as_str()) {
                let message = format!("`{}` is assigned twice", name.text);
                report.add(Diagnostic::error("LF0201", name.span, message));
            }
        }
    }
}

/// Every expression in which a parameter of this class may stand.
fn expressions<'a>(declared: &Declarations<'a>) -> Vec<&'a Expression> {
    let mut all: Vec<&Expression> = Vec::new();
    let terms = |width: &'a Option<Width>| {
        width.iter().flat_map(|width| &width.terms).filter_map(|term| match term {
            WidthTerm::Value(expression) => Some(expression),
            WidthTerm::WidthOf(_) => None,
        })
    };
    all.extend(declared.states.iter().filter_map(|state| state.decl.init.as_ref()));
    all.extend(declared.ports.iter().flat_map(|port| terms(&port.width)));
    all.extend(
        declared
            .actions
            .iter()
            .map(|action| action.decl)
            .flat_map(|a| a.min_delay.iter().chain(&a.spacing)),
    );
    all.extend(
        declared
            .timers
            .iter()
            .map(|timer| timer.decl)
            .flat_map(|timer| timer.offset.iter().chain(&timer.period)),
    );
    for reaction in declared.reactions.iter().map(|reaction| reaction.decl) {
        all.extend(reaction.deadline.as_ref().map(|deadline| &deadline.delay));
        all.extend(reaction.late.as_ref().and_then(|late| late.wait.as_ref()));
    }
    for connection in declared.connections.iter().map(|connection| connection.decl) {
        all.extend(&connection.delay);
        all.extend(attributes::arguments(&connection.attributes));
    }
    for instance in &declared.instances {
        all.extend(terms(&instance.decl.width));
        all.extend(instance.decl.assignments.iter().map(|assignment| &assignment.value));
        all.extend(attributes::arguments(&instance.decl.attributes));
    }
    all
}

fn parameters_exist(expression: &Expression, declared: &Declarations<'_>, report: &mut Report) {
    match &expression.kind {
        ExpressionKind::Parameter(name)
            if declared.parameter(name).is_none() && !report.is_full() =>
        {
            let message = format!("there is no parameter `{name}`");
            let all = declared.parameters.iter().map(|p| p.name.text.as_str());
            let hint = did_you_mean(name, all).unwrap_or_else(|| of_python(name));
            report.add(Diagnostic::error("LF0306", expression.span, message).hint(hint));
        }
        ExpressionKind::List(items) | ExpressionKind::Tuple(items) => {
            items.iter().for_each(|item| parameters_exist(item, declared, report));
        }
        _ => {}
    }
}
