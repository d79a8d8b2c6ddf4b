//! What the user of a program states on the command line: target properties, as `KEY=VALUE`, and
//! parameters of the main reactor, as `main.NAME=VALUE`.
//!
//! Both are parsed as the program's own text is, each in a source of its own, so that they mean the same.
//! A mistake in one is shown with the option that states it. `properties` knows what a property means, and
//! `instance` which instance gets a parameter.

use crate::ast::{Element, ElementKind, Expression, ExpressionKind, Name, Parameter, Property};
use crate::diagnostic::{Diagnostic, Report, existing};
use crate::parser;
use crate::properties::spin;
use crate::property_values::{Read, time};
use crate::source::{FileId, Sources, Span};

/// The prefix of a key that names a parameter of the main reactor: no target property has a dot.
pub const PARAMETER: &str = "main.";

/// What is stated, before the program is known.
#[derive(Default)]
pub(crate) struct Overrides {
    pub(crate) properties: Vec<Property>,
    parameters: Vec<Stated>,
}

/// A parameter of the main reactor, and the text that is to be its value.
struct Stated {
    name: Name,
    value: FileId,
}

/// A parameter of the main reactor with its value.
#[derive(Clone, Debug)]
pub(crate) struct Assigned {
    pub(crate) name: String,
    pub(crate) value: Expression,
}

/// Parses what is stated; each becomes a source of its own.
pub(crate) fn parse(stated: &[String], sources: &mut Sources, report: &mut Report) -> Overrides {
    let mut overrides = Overrides::default();
    for stated in stated {
        let Some((key, value)) = stated.split_once('=') else {
            let file = sources.add_stated(&as_property(stated), stated.clone());
            let message = format!("`{stated}` is no target property with a value");
            report.add(
                Diagnostic::error("LF0608", Span::new(file, 0..stated.len()), message)
                    .hint("write it as KEY=VALUE, such as --property 'timeout=10 s'"),
            );
            continue;
        };
        if let Some(name) = key.strip_prefix(PARAMETER) {
            let typed = format!("--{name} {}", as_word(value));
            let value = sources.add_stated(&typed, value.to_owned());
            let span = Span::new(value, 0..sources.text(value).len());
            overrides.parameters.push(Stated { name: Name { text: name.to_owned(), span }, value });
            continue;
        }
        let text = format!("target Python {{ {key}: {value} }}");
        let file = sources.add_stated(&as_property(stated), text);
        let model = parser::parse(file, sources.text(file), report);
        let target = model.target.into_iter();
        overrides.properties.extend(target.flat_map(|target| target.properties));
    }
    overrides
}

/// What a time must be that is the value of a target property, if a text is not that.
#[must_use]
pub fn expected_time(text: &str) -> Option<&'static str> {
    expected(text, time)
}

/// What the value of the target property `spin` must be, if a text is not that.
#[must_use]
pub fn expected_spin(text: &str) -> Option<&'static str> {
    expected(text, spin)
}

fn expected<T>(text: &str, read: impl Fn(&Element) -> Read<T>) -> Option<&'static str> {
    let mut report = Report::default();
    let parsed =
        parser::parse(FileId(0), &format!("target Python {{ value: {text} }}"), &mut report);
    let properties = parsed.target.into_iter().flat_map(|target| target.properties);
    let values: Vec<_> = properties.map(|property| property.value).collect();
    match values.as_slice() {
        [value] if !report.has_errors() => read(value).err(),
        // It is no value of any kind.
        _ => {
            read(&Element { kind: ElementKind::List(Vec::new()), span: Span::new(FileId(0), 0..0) })
                .err()
        }
    }
}

/// The option that states a property.
fn as_property(stated: &str) -> String {
    format!("--property {}", as_word(stated))
}

/// A text as one word of a shell.
fn as_word(text: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "_-./=+:,@%".contains(c);
    match text.chars().all(plain) && !text.is_empty() {
        true => text.to_owned(),
        false => format!("'{}'", text.replace('\'', r"'\''")),
    }
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
        for Stated { name, value } in &self.parameters {
            let Some(parameter) = declared.iter().find(|known| known.name.text == name.text) else {
                let message = format!("the main reactor has no parameter `{}`", name.text);
                let all = declared.iter().map(|known| known.name.text.as_str());
                let hint = existing(&name.text, "its parameters", all);
                report.add(Diagnostic::error("LF0306", name.span, message).hint(hint));
                continue;
            };
            let Some(value) = read(parameter, *value, sources, report) else { continue };
            assigned.retain(|earlier| earlier.name != name.text);
            assigned.push(Assigned { name: name.text.clone(), value });
        }
        assigned
    }
}

/// Reads a value as one of the kind that the default has. Text needs no quotes.
fn read(
    parameter: &Parameter,
    file: FileId,
    sources: &Sources,
    report: &mut Report,
) -> Option<Expression> {
    use ExpressionKind::{
        Bool, Character, Code, Float, Integer, List, Parameter, String, Time, Tuple,
    };
    let text = sources.text(file);
    let span = Span::new(file, 0..text.len());
    let as_text = || Some(Expression { kind: String(text.to_owned()), span });
    let default = &parameter.default.as_ref()?.kind;
    let is_quoted = |quote| text.len() > 1 && text.starts_with(quote) && text.ends_with(quote);
    if matches!(default, String(_) | Character(_)) && !is_quoted('"') && !is_quoted('\'') {
        return as_text();
    }
    // The words of an error are about what is expected here, not about the grammar.
    let value = parser::parse_value(file, text, &mut Report::default());
    let value = value.map(truth);
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
