//! The target declaration with its properties, and the names of hosts: the places where words need
//! no quotes.

use hprm_model::Span;
use hprm_model::declaration::{Element, ElementKind, Name, Property};

use super::{Parsed, Parser};
use crate::ast::Target;
use crate::token::{Token, TokenKind};

impl Parser<'_> {
    pub(super) fn target(&mut self) -> Parsed<Target> {
        self.expect_word("target")?;
        let name = self.name("the name of the target")?;
        let properties = if self.is_mark('{') { self.dictionary()? } else { Vec::new() };
        self.accept(';');
        Ok(Target { name, properties })
    }

    fn dictionary(&mut self) -> Parsed<Vec<Property>> {
        self.nested(|parser| parser.enclosed(('{', '}'), Self::property))
    }

    fn property(&mut self) -> Parsed<Property> {
        let name = if self.is(TokenKind::String) {
            self.string()
        } else if self.is(TokenKind::Identifier) {
            let first = self.token().span;
            self.run(first, |token| {
                matches!(token.kind, TokenKind::Identifier | TokenKind::Mark('-'))
            })
        } else {
            return self.fail("the name of a target property");
        };
        self.expect(':')?;
        let value = self.element()?;
        Ok(Property { name, value })
    }

    fn element(&mut self) -> Parsed<Element> {
        let start = self.token().span;
        let kind = match self.token().kind {
            TokenKind::Mark('{') => ElementKind::Dictionary(self.dictionary()?),
            TokenKind::Mark('[') => {
                ElementKind::List(self.nested(|parser| parser.enclosed(('[', ']'), Self::element))?)
            }
            TokenKind::Identifier if !self.is_boolean() && !self.is_endless() => self.path(start),
            TokenKind::Mark('.' | '/' | '\\') => self.path(start),
            _ => ElementKind::Value(self.expression()?),
        };
        Ok(Element { kind, span: start.to(self.previous()) })
    }

    fn path(&mut self, start: Span) -> ElementKind {
        let word = self.run(start, |token| {
            matches!(
                token.kind,
                TokenKind::Identifier
                    | TokenKind::Integer
                    | TokenKind::Float
                    | TokenKind::Mark('.' | '-' | '/' | '\\' | ':')
            )
        });
        ElementKind::Path(word.text)
    }

    /// The name of a host: `user@host.example:1234`, `10.0.0.1` or `[::1]:1234`.
    pub(super) fn host(&mut self) -> Parsed<Name> {
        let start = self.token().span;
        if !matches!(
            self.token().kind,
            TokenKind::Identifier | TokenKind::Integer | TokenKind::Float
        ) && !self.is_mark('[')
        {
            return self.fail("the name of a host");
        }
        Ok(self.run(start, |token| {
            matches!(
                token.kind,
                TokenKind::Identifier
                    | TokenKind::Integer
                    | TokenKind::Float
                    | TokenKind::Mark('.' | '-' | ':' | '@' | '[' | ']')
            )
        }))
    }

    /// Tokens that touch each other, as one word; takes the first in any case.
    fn run(&mut self, start: Span, fits: fn(Token) -> bool) -> Name {
        let mut span = start;
        self.advance();
        while fits(self.token()) && self.token().span.start == span.end {
            span = span.to(self.advance().span);
        }
        Name { text: self.text[span.range()].to_owned(), span }
    }
}
