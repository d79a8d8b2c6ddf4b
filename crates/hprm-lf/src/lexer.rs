//! Text to tokens.
//!
//! Comments are removed, a `{= ... =}` body is one token, and characters that the language does not
//! know are reported once and skipped, so that the parser never sees them.

use std::collections::BTreeSet;

use hprm_model::{Diagnostic, FileId, Report, Span};

use crate::body::{self, End};
use crate::token::{Token, TokenKind};

/// The longest name; names of instances are made of many.
const LONGEST_NAME: usize = 255;

const MARKS: &str = "{}()[]<>,;:.=@+*-/\\?";

/// The tokens of a file.
pub(crate) struct Tokens {
    /// The last one is [`TokenKind::End`].
    pub(crate) all: Vec<Token>,
    /// Whether the end comes too early, because something before it is not closed; that has been
    /// reported.
    pub(crate) cut: bool,
}

/// Reads all tokens of `text`.
pub(crate) fn tokens(file: FileId, text: &str, report: &mut Report) -> Tokens {
    let mut lexer = Lexer { file, text, at: 0, cut: false, foreign: BTreeSet::new(), report };
    let mut all = Vec::new();
    loop {
        let token = lexer.next();
        all.push(token);
        if token.kind == TokenKind::End {
            return Tokens { all, cut: lexer.cut };
        }
    }
}

struct Lexer<'a> {
    file: FileId,
    text: &'a str,
    at: usize,
    cut: bool,
    /// The names with letters that names do not have, which have been reported.
    foreign: BTreeSet<&'a str>,
    report: &'a mut Report,
}

