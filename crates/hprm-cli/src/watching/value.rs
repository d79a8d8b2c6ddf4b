//! A value as one line of text, as Python would write it; what is long is cut, and arrays are summarized.

use std::fmt::Write as _;

use hprm::watch::Unseen;
use hprm::{Dynamic, DynamicArray};

use super::summary::Summary;

/// How much of a value is shown.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Limits {
    /// Characters of a text.
    characters: usize,
    /// Bytes of a byte string.
    bytes: usize,
    /// Members of a list, a tuple or a dict.
    members: usize,
    /// Elements of an array.
    elements: usize,
    /// How deep containers are within one another.
    depth: usize,
}

impl Limits {
    /// What fits into a line or two.
    pub(super) const SHORT: Self =
        Self { characters: 200, bytes: 32, members: 20, elements: 6, depth: 8 };
    /// Everything.
    pub(super) const NONE: Self = Self {
        characters: usize::MAX,
        bytes: usize::MAX,
        members: usize::MAX,
        elements: usize::MAX,
        depth: usize::MAX,
    };
}

/// What is shown of a value.
pub(super) fn text(value: &Result<Dynamic, Unseen>, limits: Limits) -> String {
    match value {
        Ok(value) => {
            let mut text = String::new();
            append(value, limits, &mut text);
            text
        }
        Err(unseen) => why(unseen),
    }
}

/// Why there is no value.
pub(super) fn why(unseen: &Unseen) -> String {
    match unseen {
        Unseen::TooLarge => {
            "(its arrays are larger than what watchers may hold: an eighth of store-limit)"
                .to_owned()
        }
        Unseen::Unencodable(reason) => format!("(it has no encoding: {reason})"),
        Unseen::Pickle { names: Some(class) } => format!("(a pickle of {class})"),
        Unseen::Pickle { names: None } => "(a pickle)".to_owned(),
        Unseen::Unreadable(reason) => format!("(only Python can read it: {reason})"),
    }
}

fn append(value: &Dynamic, limits: Limits, out: &mut String) {
    match value {
        Dynamic::None => out.push_str("None"),
        Dynamic::Bool(value) => out.push_str(if *value { "True" } else { "False" }),
        Dynamic::Int(number) => push(out, number),
        Dynamic::Unsigned(number) => push(out, number),
        Dynamic::Float(number) => out.push_str(&float(*number)),
        Dynamic::Str(text) => string(text, limits, out),
        Dynamic::Bytes(bytes) => byte_string(bytes, limits, out),
        Dynamic::List(members) => container(("[", "]"), members, limits, out, append),
        Dynamic::Tuple(members) => container(("(", ")"), members, limits, out, append),
        Dynamic::Dict(entries) => {
            container(("{", "}"), entries, limits, out, |(key, value), limits, out| {
                append(key, limits, out);
                out.push_str(": ");
                append(value, limits, out);
            });
        }
        Dynamic::Array(array) => summarized(array, limits, out),
    }
}

fn push(out: &mut String, value: &impl std::fmt::Display) {
    write!(out, "{value}").expect("a string takes everything");
}

/// A number as Python writes it: `1.0`, not `1`.
pub(super) fn float(number: f64) -> String {
    match number {
        _ if number.is_nan() => "nan".to_owned(),
        _ if number.is_infinite() => if number > 0.0 { "inf" } else { "-inf" }.to_owned(),
        _ => format!("{number:?}"),
    }
}

fn string(text: &str, limits: Limits, out: &mut String) {
    let end = text.char_indices().nth(limits.characters).map(|(at, _)| at);
    push(out, &format_args!("{:?}", &text[..end.unwrap_or(text.len())]));
    if end.is_some() {
        push(out, &format_args!("... ({} characters)", text.chars().count()));
    }
}

fn byte_string(bytes: &[u8], limits: Limits, out: &mut String) {
    let shown = &bytes[..bytes.len().min(limits.bytes)];
    push(out, &format_args!("b\"{}\"", shown.escape_ascii()));
    if shown.len() < bytes.len() {
        push(out, &format_args!("... ({} bytes)", bytes.len()));
    }
}

