//! Reactors and modes: headers, members in a row, and recovery between members.

use hprm_model::declaration::{
    Attribute, AttributeArgument, Expression, Member, ModeNode, Name, Parameter, ReactorKind,
    ReactorNode, StateNode, Width, WidthTerm,
};
use hprm_model::{Diagnostic, Span};

use super::{MEMBERS, Parsed, Parser};
use crate::token::TokenKind;

impl Parser<'_> {
    pub(super) fn reactor(&mut self) -> Parsed<ReactorNode> {
        let attributes = self.attributes()?;
        let start = self.token().span;
        let mut kind = ReactorKind::Plain;
        loop {
            if self.accept_word("main").is_some() {
                kind = ReactorKind::Main;
            } else if self.accept_word("federated").is_some() {
                kind = ReactorKind::Federated;
            } else if self.accept_word("realtime").is_none() {
                break;
            }
        }
        self.expect_word("reactor")?;
        let named =
            self.is(TokenKind::Identifier) && !self.is_word("at") && !self.is_word("extends");
        let name = if named { Some(self.name("a name")?) } else { None };
        let type_parameters = self.maybe_types()?;
        let parameters = self.parameters()?;
        let host = if self.accept_word("at").is_some() { Some(self.host()?) } else { None };
        let extends = if self.accept_word("extends").is_some() {
            self.list(|parser| parser.name("the name of a reactor"))?
        } else {
            Vec::new()
        };
        let header = start.to(self.previous());
        let members = self.members()?;
        Ok(ReactorNode {
            attributes,
            kind,
            name,
            type_parameters,
            parameters,
            host,
            extends,
            members,
            header,
        })
    }

    fn parameters(&mut self) -> Parsed<Vec<Parameter>> {
        if !self.is_mark('(') {
            return Ok(Vec::new());
        }
        self.enclosed(('(', ')'), |parser| {
            let attributes = parser.attributes()?;
            let name = parser.name("the name of a parameter")?;
            let ty = parser.maybe_type()?;
            let default = parser.initializer()?;
            Ok(Parameter { attributes, name, ty, default, given: None })
        })
    }

    /// `'{' member* '}'`; a member with an error is skipped.
    fn members(&mut self) -> Parsed<Vec<Member>> {
        let open = self.expect('{')?.span;
        let mut members = Vec::new();
        while !self.is_mark('}') {
            if self.is(TokenKind::End) {
                if !self.cut {
                    let end = self.token().span;
                    self.report.add(
                        Diagnostic::error("LF0003", end, "expected `}`, found the end of the file")
                            .label(open, "to close this brace"),
                    );
                }
                break;
            }
            let before = self.at;
            match self.member() {
                Ok(member) => members.push(member),
                Err(_) => self.skip_to_member(before),
            }
        }
        self.accept('}');
        Ok(members)
    }

    fn member(&mut self) -> Parsed<Member> {
        let attributes = self.attributes()?;
        let word = self.token();
        if word.kind != TokenKind::Identifier || self.peek(1).kind == TokenKind::Mark('=') {
            return self.unmarked(attributes);
        }

        let name = self.text_of(word);
        let plain = ["preamble", "private", "public", "const", "method", "initial", "mode"];
        if let Some(attribute) = attributes.first()
            && plain.contains(&name)
        {
            let message = format!("an attribute cannot stand before `{name}`");
            let span = attribute.span;
            self.report.add(Diagnostic::error("LF0212", span, message).hint("remove it"));
        }
        Ok(match self.text_of(word) {
            "preamble" | "private" | "public" => Member::Preamble(self.preamble()?),
            "state" | "reset" => Member::State(self.state(attributes)?),
            "const" | "method" => Member::Method(self.method()?),
            "mutable" | "input" | "output" => Member::Port(self.port(attributes)?),
            "timer" => Member::Timer(self.timer(attributes)?),
            "logical" | "physical" | "action" => Member::Action(self.action(attributes)?),
            "reaction" | "mutation" => Member::Reaction(self.reaction(attributes)?),
            "watchdog" => Member::Watchdog(self.watchdog()?),
            "initial" | "mode" => Member::Mode(self.mode()?),
            _ => return self.unmarked(attributes),
        })
    }

    /// What no keyword starts: an instantiation or a connection.
    fn unmarked(&mut self, attributes: Vec<Attribute>) -> Parsed<Member> {
        if self.is(TokenKind::Identifier) && self.peek(1).kind == TokenKind::Mark('=') {
            return Ok(Member::Instantiation(self.instantiation(attributes)?));
        }
        if self.is(TokenKind::Identifier) || self.is_mark('(') {
            return Ok(Member::Connection(self.connection(attributes)?));
        }
        self.fail("a member of the reactor")
    }

    pub(super) fn starts_member(&self) -> bool {
        let keyword =
            self.is(TokenKind::Identifier) && MEMBERS.contains(&self.text_of(self.token()));
        keyword && self.peek(1).kind != TokenKind::Mark('.')
    }

    /// Skips the rest of what went wrong, and at least one token. Braces that were opened there are
    /// skipped with their contents.
    fn skip_to_member(&mut self, before: usize) {
        if self.at == before && !self.is_mark('}') {
            self.advance();
        }
        let mut open = 0_usize;
        loop {
            let instantiation = self.is(TokenKind::Identifier)
                && self.peek(1).kind == TokenKind::Mark('=')
                && self.is_word_ahead(2, "new");
            match self.token().kind {
                TokenKind::End => return,
                TokenKind::Mark('{') => open += 1,
                TokenKind::Mark('}') if open == 0 => return,
                TokenKind::Mark('}') => open -= 1,
                TokenKind::Mark('@') if open == 0 => return,
                _ if open == 0 && (self.starts_member() || instantiation) => return,
                _ => {}
            }
            self.advance();
        }
    }

    fn mode(&mut self) -> Parsed<ModeNode> {
        let start = self.token().span;
        let initial = self.accept_word("initial").is_some();
        self.expect_word("mode")?;
        let name = match self.is(TokenKind::Identifier) {
            true => Some(self.name("the name of a mode")?),
            false => None,
        };
        let header = start.to(self.previous());
        let members = self.nested(Self::members)?;
        Ok(ModeNode { initial, name, members, header })
    }

    fn state(&mut self, attributes: Vec<Attribute>) -> Parsed<StateNode> {
        let reset = self.accept_word("reset");
        self.expect_word("state")?;
        let name = self.name("the name of a state variable")?;
        let ty = self.maybe_type()?;
        let init = self.initializer()?;
        self.accept(';');
        Ok(StateNode { attributes, reset, name, ty, init })
    }

    /// `= expression`; the forms of other targets are reported.
    pub(super) fn initializer(&mut self) -> Parsed<Option<Expression>> {
        if self.accept('=') {
            return self.expression().map(Some);
        }
        let value = matches!(
            self.peek(1).kind,
            TokenKind::Integer | TokenKind::Float | TokenKind::String | TokenKind::Code
        );
        if self.is_mark('{') || (self.is_mark('(') && value) {
            let span = self.token().span;
            return self.lose(
                Diagnostic::error("LF0006", span, "the Python target initializes with `=`")
                    .hint("write `= value`"),
            );
        }
        Ok(None)
    }

    pub(super) fn attributes(&mut self) -> Parsed<Vec<Attribute>> {
        let mut attributes = Vec::new();
        while self.is_mark('@') {
            let start = self.advance().span;
            let name = self.name("the name of an attribute")?;
            let arguments = if self.is_mark('(') {
                self.no_broadcast(&name)?;
                self.enclosed(('(', ')'), Self::attribute_argument)?
            } else {
                Vec::new()
            };
            attributes.push(Attribute { name, arguments, span: start.to(self.previous()) });
        }
        Ok(attributes)
    }

    fn attribute_argument(&mut self) -> Parsed<AttributeArgument> {
        let named = self.is(TokenKind::Identifier) && self.peek(1).kind == TokenKind::Mark('=');
        let name = match named {
            true => {
                let name = self.advance();
                self.advance();
                Some(Name { text: self.text_of(name).to_owned(), span: name.span })
            }
            false => None,
        };
        Ok(AttributeArgument { name, value: self.expression()? })
    }

    pub(super) fn width(&mut self) -> Parsed<Option<Width>> {
        if !self.is_mark('[') {
            return Ok(None);
        }
        let start = self.advance().span;
        let mut terms = Vec::new();
        while !self.is_mark(']') {
            terms.push(if let Some(word) = self.accept_word("widthof") {
                self.expect('(')?;
                self.reference()?;
                WidthTerm::WidthOf(word.to(self.expect(')')?.span))
            } else {
                WidthTerm::Value(self.expression()?)
            });
            if !self.accept('+') {
                break;
            }
        }
        let end = self.expect(']')?.span;
        Ok(Some(Width { terms, span: start.to(end) }))
    }

    pub(super) fn maybe_type(&mut self) -> Parsed<Option<Span>> {
        if !self.is_mark(':') {
            return Ok(None);
        }
        let start = self.advance().span;
        self.type_name()?;
        Ok(Some(start.to(self.previous())))
    }

    /// `'<' type (',' type)* '>'`.
    pub(super) fn maybe_types(&mut self) -> Parsed<Option<Span>> {
        if !self.is_mark('<') {
            return Ok(None);
        }
        let start = self.token().span;
        self.nested(|parser| parser.enclosed(('<', '>'), Self::type_name))?;
        Ok(Some(start.to(self.previous())))
    }

    fn type_name(&mut self) -> Parsed<()> {
        if self.is(TokenKind::Code) {
            self.advance();
        } else {
            self.name("a type")?;
            while self.accept('.') {
                self.name("a type")?;
            }
            self.maybe_types()?;
        }
        while self.is_mark('*') || self.is_mark('[') {
            if self.advance().kind == TokenKind::Mark('[') {
                if self.is(TokenKind::Integer) {
                    self.advance();
                }
                self.expect(']')?;
            }
        }
        Ok(())
    }
}
