//! What the user of a program states on the command line: target properties, as `KEY=VALUE`, and
//! parameters of the main reactor, as `main.NAME=VALUE`.
//!
//! Both are parsed as the program's own text is, each in a source of its own, so that they mean the same.
//! A mistake in one is shown with the option that states it. What they mean is for `hprm-model` to say.

use hprm_model::declaration::{Element, ElementKind};
use hprm_model::property::{Read, spin, time};
use hprm_model::{Diagnostic, FileId, Library, Overrides, ParameterOverride, Report, Span};

use crate::parser;

/// The prefix of a key that names a parameter of the main reactor: no target property has a dot.
pub const PARAMETER: &str = "main.";

/// Parses what is stated: target properties as `KEY=VALUE`, and parameters of the main reactor as
/// `main.NAME=VALUE` (see [`PARAMETER`]). Each becomes a source of its own.
///
/// A front end for another language needs it too: the command line is the same for all programs.
pub fn overrides(stated: &[String], library: &mut Library, report: &mut Report) -> Overrides {
    let mut overrides = Overrides::default();
    for stated in stated {
        let Some((key, value)) = stated.split_once('=') else {
            let file = library.add_stated(&as_property(stated), stated.clone());
            let message = format!("`{stated}` is no target property with a value");
            report.add(
                Diagnostic::error("LF0608", Span::new(file, 0..stated.len()), message)
                    .hint("write it as KEY=VALUE, such as --property 'timeout=10 s'"),
            );
            continue;
        };
        if let Some(name) = key.strip_prefix(PARAMETER) {
            let typed = format!("--{name} {}", as_word(value));
            let file = library.add_stated(&typed, value.to_owned());
            let text = Span::new(file, 0..value.len());
            // The words of an error are about what is expected there, not about the grammar.
            let value = parser::parse_value(file, value, &mut Report::default());
            overrides.parameters.push(ParameterOverride { name: name.to_owned(), text, value });
            continue;
        }
        let text = format!("target Python {{ {key}: {value} }}");
        let file = library.add_stated(&as_property(stated), text);
        let parsed = parser::parse(file, library.sources().text(file), report);
        let target = parsed.target.into_iter();
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
