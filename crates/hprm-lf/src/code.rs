//! Python bodies: where `{= ... =}` ends, and how its text is brought to the left margin.
//!
//! The scanner knows just enough Python to step over strings and comments. It accepts whatever
//! Lingua Franca's own lexer accepts, and also what that lexer refuses: single-quoted strings with
//! `=}` in them and floor division.

mod tokens;

use crate::source::{FileId, Sources, Span};
use crate::unclosed;
pub(crate) use tokens::{Token, canonical, tokens};

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

/// Where a body ends.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum End {
    /// Offset of the `=}` that ends it.
    At(usize),
    /// It has none. The text of the language goes on at `resume`; `next` is the body that begins
    /// inside, if there is one.
    Missing { resume: usize, next: Option<usize> },
}

/// The end of the body whose text starts at `start`.
pub(crate) fn end(text: &str, start: usize) -> End {
    let mut scanner = Scanner { bytes: text.as_bytes(), wasted: 0 };
    let mut at = start;
    while at < scanner.bytes.len() {
        if scanner.bytes[at..].starts_with(b"=}") {
            return End::At(at);
        }
        if scanner.bytes[at..].starts_with(b"{=") {
            return missing(text, start, (at, Some(at)));
        }
        at = scanner.skip(at);
    }
    missing(text, start, (text.len(), None))
}

/// A body from `start` that has no end before `limit`.
fn missing(text: &str, start: usize, (limit, next): (usize, Option<usize>)) -> End {
    let mut code = Vec::new();
    let mut scanner = Scanner { bytes: text.as_bytes(), wasted: 0 };
    let (mut at, mut depth) = (start, 0_usize);
    while at < limit {
        if depth == 0 {
            code.push(at);
        }
        match scanner.bytes[at] {
            b'(' | b'[' | b'{' => depth += 1,
            b')' | b']' | b'}' => depth = depth.saturating_sub(1),
            _ => {}
        }
        at = scanner.skip(at);
    }
    let is_code = |offset| code.binary_search(&offset).is_ok();
    End::Missing { resume: unclosed::resume(text, start, limit, is_code), next }
}

/// The most bytes that are looked through for ends of strings that have none; after that, a quote
/// is a character like any other.
const MAX_WASTED: usize = 1 << 20;

/// Steps over the pieces of some Python, in time that grows with its length only.
struct Scanner<'t> {
    bytes: &'t [u8],
    wasted: usize,
}

impl Scanner<'_> {
    /// Steps over the string, the comment or the character at `at`.
    fn skip(&mut self, at: usize) -> usize {
        match self.bytes[at] {
            b'#' => line_end(self.bytes, at),
            quote @ (b'"' | b'\'') if self.wasted < MAX_WASTED => string_end(self.bytes, at, quote)
                .unwrap_or_else(|looked| {
                    self.wasted += looked;
                    at + 1
                }),
            _ => at + 1,
        }
    }
}

fn line_end(bytes: &[u8], at: usize) -> usize {
    bytes[at..].iter().position(|byte| *byte == b'\n').map_or(bytes.len(), |n| at + n)
}

/// Behind the string that starts at `at`; or how many bytes were looked at if it is not closed,
/// which is for Python to report.
fn string_end(bytes: &[u8], at: usize, quote: u8) -> Result<usize, usize> {
    let triple = [quote; 3];
    let long = bytes[at..].starts_with(&triple);
    let mut here = at + if long { 3 } else { 1 };
    while here < bytes.len() {
        match bytes[here] {
            b'\\' => here += 1,
            b'\n' if !long => return Err(here - at),
            byte if byte == quote && !long => return Ok(here + 1),
            byte if byte == quote && bytes[here..].starts_with(&triple) => return Ok(here + 3),
            _ => {}
        }
        here += 1;
    }
    Err(bytes.len() - at)
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
    let mut scanner = Scanner { bytes, wasted: 0 };
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

fn continued(line: &[u8]) -> bool {
    line.strip_suffix(b"\r").unwrap_or(line).ends_with(b"\\")
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
        let End::At(end) = end(text, start) else { panic!("{text}") };
        let file = sources.add("a.lf", text.to_owned());
        dedent(&sources, Span::new(file, start..end))
    }

    #[test]
    fn a_body_ends_outside_strings_and_comments() {
        for inside in [
            "",
            " x ",
            "\"=}\"",
            "'=}'",
            "f'{x=}'",
            "'''\n=}\n'''",
            "\"\"\" \" =} \"\"\"",
            "# =}\n",
            "'\\'=}'",
            "7 // 2 ",
            " = ",
            "{}",
            "r'\\' ",
            "don't ",
            "\"\"",
        ] {
            let text = format!("{{={inside}=}} rest =}}");
            assert_eq!(end(&text, 2), End::At(2 + inside.len()), "{text}");
        }
        assert_eq!(end("{= x }", 2), End::Missing { resume: 6, next: None });
        let missing = |resume, next| End::Missing { resume, next: Some(next) };
        assert_eq!(end("{= '{='\n}\n  reaction(){==}", 2), missing(9, 22));
        assert_eq!(end("{= ({\n}\n)\n  a=[{=", 2), missing(10, 15));
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
