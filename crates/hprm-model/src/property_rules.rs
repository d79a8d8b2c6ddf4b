//! Target properties that change nothing here, and those that contradict one another.
//!
//! Each property that has no effect causes a warning, unless its value is what holds anyway.
//! [`properties`](crate::properties) reads what the runtime obeys.

use std::collections::BTreeMap;

use crate::declaration::{Element, ElementKind, ExpressionKind, Property};
use crate::diagnostic::{Diagnostic, Report};
use crate::library::Library;
use crate::source::FileId;
use crate::syntax::Syntax;

/// What the value of a property may be.
#[derive(Clone, Copy)]
enum Form {
    Bool,
    Text,
    Texts,
    Dictionary,
    OneOf(&'static [&'static str]),
}

const FORMS: [(&str, Form); 13] = [
    ("build", Form::Texts),
    ("build-type", Form::OneOf(&["debug", "minsizerel", "release", "relwithdebinfo", "test"])),
    ("cmake-args", Form::Dictionary),
    ("cmake-include", Form::Texts),
    ("compile-definitions", Form::Dictionary),
    ("coordination-options", Form::Dictionary),
    ("no-compile", Form::Bool),
    ("no-source-mapping", Form::Bool),
    ("protobufs", Form::Texts),
    ("python-version", Form::Text),
    ("sst", Form::Dictionary),
    ("trace-plugin", Form::Dictionary),
    ("verify", Form::Bool),
];

/// Reports a value, written in a `syntax`, that the property `name` cannot have.
pub(crate) fn check_value(name: &str, value: &Element, syntax: Syntax, report: &mut Report) {
    let Some((_, form)) = FORMS.iter().find(|(known, _)| *known == name) else { return };
    let dictionary = matches!(value.kind, ElementKind::Dictionary(_));
    let (right, expected) = match form {
        Form::Bool => (boolean(value).is_some(), "`true` or `false`".to_owned()),
        Form::Text => (word(value).is_some(), "a text".to_owned()),
        Form::Texts => {
            let all = match &value.kind {
                ElementKind::List(items) => items.iter().all(|item| word(item).is_some()),
                _ => word(value).is_some(),
            };
            (all, "a text or a list of texts".to_owned())
        }
        Form::Dictionary => (dictionary, "`{ name: value, ... }`".to_owned()),
        Form::OneOf(words) => {
            let right = word(value).is_some_and(|w| words.contains(&w.as_str()));
            let words: Vec<_> = words.iter().map(|word| format!("`{word}`")).collect();
            (right, format!("one of {}", words.join(", ")))
        }
    };
    if !right {
        let message = format!("`{name}` must be {}", syntax.value(&expected));
        report.add(Diagnostic::error("LF0603", value.span, message));
    }
}

/// Whether the property states what holds without it.
pub(crate) fn is_no_change(name: &str, value: &Element) -> bool {
    match name {
        "no-compile" | "no-source-mapping" | "verify" => boolean(value) == Some(false),
        _ => false,
    }
}

/// Whether a `comm-type` is the one that is not supported.
pub(crate) fn is_sst(value: &Element) -> bool {
    word(value).as_deref() == Some("sst")
}

/// Warns that a known property has no effect here, and says why.
pub(crate) fn ignored(property: &Property, name: &str, syntax: Syntax, report: &mut Report) {
    check_value(name, &property.value, syntax, report);
    if is_no_change(name, &property.value) {
        return;
    }
    let why = match name {
        "files" => "a program in Python imports what lies beside it, and finds files by `__file__`",
        "protobufs" => {
            "compile it with `protoc --python_out=.`, and import the module that it makes"
        }
        "python-version" => "a program runs in the interpreter in which `hprm` is installed",
        "threading" => "use `workers` or `single-threaded`",
        "verify" => "there is no verifier",
        _ => "nothing is generated and nothing compiled",
    };
    let message = format!("`{name}` has no effect here");
    report.add(Diagnostic::warning("LF0607", property.name.span, message).hint(why));
}

/// Warns about a valid value that has no effect here.
pub(crate) fn unheeded(property: &Property, name: &str, syntax: Syntax, report: &mut Report) {
    let text = word(&property.value).unwrap_or_default();
    let (what, hint) = match (name, text.as_str()) {
        // What holds anyway.
        ("logging", "info") | ("scheduler", "np" | "gedf_np" | "gedf_np_ci") => return,
        ("logging", _) => (
            format!("{} has no effect yet", syntax.property("logging", &text)),
            "warnings and errors are always shown, and nothing else is",
        ),
        ("scheduler", _) => (
            format!(
                "{} has no effect here",
                syntax.property("scheduler", &text.to_ascii_uppercase())
            ),
            "there is one scheduler; `GEDF_NP` lets it prefer reactions with earlier deadlines",
        ),
        _ => return,
    };
    report.add(Diagnostic::warning("LF0606", property.name.span, what).hint(hint));
}

/// Checks properties of the main file that contradict one another.
pub(crate) fn contradictions(library: &Library, federated: bool, report: &mut Report) {
    let mut stated: BTreeMap<String, &Property> = BTreeMap::new();
    for property in library.properties(FileId::MAIN) {
        let name = property.name.text.to_ascii_lowercase();
        if let Some(first) = stated.get(&name) {
            let message = format!("`{name}` is stated twice");
            report.add(
                Diagnostic::error("LF0604", property.name.span, message)
                    .label(first.name.span, "the first time"),
            );
        }
        stated.entry(name).or_insert(property);
    }
    let is_on = |property: &&&Property| match &property.value.kind {
        ElementKind::Dictionary(_) => true,
        _ => boolean(&property.value) == Some(true),
    };
    let Some(single) = stated.get("single-threaded").filter(is_on) else { return };
    let syntax = report.syntax();
    let mut contradicts = |other: &str, hint: &str| {
        let message = format!("`single-threaded` does not go together with {other}");
        report.add(Diagnostic::error("LF0605", single.name.span, message).hint(hint));
    };
    if federated {
        let stated = syntax.property("single-threaded", "true");
        contradicts("a federated program", &format!("remove {stated}"));
    } else if stated.get("tracing").filter(is_on).is_some() {
        contradicts("`tracing`", "remove one of them");
    } else if stated.contains_key("workers") {
        let one = syntax.property("workers", "1");
        contradicts("`workers`", &format!("remove one of them; {one} has one worker"));
    }
}

fn boolean(value: &Element) -> Option<bool> {
    match &value.kind {
        ElementKind::Value(expression) => match expression.kind {
            ExpressionKind::Bool(truth) => Some(truth),
            _ => None,
        },
        _ => None,
    }
}

/// A word with or without quotes, in lower case.
fn word(value: &Element) -> Option<String> {
    match &value.kind {
        ElementKind::Path(word) => Some(word.to_ascii_lowercase()),
        ElementKind::Value(expression) => match &expression.kind {
            ExpressionKind::String(text) => Some(text.to_ascii_lowercase()),
            _ => None,
        },
        _ => None,
    }
}
