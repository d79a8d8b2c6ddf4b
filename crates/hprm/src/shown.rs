//! Texts that other processes and machines choose, and that people see: without characters by which a terminal does something, or
//! that make a text look like another one.
//!
//! What a federate itself writes is not among them: it reaches the terminal of its user as it is.

use std::borrow::Cow;

use serde::{Deserialize, Deserializer};

/// A text on one line, in which such characters are escaped, as in `\u{1b}`.
#[must_use]
pub fn printable(text: &str) -> Cow<'_, str> {
    escaped(text, acts)
}

/// The same for a text that may have several lines.
#[must_use]
pub fn printable_lines(text: &str) -> Cow<'_, str> {
    escaped(text, |c| acts(c) && !matches!(c, '\n' | '\t'))
}

fn escaped(text: &str, is_meant: impl Fn(char) -> bool) -> Cow<'_, str> {
    if !text.contains(&is_meant) {
        return Cow::Borrowed(text);
    }
    let mut escaped = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        match is_meant(c) {
            true => escaped.extend(c.escape_default()),
            false => escaped.push(c),
        }
    }
    Cow::Owned(escaped)
}

/// Whether a terminal does not show a character as itself: it controls something, ends a line, or turns the direction of others.
fn acts(c: char) -> bool {
    let turns = matches!(
        c,
        '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}'
    );
    c.is_control() || turns
}

/// Reads a text for people from another process.
pub(crate) fn text<'de, D: Deserializer<'de>>(from: D) -> Result<String, D::Error> {
    Ok(printable(&String::deserialize(from)?).into_owned())
}

/// The same, if there is one.
pub(crate) fn maybe<'de, D: Deserializer<'de>>(from: D) -> Result<Option<String>, D::Error> {
    Ok(Option::<String>::deserialize(from)?.map(|text| printable(&text).into_owned()))
}

/// The same for several.
pub(crate) fn all<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<String>, D::Error> {
    let texts = Vec::<String>::deserialize(from)?;
    Ok(texts.iter().map(|text| printable(text).into_owned()).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_acts_on_a_terminal_is_escaped_and_all_else_is_as_it_was() {
        for (text, shown) in [
            ("camera[1].out ~> für 日本 👩‍🚀 \\ \"x\"", None),
            ("\x1b[2J\x07", Some(r"\u{1b}[2J\u{7}")),
            ("\u{9b}31m\u{7f}", Some(r"\u{9b}31m\u{7f}")),
            ("a\r\nb\tc", Some(r"a\r\nb\tc")),
            ("a\u{202e}b\u{2066}", Some(r"a\u{202e}b\u{2066}")),
        ] {
            assert_eq!(printable(text), shown.unwrap_or(text));
            // Once more changes nothing.
            assert_eq!(printable(&printable(text)), printable(text));
        }
        assert_eq!(printable_lines("a\n\tb\x1b"), "a\n\tb\\u{1b}");
    }
}
