//! The values of the parameters of an instance, as far as they are known before anything runs.
//!
//! Widths, delays, deadlines, offsets and periods are fixed by the text: literals, or parameters
//! whose value is a literal somewhere up the hierarchy. Python evaluates all other values.

use std::collections::BTreeMap;

use hprm_core::Nanos;

use crate::declaration::{Expression, ExpressionKind, Instantiation, Parameter, Width, WidthTerm};
use crate::diagnostic::{Diagnostic, Report};
use crate::given::{Given, OtherGiven};
use crate::overrides::Assigned;
use crate::source::Span;

/// The widest bank or multiport.
pub(crate) const WIDEST: u32 = 100_000;

#[derive(Clone, Copy, Debug)]
enum Static<'a> {
    Written(&'a Expression),
    /// The parameter `bank_index`, which is not in the program text.
    Index(u32),
}

/// The values of one instance's parameters.
#[derive(Clone, Debug, Default)]
pub(crate) struct Environment<'a> {
    values: BTreeMap<&'a str, Static<'a>>,
}

impl<'a> Environment<'a> {
    /// The values in the main reactor: the defaults of its class, and what is assigned.
    pub(crate) fn of_main(parameters: &[&'a Parameter], assigned: &'a [Assigned]) -> Self {
        let mut environment = Self::of_class(parameters);
        let written = assigned.iter().map(|a| (a.name.as_str(), Static::Written(&a.value)));
        environment.values.extend(written);
        environment
    }

    /// The defaults of a class.
    fn of_class(parameters: &[&'a Parameter]) -> Self {
        let defaults = parameters.iter().filter_map(|parameter| {
            let default = parameter.default.as_ref()?;
            Some((parameter.name.text.as_str(), Static::Written(default)))
        });
        Self { values: defaults.collect() }
    }

    /// The values in an instance that `self` contains.
    pub(crate) fn of_instance(
        &self,
        decl: &'a Instantiation,
        parameters: &[&'a Parameter],
        bank_index: Option<u32>,
    ) -> Self {
        let mut inner = Self::of_class(parameters);
        if let (Some(index), Some(value)) = (bank_index, inner.values.get_mut("bank_index")) {
            *value = Static::Index(index);
        }
        for assignment in &decl.assignments {
            let value = self.find(&assignment.value);
            inner.values.insert(assignment.name.text.as_str(), value);
        }
        inner
    }

    fn find(&self, expression: &'a Expression) -> Static<'a> {
        let known = match &expression.kind {
            ExpressionKind::Parameter(name) => self.values.get(name.as_str()).copied(),
            _ => None,
        };
        known.unwrap_or(Static::Written(expression))
    }

    /// The value of the parameter that `named` accepts.
    pub(crate) fn parameter(&self, named: impl Fn(&str) -> bool) -> Option<&'a Expression> {
        self.values.iter().find_map(|(name, value)| match value {
            Static::Written(expression) if named(name) => Some(*expression),
            _ => None,
        })
    }

    /// The value of a parameter as data, if it is known: none where another check reports why it is not. `outer` has the
    /// parameters that may stand in it.
    pub(crate) fn given(
        &self,
        name: &str,
        outer: &Self,
        report: &mut Report,
    ) -> Option<(Given, Option<Span>)> {
        match self.values.get(name)? {
            Static::Index(index) => Some((Given::Integer(i64::from(*index)), None)),
            Static::Written(written) => Some((outer.data(written, report)?, Some(written.span))),
        }
    }

    fn data(&self, expression: &'a Expression, report: &mut Report) -> Option<Given> {
        let written = match self.find(expression) {
            Static::Index(index) => return Some(Given::Integer(i64::from(index))),
            Static::Written(written) => written,
        };
        let mut all = |items: &'a [Expression]| {
            items.iter().map(|item| self.data(item, report)).collect::<Option<Vec<_>>>()
        };
        Some(match &written.kind {
            ExpressionKind::Integer(number) => Given::Integer(*number),
            ExpressionKind::Float(number) => Given::Other(OtherGiven::Float(*number)),
            ExpressionKind::Bool(truth) => Given::Bool(*truth),
            ExpressionKind::String(text) => Given::Text(text.clone()),
            ExpressionKind::Character(character) => Given::Text(character.to_string()),
            ExpressionKind::Time(nanos) => Given::Other(OtherGiven::Time(*nanos)),
            ExpressionKind::List(items) => Given::List(all(items)?),
            ExpressionKind::Tuple(items) => Given::Other(OtherGiven::Tuple(all(items)?)),
            ExpressionKind::Parameter(_) => return None,
            ExpressionKind::Code(_) => {
                let message = "a parameter of an executable cannot be computed in Python: it is \
                               needed before anything runs";
                report.add(
                    Diagnostic::error("LF1107", written.span, message)
                        .hint("write the value, or a parameter whose value is written"),
                );
                return None;
            }
        })
    }

    /// A time, not negative.
    pub(crate) fn time(&self, expression: &'a Expression, report: &mut Report) -> Option<Nanos> {
        let value = match self.find(expression) {
            Static::Index(0) => return Some(0),
            Static::Index(_) => {
                let message = "this is the number of a bank member, not a time";
                report.add(Diagnostic::error("LF0403", expression.span, message));
                return None;
            }
            Static::Written(value) => value,
        };
        let diagnostic = match &value.kind {
            ExpressionKind::Time(nanos) if *nanos >= 0 => return Some(*nanos),
            ExpressionKind::Integer(0) => return Some(0),
            ExpressionKind::Time(_) => {
                let message = "this time is negative";
                Diagnostic::error("LF0407", expression.span, message)
                    .hint("times count forward; use `0` or more")
            }
            ExpressionKind::Integer(number) => {
                let message = "a time needs a unit";
                Diagnostic::error("LF0403", expression.span, message)
                    .hint(format!("write `{number} ms`, for example; only `0` needs none"))
            }
            ExpressionKind::Code(_) => in_python(expression, "a time"),
            ExpressionKind::String(text) if text.starts_with(|c: char| c.is_ascii_digit()) => {
                Diagnostic::error("LF0403", expression.span, "this is a text, not a time")
                    .hint(format!("write it without quotation marks: `{text}`"))
            }
            _ => Diagnostic::error("LF0403", expression.span, "this is not a time")
                .hint("write a number and a unit: `10 ms`"),
        };
        report.add(stated_at(diagnostic, expression, value));
        None
    }

    /// The width of a bank or a multiport.
    pub(crate) fn width(&self, width: &'a Width, report: &mut Report) -> Option<u32> {
        let mut sum = 0_i64;
        for term in &width.terms {
            // `widthof` has been reported as not supported.
            let WidthTerm::Value(expression) = term else { return None };
            sum = sum.saturating_add(self.integer(expression, report)?);
        }
        let message = match u32::try_from(sum) {
            Ok(0) | Err(_) if sum < 1 => format!("a width is at least 1; this one is {sum}"),
            Ok(width) if width <= WIDEST => return Some(width),
            _ => format!("a width is at most {WIDEST}; this one is {sum}"),
        };
        report.add(Diagnostic::error("LF0405", width.span, message));
        None
    }

    fn integer(&self, expression: &'a Expression, report: &mut Report) -> Option<i64> {
        let value = match self.find(expression) {
            Static::Index(index) => return Some(i64::from(index)),
            Static::Written(value) => value,
        };
        let diagnostic = match &value.kind {
            ExpressionKind::Integer(number) => return Some(*number),
            ExpressionKind::Code(_) => in_python(expression, "a width"),
            _ => Diagnostic::error("LF0405", expression.span, "a width is a whole number"),
        };
        report.add(stated_at(diagnostic, expression, value));
        None
    }
}

fn in_python(expression: &Expression, what: &str) -> Diagnostic {
    let message = format!("{what} cannot be computed in Python: it is needed before anything runs");
    Diagnostic::error("LF0404", expression.span, message)
        .hint("write the value, or a parameter whose value is written")
}

/// Points at the place that states the value, if it is another than the one that uses it.
fn stated_at(diagnostic: Diagnostic, used: &Expression, stated: &Expression) -> Diagnostic {
    if used.span == stated.span {
        diagnostic
    } else {
        diagnostic.label(stated.span, "the value is stated here")
    }
}
