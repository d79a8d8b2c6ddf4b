//! What the user of a program states on the command line: target properties, and parameters of the main
//! reactor, which get values of the kind that their defaults have.
//!
//! [`properties`](crate::properties) knows what a property means, and [`instance`](crate::instance) which
//! instance gets a parameter.

use crate::declaration::{Expression, ExpressionKind, Parameter, Property};
use crate::diagnostic::{Diagnostic, Report, existing};
use crate::source::{Sources, Span};

/// What is stated, before the program is known.
#[derive(Clone, Debug, Default)]
pub struct Overrides {
    /// Target properties.
    pub properties: Vec<Property>,
    /// Parameters of the main reactor.
    pub parameters: Vec<ParameterOverride>,
}

/// A parameter of the main reactor, and the text that is to be its value.
#[derive(Clone, Debug)]
pub struct ParameterOverride {
    /// Its name.
    pub name: String,
    /// The text: all of a source that [`Library::add_stated`](crate::Library::add_stated) has added.
    pub text: Span,
    /// The text as a value; none if it is not one. Where a string is expected, the text itself is one.
    pub value: Option<Expression>,
}

/// A parameter of the main reactor with its value.
#[derive(Clone, Debug)]
pub(crate) struct Assigned {
    pub(crate) name: String,
    pub(crate) value: Expression,
}

impl Overrides {
    /// The parameters of the main reactor that are stated, with values of the kind that their defaults
    /// have. Of one that is stated several times, the last counts.
    pub(crate) fn assign(
        &self,
        declared: &[&Parameter],
        sources: &Sources,
        report: &mut Report,
    ) -> Vec<Assigned> {
        let mut assigned: Vec<Assigned> = Vec::new();
        for stated in &self.parameters {
            let name = &stated.name;
            let Some(parameter) = declared.iter().find(|known| known.name.text == *name) else {
                let message = format!("the main reactor has no parameter `{name}`");
                let all = declared.iter().map(|known| known.name.text.as_str());
                let hint = existing(name, "its parameters", all);
                report.add(Diagnostic::error("LF0306", stated.text, message).hint(hint));
                continue;
            };
            let Some(value) = read(parameter, stated, sources, report) else { continue };
            assigned.retain(|earlier| earlier.name != *name);
            assigned.push(Assigned { name: name.clone(), value });
        }
        assigned
    }
}

/// Reads a value as one of the kind that the default has. Text needs no quotes.
fn read(
    parameter: &Parameter,
    stated: &ParameterOverride,
    sources: &Sources,
    report: &mut Report,
) -> Option<Expression> {
    use ExpressionKind::{
        Bool, Character, Code, Float, Integer, List, Parameter, String, Time, Tuple,
    };
    let span = stated.text;
    let text = sources.slice(span);
    let as_text = || Some(Expression { kind: String(text.to_owned()), span });
    let default = &parameter.default.as_ref()?.kind;
    let is_quoted = |quote| text.len() > 1 && text.starts_with(quote) && text.ends_with(quote);
    if matches!(default, String(_) | Character(_)) && !is_quoted('"') && !is_quoted('\'') {
        return as_text();
    }
    let value = stated.value.clone().map(truth);
    let fits = value.as_ref().is_some_and(|value| match (default, &value.kind) {
        _ if names_parameters(value) => false,
        (Time(_), Integer(0)) | (Float(_), Integer(_)) => true,
        (Code(_), _) => true,
        (default, value) => std::mem::discriminant(default) == std::mem::discriminant(value),
    });
    if fits {
        return value;
    }
    let expected = match default {
        // Python computes the default, and may compute anything.
        Code(_) => return as_text(),
        Time(_) => "a time, such as `10 ms`",
        Integer(_) => "a whole number, such as `3`",
        Float(_) => "a number, such as `0.5`",
        Bool(_) => "`true` or `false`",
        List(_) => "a list, such as `[1, 2]`",
        Tuple(_) => "a tuple, such as `(1, 2)`",
        String(_) | Character(_) | Parameter(_) => "a text",
    };
    let message = format!("the parameter `{}` must be {expected}", parameter.name.text);
    report.add(
        Diagnostic::error("LF0403", span, message)
            .label(parameter.name.span, "the program declares it here"),
    );
    None
}

/// Whether a parameter stands in a value: the main reactor is in no other one that could have it.
fn names_parameters(value: &Expression) -> bool {
    match &value.kind {
        ExpressionKind::Parameter(_) => true,
        ExpressionKind::List(items) | ExpressionKind::Tuple(items) => {
            items.iter().any(names_parameters)
        }
        _ => false,
    }
}

/// Python's spelling of a truth value is understood too.
fn truth(value: Expression) -> Expression {
    let kind = match value.kind {
        ExpressionKind::Parameter(word) if word == "True" => ExpressionKind::Bool(true),
        ExpressionKind::Parameter(word) if word == "False" => ExpressionKind::Bool(false),
        kind => kind,
    };
    Expression { kind, ..value }
}
