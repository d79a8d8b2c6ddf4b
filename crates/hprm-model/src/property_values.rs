//! Reading the values of target properties: times, truth values, words, numbers and sizes.
//!
//! What a property means is decided by the modules that read it.

use hprm_core::{Nanos, read_size};

use crate::declaration::{Element, ElementKind, ExpressionKind};

/// A value, or what it must be.
pub type Read<T> = Result<T, &'static str>;

/// Reads the value of a property that is a time.
///
/// # Errors
///
/// What it must be, if it is not that.
pub fn time(value: &Element) -> Read<Nanos> {
    match &value.kind {
        ElementKind::Value(expression) => match expression.kind {
            ExpressionKind::Time(nanos) if nanos >= 0 => Ok(nanos),
            ExpressionKind::Integer(0) => Ok(0),
            ExpressionKind::Time(_) => Err("a time that is not negative, such as `10 s`"),
            _ => Err("a time, such as `10 s`"),
        },
        _ => Err("a time, such as `10 s`"),
    }
}

pub(crate) fn boolean(value: &Element) -> Read<bool> {
    match &value.kind {
        ElementKind::Value(expression) => match expression.kind {
            ExpressionKind::Bool(truth) => Ok(truth),
            _ => Err("`true` or `false`"),
        },
        _ => Err("`true` or `false`"),
    }
}

/// The text of a value that is a word without quotes, or a string.
pub(crate) fn word(value: &Element) -> Option<&str> {
    match &value.kind {
        ElementKind::Path(word) => Some(word),
        ElementKind::Value(expression) => match &expression.kind {
            ExpressionKind::String(text) => Some(text),
            _ => None,
        },
        _ => None,
    }
}

pub(crate) fn integer(value: &Element) -> Option<i64> {
    match &value.kind {
        ElementKind::Value(expression) => match expression.kind {
            ExpressionKind::Integer(number) => Some(number),
            _ => None,
        },
        _ => None,
    }
}

pub(crate) fn size(value: &Element) -> Read<u64> {
    let size = match &value.kind {
        ElementKind::Value(expression) => match expression.kind {
            ExpressionKind::Integer(number) => u64::try_from(number).ok(),
            _ => None,
        },
        _ => None,
    };
    size.or_else(|| read_size(word(value)?))
        .ok_or("a size, which is a whole number with a unit, such as `\"2 GB\"`")
}