fn container<T>(
    (open, close): (&str, &str),
    members: &[T],
    limits: Limits,
    out: &mut String,
    member: impl Fn(&T, Limits, &mut String),
) {
    out.push_str(open);
    if limits.depth == 0 && !members.is_empty() {
        out.push_str("...");
    } else {
        let inner = Limits { depth: limits.depth.saturating_sub(1), ..limits };
        for (at, one) in members.iter().take(limits.members).enumerate() {
            out.push_str(if at == 0 { "" } else { ", " });
            member(one, inner, out);
        }
        if members.len() > limits.members {
            push(out, &format_args!(", ... ({} in all)", members.len()));
        } else if open == "(" && members.len() == 1 {
            out.push(',');
        }
    }
    out.push_str(close);
}

/// `array(float32 480x640, 0.0 to 1.0, mean 0.5: 0.0, 0.25, ...)`.
fn summarized(array: &DynamicArray, limits: Limits, out: &mut String) {
    let Summary { dtype, shape, range, not_numbers, first, len } =
        Summary::of(array, limits.elements);
    let lengths: Vec<_> = shape.iter().map(ToString::to_string).collect();
    push(out, &format_args!("array({dtype} {}", lengths.join("x")));
    if shape.is_empty() {
        // An array without dimensions has one element.
        out.truncate(out.trim_end().len());
    }
    if let Some(range) = range {
        push(out, &format_args!(", {} to {}, mean {}", range.min, range.max, digits(range.mean)));
    }
    if not_numbers > 0 {
        push(out, &format_args!(", {not_numbers} nan"));
    }
    if len > 0 {
        push(out, &format_args!(": {}", first.join(", ")));
    }
    out.push_str(if first.len() < len { ", ...)" } else { ")" });
}

/// Six digits of a number.
fn digits(number: f64) -> String {
    let rounded = format!("{number:.5e}");
    rounded.parse().map_or(rounded, float)
}

#[cfg(test)]
mod tests {
    use hprm::Array;

    use super::*;

    fn shown(value: Dynamic) -> String {
        text(&Ok(value), Limits::SHORT)
    }

    fn array(array: impl Into<DynamicArray>) -> String {
        shown(Dynamic::Array(array.into()))
    }

    #[test]
    fn values_look_as_in_python() {
        let dict = Dynamic::Dict(vec![
            (Dynamic::Str("a\n".to_owned()), Dynamic::List(vec![Dynamic::Int(1), Dynamic::None])),
            (Dynamic::Float(1.0), Dynamic::Tuple(vec![Dynamic::Bool(true)])),
            (Dynamic::Int(2), Dynamic::Bytes(b"x\0".to_vec())),
        ]);
        assert_eq!(shown(dict), r#"{"a\n": [1, None], 1.0: (True,), 2: b"x\x00"}"#);
        assert_eq!(shown(Dynamic::Float(f64::NAN)), "nan");
    }

    #[test]
    fn what_is_long_is_cut() {
        assert_eq!(
            shown(Dynamic::List((0..100).map(Dynamic::Int).collect())),
            "[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, ... (100 in all)]"
        );
        let text = shown(Dynamic::Str("ä".repeat(300)));
        assert_eq!(text, format!("\"{}\"... (300 characters)", "ä".repeat(200)));
        assert!(shown(Dynamic::Bytes(vec![65; 1000])).ends_with("AAA\"... (1000 bytes)"));
        let mut deep = Dynamic::Int(1);
        for _ in 0..50 {
            deep = Dynamic::List(vec![deep]);
        }
        assert_eq!(shown(deep), "[[[[[[[[[...]]]]]]]]]");
    }

    #[test]
    fn arrays_are_summarized() {
        assert_eq!(
            array(Array::from_shape_vec(&[2, 4], vec![0_u8, 1, 2, 3, 4, 5, 6, 7]).unwrap()),
            "array(uint8 2x4, 0 to 7, mean 3.5: 0, 1, 2, 3, 4, 5, ...)"
        );
        assert_eq!(
            array(Array::from(vec![0.5_f32, f32::NAN, -1.0])),
            "array(float32 3, -1.0 to 0.5, mean -0.25, 1 nan: 0.5, nan, -1.0)"
        );
        assert_eq!(array(Array::from(Vec::<f64>::new())), "array(float64 0)");
        assert_eq!(
            array(Array::from_shape_vec(&[], vec![7_i64]).unwrap()),
            "array(int64, 7 to 7, mean 7.0: 7)"
        );
        assert_eq!(
            array(Array::from(vec![true, false])),
            "array(bool 2, False to True, mean 0.5: True, False)"
        );
        assert_eq!(array(Array::from(vec![[1.0_f32, -2.0]])), "array(complex64 1: (1.0-2.0j))");
    }
}
