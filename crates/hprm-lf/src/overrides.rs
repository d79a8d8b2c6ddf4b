//! Target properties that whoever runs the program states, as `KEY=VALUE`.
//!
//! They are parsed as if a target declaration held them, so they mean the same, and a mistake in one
//! is shown like any other. What they mean is up to `properties`.

use crate::ast::Property;
use crate::diagnostic::{Diagnostic, Report};
use crate::parser;
use crate::source::{Sources, Span};

/// What diagnostics call the place where they were stated.
const PLACE: &str = "--property";

/// Parses properties, each of which becomes a source of its own.
pub(crate) fn parse(
    properties: &[String],
    sources: &mut Sources,
    report: &mut Report,
) -> Vec<Property> {
    let mut parsed = Vec::new();
    for stated in properties {
        let Some((key, value)) = stated.split_once('=') else {
            let file = sources.add(PLACE, stated.clone());
            let message = format!("`{stated}` is no target property with a value");
            report.add(
                Diagnostic::error("LF0608", Span::new(file, 0..stated.len()), message)
                    .hint("write it as KEY=VALUE, such as `timeout=10 s`"),
            );
            continue;
        };
        let file = sources.add(PLACE, format!("target Python {{ {key}: {value} }}"));
        let model = parser::parse(file, sources.text(file), report);
        parsed.extend(model.target.into_iter().flat_map(|target| target.properties));
    }
    parsed
}
