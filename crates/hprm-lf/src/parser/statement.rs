//! The members of a reactor that have parts: ports, actions, reactions, instances, connections.

use hprm_core::Transition;
use hprm_model::Diagnostic;
use hprm_model::declaration::{
    ActionNode, ArgumentNode, Assignment, Attribute, ConnectionNode, Deadline, EffectNode,
    Instantiation, Late, MethodNode, PortKind, PortNode, ReactionNode, Reference, TimerNode,
    TriggerNode, Watchdog,
};

use super::{Parsed, Parser};
use crate::token::TokenKind;

impl Parser<'_> {
    pub(super) fn method(&mut self) -> Parsed<MethodNode> {
        self.accept_word("const");
        self.expect_word("method")?;
        let name = self.name("the name of a method")?;
        let mut types = Vec::new();
        let arguments = self.enclosed(('(', ')'), |parser| {
            let name = parser.name("the name of an argument")?;
            let ty = parser.maybe_type()?;
            Ok((ArgumentNode { name, default: parser.initializer()? }, ty))
        })?;
        types.extend(arguments.iter().filter_map(|(_, ty)| *ty));
        types.extend(self.maybe_type()?);
        let body = self.body()?;
        self.accept(';');
        Ok(MethodNode {
            name,
            arguments: arguments.into_iter().map(|(argument, _)| argument).collect(),
            types,
            body,
        })
    }

    pub(super) fn port(&mut self, attributes: Vec<Attribute>) -> Parsed<PortNode> {
        let mutable = self.accept_word("mutable").is_some();
        let kind = if !mutable && self.accept_word("output").is_some() {
            PortKind::Output
        } else {
            self.expect_word("input")?;
            PortKind::Input { mutable }
        };
        let width = self.width()?;
        let name = self.name("the name of a port")?;
        let ty = self.maybe_type()?;
        self.accept(';');
        Ok(PortNode { attributes, kind, width, name, ty })
    }

    pub(super) fn timer(&mut self, attributes: Vec<Attribute>) -> Parsed<TimerNode> {
        self.expect_word("timer")?;
        let name = self.name("the name of a timer")?;
        let (mut offset, mut period) = (None, None);
        if self.accept('(') {
            offset = Some(self.expression()?);
            if self.accept(',') {
                period = Some(self.expression()?);
            }
            self.expect(')')?;
        }
        self.accept(';');
        Ok(TimerNode { attributes, name, offset, period })
    }

    pub(super) fn action(&mut self, attributes: Vec<Attribute>) -> Parsed<ActionNode> {
        let physical = if self.accept_word("logical").is_some() {
            Some(false)
        } else {
            self.accept_word("physical").map(|_| true)
        };
        self.expect_word("action")?;
        let name = self.name("the name of an action")?;
        let (mut min_delay, mut spacing, mut policy) = (None, None, None);
        if self.accept('(') {
            min_delay = Some(self.expression()?);
            if self.accept(',') {
                spacing = Some(self.expression()?);
                if self.accept(',') {
                    policy = Some(self.expression()?);
                }
            }
            self.expect(')')?;
        }
        let ty = self.maybe_type()?;
        self.accept(';');
        Ok(ActionNode { attributes, physical, name, min_delay, spacing, policy, ty })
    }

    pub(super) fn watchdog(&mut self) -> Parsed<Watchdog> {
        self.expect_word("watchdog")?;
        let name = self.name("the name of a watchdog")?;
        self.expect('(')?;
        self.expression()?;
        self.expect(')')?;
        if self.is(TokenKind::Arrow) {
            self.advance();
            self.list(Self::effect)?;
        }
        self.body()?;
        Ok(Watchdog { name })
    }

    pub(super) fn reaction(&mut self, attributes: Vec<Attribute>) -> Parsed<ReactionNode> {
        let start = self.token().span;
        // The language has both words, and in this target they mean the same.
        if self.accept_word("mutation").is_none() {
            self.expect_word("reaction")?;
        }
        let name = if self.is(TokenKind::Identifier) { Some(self.name("a name")?) } else { None };
        let triggers = self.enclosed(('(', ')'), Self::trigger)?;
        if self.is_word("deadline") && self.peek(1).kind == TokenKind::Mark('(') {
            let span = self.token().span;
            let message = "`deadline` stands behind the body of its reaction";
            return self
                .lose(Diagnostic::error("LF0003", span, message).hint(
                    "write `{= body =} deadline(10 ms) {= what to do when it is missed =}`",
                ));
        }
        let sources = if self.is(TokenKind::Identifier) && !self.starts_member() {
            self.list(Self::reference)?
        } else {
            Vec::new()
        };
        let effects = if self.is(TokenKind::Arrow) {
            self.advance();
            self.list(Self::effect)?
        } else {
            Vec::new()
        };
        self.no_arrow_back()?;
        let header = start.to(self.previous());
        let body = self.maybe_body()?;
        let late = self.late()?;
        let deadline = self.deadline()?;
        self.accept(';');
        Ok(ReactionNode {
            attributes,
            name,
            triggers,
            sources,
            effects,
            body,
            late,
            deadline,
            header,
        })
    }

    fn trigger(&mut self) -> Parsed<TriggerNode> {
        let qualified = self.peek(1).kind == TokenKind::Mark('.');
        if !qualified && self.accept_word("startup").is_some() {
            return Ok(TriggerNode::Startup);
        }
        if !qualified && self.accept_word("shutdown").is_some() {
            return Ok(TriggerNode::Shutdown);
        }
        if !qualified && let Some(span) = self.accept_word("reset") {
            return Ok(TriggerNode::Reset(span));
        }
        Ok(TriggerNode::Variable(self.reference()?))
    }

    fn effect(&mut self) -> Parsed<EffectNode> {
        let transition = match () {
            () if self.is_word("reset") => Transition::Reset,
            () if self.is_word("history") => Transition::History,
            () => return Ok(EffectNode::Variable(self.reference()?)),
        };
        if self.peek(1).kind != TokenKind::Mark('(') {
            return Ok(EffectNode::Variable(self.reference()?));
        }
        self.advance();
        self.expect('(')?;
        let name = self.name("the name of a mode")?;
        self.expect(')')?;
        Ok(EffectNode::Mode(transition, name))
    }

    fn late(&mut self) -> Parsed<Option<Late>> {
        if self.peek(1).kind == TokenKind::Mark('.') {
            return Ok(None);
        }
        if self.accept_word("tardy").is_some() {
            return Ok(Some(Late { wait: None, body: self.maybe_body()? }));
        }
        if !(self.is_word("STP") || self.is_word("STAA")) {
            return Ok(None);
        }
        self.advance();
        self.expect('(')?;
        let wait = Some(self.expression()?);
        self.expect(')')?;
        Ok(Some(Late { wait, body: Some(self.body()?) }))
    }

    fn deadline(&mut self) -> Parsed<Option<Deadline>> {
        if !self.is_word("deadline") || self.peek(1).kind != TokenKind::Mark('(') {
            return Ok(None);
        }
        self.advance();
        self.expect('(')?;
        let delay = self.expression()?;
        self.expect(')')?;
        self.handler_follows()?;
        Ok(Some(Deadline { delay, body: self.body()? }))
    }

    pub(super) fn instantiation(&mut self, attributes: Vec<Attribute>) -> Parsed<Instantiation> {
        let name = self.name("the name of an instance")?;
        self.expect('=')?;
        if self.accept_word("new").is_none() {
            let class = self.text_of(self.token());
            let hint = self
                .is(TokenKind::Identifier)
                .then(|| format!("write `{} = new {class}(...)`", name.text));
            return self.fail_with("`new`", hint);
        }
        let width = self.width()?;
        let class = self.name("the name of a reactor")?;
        let type_arguments = self.maybe_types()?;
        if let Some(width) = self.width()? {
            let message = "the width of a bank stands behind `new`";
            let text = &self.text[width.span.start as usize..width.span.end as usize];
            let hint = format!("write `new{text} {}(...)`", class.text);
            return self.lose(Diagnostic::error("LF0003", width.span, message).hint(hint));
        }
        if !self.is_mark('(') {
            let message = format!("`new {}` lacks its parentheses", class.text);
            let hint = format!("write `new {}()`", class.text);
            return self.lose(Diagnostic::error("LF0003", class.span, message).hint(hint));
        }
        let assignments = self.enclosed(('(', ')'), |parser| {
            if !parser.is(TokenKind::Identifier) {
                let hint = "parameters are assigned by their names: `name = value`";
                return parser.fail_with("the name of a parameter", Some(hint.to_owned()));
            }
            let name = parser.name("the name of a parameter")?;
            match parser.initializer()? {
                Some(value) => Ok(Assignment { name, value }),
                None => parser.fail("`=` and a value"),
            }
        })?;
        let host = if self.accept_word("at").is_some() { Some(self.host()?) } else { None };
        self.accept(';');
        Ok(Instantiation {
            attributes,
            name,
            width,
            class,
            members: None,
            type_arguments,
            assignments,
            host,
        })
    }

    pub(super) fn connection(&mut self, attributes: Vec<Attribute>) -> Parsed<ConnectionNode> {
        let start = self.token().span;
        let (left, iterated) = if self.is_mark('(') {
            (self.enclosed(('(', ')'), Self::reference)?, self.accept('+'))
        } else {
            (self.list(Self::reference)?, false)
        };
        if left.is_empty() || !(self.is(TokenKind::Arrow) || self.is(TokenKind::Squiggle)) {
            let hint = self.meant_instead(&left);
            return self.fail_with("`->` or `~>`", hint);
        }
        let physical = self.advance().kind == TokenKind::Squiggle;
        let right = self.list(Self::reference)?;
        let delay =
            if self.accept_word("after").is_some() { Some(self.expression()?) } else { None };
        let serializer = match self.accept_word("serializer") {
            None => None,
            Some(_) if self.is(TokenKind::String) => Some(self.string()),
            Some(_) => return self.fail("the name of a serializer in double quotes"),
        };
        let span = start.to(self.previous());
        self.accept(';');
        Ok(ConnectionNode { attributes, left, iterated, physical, right, delay, serializer, span })
    }

    pub(super) fn reference(&mut self) -> Parsed<Reference> {
        let start = self.token().span;
        let interleaved = self.is_word("interleaved") && self.peek(1).kind == TokenKind::Mark('(');
        if interleaved {
            self.advance();
            self.advance();
        }
        let first = self.name("the name of a port, an action or an instance")?;
        let (container, variable) = if self.accept('.') {
            (Some(first), self.name("the name of a port")?)
        } else {
            (None, first)
        };
        if interleaved {
            self.expect(')')?;
        }
        let renamed = self.accept_word("as").is_some();
        let alias = if renamed { Some(self.name("a name")?) } else { None };
        let span = start.to(self.previous());
        let (member, channel) = (None, None);
        Ok(Reference { container, member, variable, channel, interleaved, alias, span })
    }
}
