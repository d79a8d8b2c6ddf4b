//! Python bodies: how their text is brought to the left margin.

use crate::python::{Scanner, continued};
use crate::source::{FileId, Sources, Span};

/// A piece of Python, ready to be compiled.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub struct Code {
    /// The text at the left margin, without a newline at its end. Empty for an empty body.
    pub text: String,
    /// The file that holds it.
    pub file: FileId,
    /// The line of the file that the first line of `text` comes from, from 1.
    pub line: u32,
    /// How many columns of that line precede the text. Unless the text starts right behind the
    /// brace, later lines lost as many, if they had them; lines inside a string lost none.
    pub column: u32,
}

impl Code {
    /// Whether there is nothing to run.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.text.is_empty()
    }
}

/// How the start of a line relates to the Python around it.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Start {
    /// A statement may start here: its indentation counts.
    Statement,
    /// Inside brackets or behind a backslash: Python ignores the indentation.
    Bracket,
    /// Inside a string: the indentation is part of a value.
    String,
}

fn starts(raw: &str) -> Vec<Start> {
    let bytes = raw.as_bytes();
    let mut scanner = Scanner::new(raw);
    let mut starts = vec![Start::Statement];
    let (mut at, mut depth) = (0, 0_usize);
    while at < bytes.len() {
        let next = scanner.skip(at);
        match bytes[at] {
            b'(' | b'[' | b'{' => depth += 1,
            b')' | b']' | b'}' => depth = depth.saturating_sub(1),
            b'\n' if depth > 0 || continued(&bytes[..at]) => starts.push(Start::Bracket),
            b'\n' => starts.push(Start::Statement),
            _ => {
                let inside = bytes[at..next.min(bytes.len())].iter().filter(|b| **b == b'\n');
                starts.extend(inside.map(|_| Start::String));
            }
        }
        at = next;
    }
    starts
}

/// The Python between the braces of the body at `inner`.
///
/// Blank lines at both ends go; what all statements have in common in front of them goes; text in
/// strings stays as it is.
pub(crate) fn dedent(sources: &Sources, inner: Span) -> Code {
    let raw = sources.slice(inner);
    let at = sources.position(inner);
    let code = |text, line, column| Code { text, file: inner.file, line, column };
    let trimmed = raw.trim();
    if trimmed.is_empty() {
        return code(String::new(), at.line, 0);
    }
    let count = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
    let starts = starts(raw);
    let lines: Vec<&str> = raw.split('\n').collect();
    let kept = |line: &&str| !line.trim().is_empty();
    let first = lines.iter().position(kept).unwrap_or(0);
    let last = lines.iter().rposition(kept).unwrap_or(first);
    let indent = |line: &str| line.len() - line.trim_start_matches([' ', '\t']).len();
    let common = (first..=last)
        .filter(|i| starts.get(*i) == Some(&Start::Statement))
        .map(|i| lines[i])
        .filter(|line| kept(line) && !line.trim_start().starts_with('#'))
        .map(indent)
        .min()
        .unwrap_or(indent(lines[first]));
    let dedented: Vec<&str> = (first..=last)
        .map(|i| match starts.get(i) {
            Some(Start::String) => lines[i],
            _ => &lines[i][indent(lines[i]).min(common)..],
        })
        .map(|line| line.strip_suffix('\r').unwrap_or(line))
        .collect();
    let before = if first == 0 { at.column - 1 } else { 0 };
    let text = dedented.join("\n").trim_end().to_owned();
    code(text, at.line + count(first), before + count(common))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn body(text: &str) -> Code {
        let mut sources = Sources::new();
        let start = text.find("{=").unwrap() + 2;
        let end = text.rfind("=}").unwrap();
        let file = sources.add("a.lf", text.to_owned());
        dedent(&sources, Span::new(file, start..end))
    }

    #[test]
    fn a_line_is_trimmed_and_its_column_kept() {
        let code = body("\n  reaction(a) {=  f(x)  =}");
        assert_eq!((code.text.as_str(), code.line, code.column), ("f(x)", 2, 18));
    }

    #[test]
    fn statements_move_to_the_margin() {
        let code = body("a {=\n\n    if x:\n      y\n  # low\n    z(\n  1)\n    a = \\\n  b\n  =}");
        assert_eq!(code.text, "if x:\n  y\n# low\nz(\n1)\na = \\\nb");
        assert_eq!((code.line, code.column), (3, 4));
    }

    #[test]
    fn text_in_strings_stays() {
        let code = body("{=\n    x = \"\"\"\n      a\n  b\"\"\"\n    y\n=}");
        assert_eq!(code.text, "x = \"\"\"\n      a\n  b\"\"\"\ny");
    }

    #[test]
    fn carriage_returns_and_empty_bodies() {
        assert_eq!(body("{=\r\n  a\r\n  b\r\n=}").text, "a\nb");
        assert!(body("{==}").is_empty());
        assert!(body("{=  \n =}").is_empty());
    }
}
