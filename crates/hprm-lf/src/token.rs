//! The tokens of a `.lf` file.
//!
//! Keywords are identifiers here: which words are special depends on the place, which the parser
//! knows.

use hprm_model::Span;

/// What a token is.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum TokenKind {
    /// A name or a keyword.
    Identifier,
    /// Digits.
    Integer,
    /// Digits with a point, perhaps an exponent.
    Float,
    /// `"..."` or `"""..."""`, with its quotes.
    String,
    /// `'x'`, with its quotes.
    Character,
    /// `{= ... =}`, with its braces.
    Code,
    /// `->`.
    Arrow,
    /// `~>`.
    Squiggle,
    /// Any other single character that the language uses.
    Mark(char),
    /// The end of the file.
    End,
}

/// A token and where it is.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Token {
    pub(crate) kind: TokenKind,
    pub(crate) span: Span,
}