impl Lexer<'_> {
    fn next(&mut self) -> Token {
        loop {
            self.skip_space();
            let start = self.at;
            let kind = self.kind();
            if let Some(kind) = kind {
                return Token { kind, span: Span::new(self.file, start..self.at) };
            }
        }
    }

    fn rest(&self) -> &str {
        &self.text[self.at..]
    }

    /// Reads one token; `None` if what stands here is not one.
    fn kind(&mut self) -> Option<TokenKind> {
        let rest = self.rest();
        let Some(first) = rest.chars().next() else { return Some(TokenKind::End) };
        let second = rest.chars().nth(1);
        let digit = |c: Option<char>| c.is_some_and(|c| c.is_ascii_digit());
        match first {
            _ if rest.starts_with("{=") => return self.body(),
            _ if rest.starts_with("->") => self.take(2, TokenKind::Arrow),
            _ if rest.starts_with("~>") => self.take(2, TokenKind::Squiggle),
            '0'..='9' => self.number(),
            first if is_in_name(first) => {
                let length = rest.find(|c| !is_in_name(c)).unwrap_or(rest.len());
                self.name(length)
            }
            '.' if digit(second) => self.number(),
            '"' => return self.string(),
            '\'' => return self.character(),
            mark if MARKS.contains(mark) => self.take(1, TokenKind::Mark(mark)),
            _ => {
                self.unknown();
                return None;
            }
        }
        .into()
    }

    fn take(&mut self, length: usize, kind: TokenKind) -> TokenKind {
        self.at += length;
        kind
    }

    fn name(&mut self, length: usize) -> TokenKind {
        let name = &self.text[self.at..self.at + length];
        if let Some(letter) = name.chars().find(|c| !c.is_ascii())
            && self.foreign.insert(name)
        {
            let shown: String = name.chars().take(20).collect();
            let span = Span::new(self.file, self.at..self.at + length);
            let message = format!("the name `{shown}` has the letter `{letter}`");
            self.report.add(
                Diagnostic::error("LF0001", span, message)
                    .hint("names have the letters a to z and A to Z, digits and underscores"),
            );
        }
        if length > LONGEST_NAME {
            let span = Span::new(self.file, self.at..self.at + length);
            let message = format!("a name has at most {LONGEST_NAME} characters");
            self.report.add(Diagnostic::error("LF0007", span, message));
            return self.take(length, TokenKind::Identifier);
        }
        self.take(length, TokenKind::Identifier)
    }

    fn skip_space(&mut self) {
        loop {
            let rest = self.rest();
            let blank = rest.len() - rest.trim_start_matches(char::is_whitespace).len();
            if blank > 0 {
                self.at += blank;
            } else if rest.starts_with("//") || rest.starts_with('#') {
                self.at += rest.find('\n').unwrap_or(rest.len());
            } else if rest.starts_with("/*") {
                self.skip_comment("/*", "*/");
            } else if rest.starts_with("'''") {
                self.skip_comment("'''", "'''");
            } else {
                return;
            }
        }
    }

    fn skip_comment(&mut self, open: &str, close: &str) {
        let inside = self.at + open.len();
        match self.text[inside..].find(close) {
            Some(length) => self.at = inside + length + close.len(),
            None => {
                self.unterminated(open.len(), "comment", close);
                self.cut_off();
            }
        }
    }

    fn cut_off(&mut self) {
        self.cut = true;
        self.at = self.text.len();
    }

    fn unterminated(&mut self, opening: usize, what: &str, close: &str) {
        let span = Span::new(self.file, self.at..self.at + opening);
        let message = format!("this {what} has no end");
        self.report.add(
            Diagnostic::error("LF0002", span, message).hint(format!("close it with `{close}`")),
        );
    }

    fn body(&mut self) -> Option<TokenKind> {
        match body::end(self.text, self.at + 2) {
            End::At(end) => {
                self.at = end + 2;
                Some(TokenKind::Code)
            }
            End::Missing { resume, next } => {
                let span = |at| Span::new(self.file, at..at + 2);
                let diagnostic =
                    Diagnostic::error("LF0002", span(self.at), "this code body has no end")
                        .hint("close it with `=}`");
                self.report.add(match next {
                    Some(next) => diagnostic.label(span(next), "the next one begins before that"),
                    None => diagnostic,
                });
                // So that the parser finds a body where it looks for one.
                self.at = resume;
                self.cut = true;
                Some(TokenKind::Code)
            }
        }
    }

    /// `12`, `1.5`, `.5`, `1.5e-3`; but `1.` and `1e5` are not numbers in this language.
    fn number(&mut self) -> TokenKind {
        let bytes = self.text.as_bytes();
        let digits = |mut at: usize| {
            while bytes.get(at).is_some_and(u8::is_ascii_digit) {
                at += 1;
            }
            at
        };
        self.at = digits(self.at);
        if bytes.get(self.at) != Some(&b'.')
            || !bytes.get(self.at + 1).is_some_and(u8::is_ascii_digit)
        {
            return TokenKind::Integer;
        }
        self.at = digits(self.at + 1);
        if matches!(bytes.get(self.at), Some(b'e' | b'E')) {
            let sign = usize::from(matches!(bytes.get(self.at + 1), Some(b'+' | b'-')));
            let exponent = self.at + 1 + sign;
            if digits(exponent) > exponent {
                self.at = digits(exponent);
            }
        }
        TokenKind::Float
    }

    fn string(&mut self) -> Option<TokenKind> {
        if self.rest().starts_with("\"\"\"") {
            let inside = self.at + 3;
            let Some(length) = self.text[inside..].find("\"\"\"") else {
                self.unterminated(3, "string", "\"\"\"");
                self.cut_off();
                return None;
            };
            self.at = inside + length + 3;
            return Some(TokenKind::String);
        }
        match quoted(self.rest(), '"') {
            Ok(length) => Some(self.take(length, TokenKind::String)),
            Err(length) => {
                self.unterminated(1, "string", "\"");
                self.at += length;
                None
            }
        }
    }

    fn character(&mut self) -> Option<TokenKind> {
        let start = self.at;
        let length = match quoted(self.rest(), '\'') {
            Ok(length) => length,
            Err(length) => {
                self.unterminated(1, "character", "'");
                self.at += length;
                return None;
            }
        };
        let inside = &self.text[start + 1..start + length - 1];
        self.at += length;
        let escaped = usize::from(inside.starts_with('\\'));
        if inside.chars().count() == 1 + escaped {
            return Some(TokenKind::Character);
        }
        let span = Span::new(self.file, start..self.at);
        self.report.add(
            Diagnostic::error("LF0005", span, "single quotes hold exactly one character")
                .hint("write a string in double quotes"),
        );
        Some(TokenKind::String)
    }

    fn unknown(&mut self) {
        let start = self.at;
        let known =
            |c: char| is_in_name(c) || c.is_whitespace() || "#\"'".contains(c) || MARKS.contains(c);
        let rest = self.rest();
        let first = rest.chars().next().map_or(0, char::len_utf8);
        let length = rest[first..].find(known).map_or(rest.len(), |more| first + more);
        self.at += length;
        let text: String = self.text[start..self.at].chars().take(20).collect();
        let span = Span::new(self.file, start..self.at);
        let message = format!("`{}` means nothing here", text.escape_debug());
        self.report.add(
            Diagnostic::error("LF0001", span, message)
                .hint("Python code belongs between `{=` and `=}`"),
        );
    }
}

