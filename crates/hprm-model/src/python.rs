//! Python, as far as its text has to be understood: strings, comments and tokens.
//!
//! The scanner knows just enough Python to step over strings and comments. It accepts whatever
//! Lingua Franca's own lexer accepts, and also what that lexer refuses: single-quoted strings with
//! `=}` in them and floor division.

mod tokens;

pub use tokens::{Token, canonical, tokens};

/// The most bytes that are looked through for ends of strings that have none; after that, a quote
/// is a character like any other.
const MAX_WASTED: usize = 1 << 20;

/// Steps over the pieces of some Python, in time that grows with its length only.
#[derive(Clone, Debug)]
pub struct Scanner<'t> {
    bytes: &'t [u8],
    wasted: usize,
}

impl<'t> Scanner<'t> {
    /// A scanner of `text`.
    #[must_use]
    pub fn new(text: &'t str) -> Self {
        Self { bytes: text.as_bytes(), wasted: 0 }
    }

    /// The offset behind the string, the comment or the character at the offset `at`, which is before the
    /// end of the text.
    pub fn skip(&mut self, at: usize) -> usize {
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

/// Whether the line that ends here goes on in the next one, behind a backslash.
pub(crate) fn continued(line: &[u8]) -> bool {
    line.strip_suffix(b"\r").unwrap_or(line).ends_with(b"\\")
}
