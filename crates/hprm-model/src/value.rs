//! Values in the form in which Python gets them. What a parameter stands for in an instance is found by
//! [`environment`](crate::environment).

use hprm_core::Nanos;

use crate::code::{self, Code};
use crate::declaration::{Expression, ExpressionKind};
use crate::source::Sources;

/// A value that Python computes or copies.
#[derive(Clone, PartialEq, Debug)]
#[non_exhaustive]
pub enum Value {
    /// A whole number.
    Int(i64),
    /// A number with a point.
    Float(f64),
    /// `true` or `false`.
    Bool(bool),
    /// A string, without quotes and escapes.
    Str(String),
    /// A character; a string to Python.
    Char(char),
    /// A time in nanoseconds. `forever` is [`i64::MAX`], `never` is [`i64::MIN`].
    Time(Nanos),
    /// A parameter: of the reactor itself in a state variable, of the container in an assignment.
    Parameter(String),
    /// `[..]`.
    List(Vec<Self>),
    /// `(..)`.
    Tuple(Vec<Self>),
    /// A Python expression.
    Code(Code),
}

impl Value {
    pub(crate) fn new(sources: &Sources, expression: &Expression) -> Self {
        let all =
            |items: &[Expression]| items.iter().map(|item| Self::new(sources, item)).collect();
        match &expression.kind {
            ExpressionKind::Integer(number) => Self::Int(*number),
            ExpressionKind::Float(number) => Self::Float(*number),
            ExpressionKind::Bool(truth) => Self::Bool(*truth),
            ExpressionKind::String(text) => Self::Str(text.clone()),
            ExpressionKind::Character(character) => Self::Char(*character),
            ExpressionKind::Time(nanos) => Self::Time(*nanos),
            ExpressionKind::Parameter(name) => Self::Parameter(name.clone()),
            ExpressionKind::List(items) => Self::List(all(items)),
            ExpressionKind::Tuple(items) => Self::Tuple(all(items)),
            ExpressionKind::Code(body) => Self::Code(code::dedent(sources, *body)),
        }
    }
}