/// Whether a name may go on with this, or was meant to: letters that the language does not have are reported.
fn is_in_name(c: char) -> bool {
    c.is_alphanumeric() || c == '_' || c == '^'
}

/// The length of a literal in quotes that ends on its line, or else of what remains of the line.
fn quoted(text: &str, quote: char) -> Result<usize, usize> {
    let mut escaped = false;
    for (at, c) in text.char_indices().skip(1) {
        match c {
            '\n' => return Err(at),
            _ if escaped => escaped = false,
            '\\' => escaped = true,
            c if c == quote => return Ok(at + 1),
            _ => {}
        }
    }
    Err(text.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kinds(text: &str) -> (Vec<TokenKind>, usize) {
        let mut report = Report::default();
        let tokens = tokens(FileId(0), text, &mut report);
        (tokens.all.into_iter().map(|token| token.kind).collect(), report.into_sorted().len())
    }

    #[test]
    fn every_kind_of_token() {
        use TokenKind::*;
        let (kinds, errors) =
            kinds("a 1 .5 1.5e-3 \"s\" 'c' {= x =} -> ~> ( # c\n /* d */ ''' e ''' // f");
        let expected = vec![
            Identifier,
            Integer,
            Float,
            Float,
            String,
            Character,
            Code,
            Arrow,
            Squiggle,
            Mark('('),
            End,
        ];
        assert_eq!((kinds, errors), (expected, 0));
    }

    #[test]
    fn a_unit_may_touch_its_number_and_1e5_is_not_a_number() {
        use TokenKind::*;
        assert_eq!(kinds("120s 1e5").0, [Integer, Identifier, Integer, Identifier, End]);
        assert_eq!(kinds("1.x").0, [Integer, Mark('.'), Identifier, End]);
    }

    #[test]
    fn a_name_with_foreign_letters_is_a_name_and_is_reported_once() {
        use TokenKind::*;
        assert_eq!(kinds("größe = größe"), (vec![Identifier, Mark('='), Identifier, End], 1));
        assert_eq!(kinds("ä1 x名 2é"), (vec![Identifier, Identifier, Integer, Identifier, End], 3));
    }

    #[test]
    fn what_has_no_end_is_reported_at_its_start() {
        assert_eq!(kinds("{= x"), (vec![TokenKind::Code, TokenKind::End], 1));
        for text in ["/* x", "'''x", "\"x", "\"\"\"x", "'x", "§§ "] {
            assert_eq!(kinds(text), (vec![TokenKind::End], 1), "{text}");
        }
    }
}
