//! What a program probably means where the grammar expects something else: the words of hints, and nothing more.

use hprm_model::declaration::{Name, Reference};
use hprm_model::{Diagnostic, did_you_mean};

use super::{MEMBERS, Parsed, Parser};
use crate::token::TokenKind;

const DELAY: &str =
    "a delay stands behind its connection: `source.output -> receiver.input after 10 ms`";

/// The longest part of a program that a hint repeats.
const LONGEST_SHOWN: usize = 40;

/// Words with which a statement of Python begins.
const PYTHON: [&str; 10] =
    ["class", "for", "from", "global", "if", "print", "return", "self", "while", "with"];

impl Parser<'_> {
    /// What a member is that begins with these names, is no instantiation, and goes on without an arrow.
    pub(super) fn meant_instead(&self, names: &[Reference]) -> Option<String> {
        if self.is_word("after") {
            return Some(DELAY.to_owned());
        }
        let first = names.first()?;
        if self.is_mark('=') || self.is_mark('<') {
            let arrow = "a connection is written `source.output -> receiver.input`";
            return Some(arrow.to_owned());
        }
        if first.container.is_some() {
            return None;
        }
        let hint = match first.variable.text.as_str() {
            "after" => DELAY,
            "deadline" => {
                "a deadline stands behind the body of a reaction: \
                 `reaction(t) {= ... =} deadline(10 ms) {= ... =}`"
            }
            "def" => "a function of a reactor is a method: `method name(argument) {= ... =}`",
            "import" => {
                "imports stand at the top of the file; modules of Python are imported in a \
                 `preamble {= import ... =}`"
            }
            "reactor" | "main" | "federated" => {
                "a reactor is declared outside of others, and here an instance of it is made: \
                 `name = new Reactor()`"
            }
            word if PYTHON.contains(&word) => {
                "Python code belongs into the body of a reaction: `reaction(startup) {= ... =}`"
            }
            word => return did_you_mean(word, MEMBERS),
        };
        Some(hint.to_owned())
    }

    /// Refuses `@compress (a.out)+ -> b.inp`: the parentheses of the broadcast are those of the attribute.
    pub(super) fn no_broadcast(&mut self, attribute: &Name) -> Parsed<()> {
        let Some(end) = self.closing() else { return Ok(()) };
        let behind = self.peek(end + 1);
        if behind.kind != TokenKind::Mark('+') {
            return Ok(());
        }
        let span = self.token().span.to(behind.span);
        let (name, written) = (&attribute.text, &self.text[span.range()]);
        let broadcast = match written.contains('\n') || written.len() > LONGEST_SHOWN {
            true => "(...)+",
            false => written,
        };
        let hint = format!("write `@{name}() {broadcast}`");
        let message = format!("these parentheses belong to `@{name}`, so no broadcast begins here");
        self.lose(Diagnostic::error("LF0003", span, message).hint(hint))
    }

    /// How many tokens ahead the parenthesis is closed that is next.
    fn closing(&self) -> Option<usize> {
        let mut open = 0_usize;
        for (ahead, token) in self.tokens[self.at..].iter().enumerate() {
            match token.kind {
                TokenKind::Mark('(') => open += 1,
                TokenKind::Mark(')') => open = open.checked_sub(1)?,
                // Another attribute, which no value has. So no token is looked at often.
                TokenKind::Mark('@') => return None,
                _ => {}
            }
            if open == 0 {
                return Some(ahead);
            }
        }
        None
    }

    /// Refuses `reaction(startup) <- out`.
    pub(super) fn no_arrow_back(&mut self) -> Parsed<()> {
        if !self.is_mark('<') {
            return Ok(());
        }
        let hint = "what a reaction sets or schedules stands behind `->`";
        self.fail_with("`->` or a body `{= ... =}`", Some(hint.to_owned()))
    }

    /// Refuses a deadline without a handler.
    pub(super) fn handler_follows(&mut self) -> Parsed<()> {
        if self.is(TokenKind::Code) || self.is_mark('{') {
            return Ok(());
        }
        let hint =
            "behind a deadline stands what runs if it is missed: `deadline(10 ms) {= ... =}`";
        self.fail_with("a body `{= ... =}`", Some(hint.to_owned()))
    }
}
