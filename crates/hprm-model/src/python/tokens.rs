//! Python as a list of tokens: what is left of it without comments and spaces.
//!
//! Two texts with equal tokens do the same. The opposite does not hold: this knows where strings end
//! and where statements begin, and no more of the language.

use super::{Scanner, continued};

/// A piece of Python.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Token<'t> {
    /// A statement begins, so many blocks deep.
    Line(usize),
    /// A word, a number, a string, or a character of an operator.
    Text(&'t str),
}

/// The tokens of `text`.
#[must_use]
pub fn tokens(text: &str) -> Vec<Token<'_>> {
    let mut reader = Reader {
        text,
        scanner: Scanner::new(text),
        at: 0,
        depth: 0,
        line: 0,
        ended: true,
        indents: vec![0],
        tokens: Vec::new(),
    };
    while reader.at < text.len() {
        reader.step();
    }
    reader.tokens
}

/// The tokens of `text` as one text, which is the same for texts that differ in comments and spaces.
#[must_use]
pub fn canonical(text: &str) -> String {
    let mut canonical = String::with_capacity(text.len());
    for token in tokens(text) {
        match token {
            Token::Line(level) => canonical.push_str(&format!("\n{level}")),
            Token::Text(token) => {
                canonical.push(' ');
                canonical.push_str(token);
            }
        }
    }
    canonical
}

struct Reader<'t> {
    text: &'t str,
    scanner: Scanner<'t>,
    at: usize,
    /// How many brackets are open.
    depth: usize,
    /// Where the line starts.
    line: usize,
    /// Whether the statement before has ended.
    ended: bool,
    /// The columns of the blocks that are open.
    indents: Vec<usize>,
    tokens: Vec<Token<'t>>,
}

impl<'t> Reader<'t> {
    fn step(&mut self) {
        let bytes = self.text.as_bytes();
        match bytes[self.at] {
            b'\n' => {
                self.ended |= self.depth == 0 && !continued(&bytes[..self.at]);
                self.at += 1;
                self.line = self.at;
            }
            b'#' => self.at = self.scanner.skip(self.at),
            b' ' | b'\t' | b'\r' | b'\x0c' => self.at += 1,
            // The line goes on.
            b'\\' if self.text[self.at + 1..].starts_with(['\n', '\r']) => self.at += 1,
            _ => self.token(),
        }
    }

    fn token(&mut self) {
        if std::mem::take(&mut self.ended) {
            self.statement();
        }
        let bytes = self.text.as_bytes();
        let start = self.at;
        match bytes[start] {
            b'(' | b'[' | b'{' => self.depth += 1,
            b')' | b']' | b'}' => self.depth = self.depth.saturating_sub(1),
            _ => {}
        }
        let mut end = start;
        while bytes.get(end).is_some_and(|byte| is_word(*byte)) {
            end += 1;
        }
        let prefix = &self.text[start..end];
        let quoted = matches!(bytes.get(end), Some(b'"' | b'\''));
        if quoted && is_prefix(prefix) {
            let quote = end;
            end = self.scanner.skip(quote).min(bytes.len());
            if prefix.contains(['f', 'F', 't', 'T']) && !is_balanced(&self.text[quote..end]) {
                // A string within the string may end it or not, which depends on the version of
                // Python. So all that follows counts as it is.
                end = bytes.len();
            }
        } else if end == start {
            end += 1;
        }
        self.tokens.push(Token::Text(self.text[start..end].trim_end()));
        self.at = end;
    }

    fn statement(&mut self) {
        let mut column = 0;
        for byte in self.text[self.line..self.at].bytes() {
            column = if byte == b'\t' { column / 8 * 8 + 8 } else { column + 1 };
        }
        while self.indents.last().is_some_and(|indent| *indent > column) {
            self.indents.pop();
        }
        if self.indents.last().is_none_or(|indent| *indent < column) {
            self.indents.push(column);
        }
        self.tokens.push(Token::Line(self.indents.len()));
    }
}

fn is_word(byte: u8) -> bool {
    byte.is_ascii_alphanumeric() || byte == b'_' || !byte.is_ascii()
}

/// Whether these letters before a quote belong to the string.
fn is_prefix(word: &str) -> bool {
    word.len() <= 2 && word.bytes().all(|byte| b"rRbBuUfFtT".contains(&byte))
}

/// Whether the braces of a formatted string are closed within it.
fn is_balanced(text: &str) -> bool {
    let open = text.bytes().filter(|byte| *byte == b'{').count();
    open == text.bytes().filter(|byte| *byte == b'}').count()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn comments_and_spaces_do_not_count() {
        let same = [
            "if x:\n  y = [1,\n 2]\n  z()\nw()",
            "if x :  # why\n\n\ty=[ 1, 2 ]\n\n\tz( )\n# end\nw()  \n",
            "if \\\n x:\r\n      y = [1, # one\n 2]\n      z()\n\nw()",
        ];
        for text in same {
            assert_eq!(canonical(text), canonical(same[0]), "{text:?}");
        }
    }

    #[test]
    fn what_may_mean_something_else_counts() {
        let different = [
            "if x:\n  y()\n  z()",
            "if x:\n  y()\nz()",
            "if x: y()\nz()",
            "ifx: y(); z()",
            "a = 'b  c'",
            "a = 'b c'",
            "a = 'b c' # d",
            "a = '# d'",
            "a = '''b\n  c'''",
            "a = '''b\nc'''",
            "is not a",
            "isnot a",
            "b'a'",
            "'a'",
            "f(a)\n(b)",
            "f(a)(b)",
            "f\"{d[\"a b\"]}\"",
            "f\"{d[\"a  b\"]}\"",
        ];
        let mut seen = std::collections::BTreeMap::new();
        for text in different {
            if let Some(other) = seen.insert(canonical(text), text) {
                assert_eq!((text, other), ("a = 'b c' # d", "a = 'b c'"));
            }
        }
    }

    proptest! {
        #[test]
        fn any_text_has_tokens(text in "[a-z'\"{}()#\\\\ \n\t=éf]{0,60}") {
            let once = canonical(&text);
            let spaced = text.replace('\n', "\n\n") + "\n# more\n";
            if !text.contains(['\'', '"', '\\']) {
                prop_assert_eq!(once, canonical(&spaced));
            }
        }
    }
}
