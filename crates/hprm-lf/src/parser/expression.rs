//! Expressions: literals, times, parameters, lists and code.

use hprm_model::declaration::{Expression, ExpressionKind, Name};
use hprm_model::{Diagnostic, Span};

use super::{Parsed, Parser};
use crate::literal;
use crate::token::TokenKind;

impl Parser<'_> {
    pub(super) fn is_boolean(&self) -> bool {
        ["true", "True", "false", "False"].iter().any(|word| self.is_word(word))
    }

    pub(super) fn is_endless(&self) -> bool {
        self.is_word("forever") || self.is_word("never")
    }

    pub(super) fn expression(&mut self) -> Parsed<Expression> {
        let start = self.token().span;
        let kind = match self.token().kind {
            TokenKind::Integer => self.integer_or_time(false)?,
            TokenKind::Float => self.float(false)?,
            TokenKind::Mark('-') => {
                self.advance();
                match self.token().kind {
                    TokenKind::Integer => self.integer_or_time(true)?,
                    TokenKind::Float => self.float(true)?,
                    _ => return self.fail("a number"),
                }
            }
            TokenKind::String => ExpressionKind::String(self.string().text),
            TokenKind::Character => {
                let text = self.string().text;
                ExpressionKind::Character(text.chars().next().unwrap_or_default())
            }
            TokenKind::Code => ExpressionKind::Code(self.code()?),
            TokenKind::Mark('[') => ExpressionKind::List(self.expressions('[', ']')?),
            TokenKind::Mark('{') => {
                return self.lose(
                    Diagnostic::error("LF0006", start, "braces alone make no value in Python")
                        .hint("write a dict or a set as `{= {...} =}`, and a list as `[...]`"),
                );
            }
            TokenKind::Mark('(') => ExpressionKind::Tuple(self.expressions('(', ')')?),
            TokenKind::Identifier => self.word()?,
            _ => return self.fail("a value"),
        };
        Ok(Expression { kind, span: start.to(self.previous()) })
    }

    fn expressions(&mut self, open: char, close: char) -> Parsed<Vec<Expression>> {
        self.nested(|parser| parser.enclosed((open, close), Self::expression))
    }

    fn word(&mut self) -> Parsed<ExpressionKind> {
        let boolean = self.is_boolean();
        let name = self.name("a value")?;
        Ok(match name.text.as_str() {
            "forever" => ExpressionKind::Time(i64::MAX),
            "never" => ExpressionKind::Time(i64::MIN),
            text if boolean => ExpressionKind::Bool(text.eq_ignore_ascii_case("true")),
            _ if self.goes_on_as_python(name.span) => {
                let message = format!("`{}` begins what only Python understands", name.text);
                return self.lose(
                    Diagnostic::error("LF0006", name.span, message)
                        .hint("write it between `{=` and `=}`"),
                );
            }
            _ => ExpressionKind::Parameter(name.text),
        })
    }

    /// Whether an attribute or a call follows a name without a gap: `np.pi`, `dict()`.
    fn goes_on_as_python(&self, name: Span) -> bool {
        let next = self.token();
        next.span.start == name.end && matches!(next.kind, TokenKind::Mark('.' | '('))
    }

    fn integer_or_time(&mut self, negative: bool) -> Parsed<ExpressionKind> {
        let token = self.advance();
        let parsed: Option<i64> = self.text_of(token).parse().ok();
        let Some(magnitude) = parsed else {
            return self.lose(
                Diagnostic::error("LF0005", token.span, "this number is too large")
                    .hint("whole numbers have 64 bits; the value of a parameter or state variable may be larger, as `{= ... =}`"),
            );
        };
        let number = if negative { -magnitude } else { magnitude };
        if !self.is(TokenKind::Identifier) || self.starts_clause() {
            return Ok(ExpressionKind::Integer(number));
        }
        let unit = self.name("a unit of time")?;
        let Some(nanos) = literal::unit(&unit.text) else {
            let message = format!("`{}` is not a unit of time", unit.text);
            return self.lose(
                Diagnostic::error("LF0401", unit.span, message)
                    .hint("units: ns, us, ms, s, min, hour, day, week"),
            );
        };
        match number.checked_mul(nanos) {
            Some(time) => Ok(ExpressionKind::Time(time)),
            None => self.lose(
                Diagnostic::error("LF0402", token.span.to(unit.span), "this time is too long")
                    .hint("times reach 292 years; `forever` is longer"),
            ),
        }
    }

    /// Whether the word behind a number starts the next clause or statement instead of naming a
    /// unit.
    fn starts_clause(&self) -> bool {
        let (number, word) = (self.previous(), self.token());
        let between = &self.text[number.end as usize..word.span.start as usize];
        if between.is_empty() {
            return false;
        }
        let next = self.peek(1).kind;
        self.starts_member()
            || self.is_word("serializer")
            || matches!(next, TokenKind::Mark('.' | '=') | TokenKind::Arrow | TokenKind::Squiggle)
            || between.contains('\n') && literal::unit(self.text_of(word)).is_none()
    }

    fn float(&mut self, negative: bool) -> Parsed<ExpressionKind> {
        let token = self.advance();
        match self.text_of(token).parse::<f64>() {
            Ok(number) if self.is_unit() => self.broken_time(token.span, number),
            Ok(number) => Ok(ExpressionKind::Float(if negative { -number } else { number })),
            Err(_) => self.lose(Diagnostic::error("LF0005", token.span, "this is not a number")),
        }
    }

    fn is_unit(&self) -> bool {
        self.is(TokenKind::Identifier) && literal::unit(self.text_of(self.token())).is_some()
    }

    /// `0.5 ms`, at whose unit the cursor is.
    fn broken_time(&mut self, number: Span, magnitude: f64) -> Parsed<ExpressionKind> {
        let unit = self.advance();
        let message = "a time is a whole number of a unit";
        let smaller = literal::smaller(magnitude, self.text_of(unit));
        self.lose(
            Diagnostic::error("LF0401", number.to(unit.span), message)
                .maybe_hint(smaller.map(|time| format!("write `{time}`"))),
        )
    }

    /// The contents of a string or a character, which stands at the cursor.
    pub(super) fn string(&mut self) -> Name {
        let Span { file, start, end } = self.token().span;
        let token = self.advance();
        let text = self.text_of(token);
        let quotes = if text.starts_with("\"\"\"") { 3 } else { 1 };
        let inside = text.get(quotes..text.len() - quotes).unwrap_or_default();
        Name { text: literal::unescape(inside), span: Span { file, start, end } }
    }
}
