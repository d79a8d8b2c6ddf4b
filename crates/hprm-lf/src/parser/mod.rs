//! Tokens to tree: recursive descent, with recovery.
//!
//! This file owns the cursor, the rules at the top of a file, and recovery: after an error the
//! parser skips to the next thing that starts a statement, so that one run reports several errors.
//! It gives no meaning to what it parses.

mod expression;
mod meant;
mod reactor;
mod statement;
mod target;

use std::collections::BTreeSet;

use hprm_model::declaration::{Body, Expression, Name};
use hprm_model::{Diagnostic, FileId, Report, Span, did_you_mean};

use crate::ast::{FileNode, Import, ImportSource, ImportedReactor};
use crate::lexer;
use crate::token::{Token, TokenKind};

/// Words that start a member of a reactor, and so cannot name anything.
const MEMBERS: [&str; 19] = [
    "action", "const", "initial", "input", "logical", "method", "mode", "mutable", "mutation",
    "output", "physical", "preamble", "private", "public", "reaction", "reset", "state", "timer",
    "watchdog",
];

/// The deepest nesting of lists, types and dictionaries.
const DEEPEST: usize = 64;

/// An error has been reported; the statement is lost.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lost;

type Parsed<T> = Result<T, Lost>;

/// The tree of a file. What cannot be parsed is reported and missing from it.
pub(crate) fn parse(file: FileId, text: &str, report: &mut Report) -> FileNode {
    let tokens = lexer::tokens(file, text, report);
    Parser::new(text, tokens, report).model()
}

/// The value that is all of a text; none, and what is wrong is reported, if it is not one.
pub(crate) fn parse_value(file: FileId, text: &str, report: &mut Report) -> Option<Expression> {
    let tokens = lexer::tokens(file, text, report);
    let mut parser = Parser::new(text, tokens, report);
    let value = parser.expression().ok()?;
    parser.is(TokenKind::End).then_some(value)
}

struct Parser<'a> {
    text: &'a str,
    tokens: Vec<Token>,
    /// Whether the end of the file is the consequence of a reported error.
    cut: bool,
    at: usize,
    depth: usize,
    /// Keywords that have been reported where a name is needed.
    keywords: BTreeSet<String>,
    report: &'a mut Report,
}

impl<'a> Parser<'a> {
    fn new(text: &'a str, tokens: lexer::Tokens, report: &'a mut Report) -> Self {
        let (tokens, cut) = (tokens.all, tokens.cut);
        Self { text, tokens, cut, at: 0, depth: 0, keywords: BTreeSet::new(), report }
    }
}

impl Parser<'_> {
    fn token(&self) -> Token {
        self.peek(0)
    }

    fn peek(&self, ahead: usize) -> Token {
        // The last token is the end of the file, and it never ends.
        self.tokens[(self.at + ahead).min(self.tokens.len() - 1)]
    }

    fn text_of(&self, token: Token) -> &str {
        &self.text[token.span.range()]
    }

    /// The span of the token before the cursor.
    fn previous(&self) -> Span {
        self.tokens[self.at.saturating_sub(1)].span
    }

    fn advance(&mut self) -> Token {
        let token = self.token();
        self.at = (self.at + 1).min(self.tokens.len() - 1);
        token
    }

    fn is(&self, kind: TokenKind) -> bool {
        self.token().kind == kind
    }

    fn is_mark(&self, mark: char) -> bool {
        self.is(TokenKind::Mark(mark))
    }

    fn is_word(&self, word: &str) -> bool {
        self.is_word_ahead(0, word)
    }

    fn is_word_ahead(&self, ahead: usize, word: &str) -> bool {
        let token = self.peek(ahead);
        token.kind == TokenKind::Identifier && self.text_of(token) == word
    }

    fn accept(&mut self, mark: char) -> bool {
        let accepted = self.is_mark(mark);
        if accepted {
            self.advance();
        }
        accepted
    }

    fn accept_word(&mut self, word: &str) -> Option<Span> {
        self.is_word(word).then(|| self.advance().span)
    }

    fn expect(&mut self, mark: char) -> Parsed<Token> {
        if self.is_mark(mark) { Ok(self.advance()) } else { self.fail(&format!("`{mark}`")) }
    }

    fn expect_word(&mut self, word: &str) -> Parsed<Span> {
        match self.accept_word(word) {
            Some(span) => Ok(span),
            None => self.fail(&format!("`{word}`")),
        }
    }

    fn name(&mut self, what: &str) -> Parsed<Name> {
        if !self.is(TokenKind::Identifier) {
            return self.fail(what);
        }
        if MEMBERS.contains(&self.text_of(self.token())) {
            self.keyword_as_name(what)?;
        }
        let token = self.advance();
        let text = self.text_of(token).trim_start_matches('^').to_owned();
        Ok(Name { text, span: token.span })
    }

    /// Reports a keyword that is meant to be a name, once for each keyword, and lets it pass as one.
    /// On a line of its own it rather starts the next member, and the name is missing.
    fn keyword_as_name(&mut self, what: &str) -> Parsed<()> {
        let token = self.token();
        let word = self.text_of(token).to_owned();
        let before = self.previous().end as usize..token.span.start as usize;
        if self.text[before].contains('\n') {
            return self.fail(what);
        }
        let message = format!("`{word}` is a keyword, and cannot be {what}");
        if self.keywords.insert(word) {
            let hint = "choose another name";
            self.report.add(Diagnostic::error("LF0003", token.span, message).hint(hint));
        }
        Ok(())
    }

    fn body(&mut self) -> Parsed<Body> {
        self.code().map(Body::Text)
    }

    /// The place of the text between `{=` and `=}`.
    fn code(&mut self) -> Parsed<Span> {
        if self.is_mark('{') {
            return Ok(self.body_in_braces());
        }
        if !self.is(TokenKind::Code) {
            return self.fail("a body `{= ... =}`");
        }
        let mut inner = self.advance().span;
        inner.start += 2;
        // Of a body without an end, there is nothing behind it.
        inner.end = (inner.end - 2).max(inner.start);
        Ok(inner)
    }

    fn maybe_body(&mut self) -> Parsed<Option<Body>> {
        if self.is(TokenKind::Code) || self.is_mark('{') { self.body().map(Some) } else { Ok(None) }
    }

    /// Reports braces without `=`, and steps over what is between them.
    fn body_in_braces(&mut self) -> Span {
        let open = self.advance().span;
        let message = "the body of a reaction or a method stands between `{=` and `=}`";
        self.report.add(
            Diagnostic::error("LF0003", open, message).hint("write `{=` here, and `=}` at its end"),
        );
        let mut depth = 1_usize;
        while depth > 0 && !self.is(TokenKind::End) {
            match self.advance().kind {
                TokenKind::Mark('{') => depth += 1,
                TokenKind::Mark('}') => depth -= 1,
                _ => {}
            }
        }
        self.cut |= depth > 0;
        Span { end: open.start, ..open }
    }

    /// Reports that something else was expected here.
    fn fail<T>(&mut self, expected: &str) -> Parsed<T> {
        self.fail_with(expected, None)
    }

    fn fail_with<T>(&mut self, expected: &str, hint: Option<String>) -> Parsed<T> {
        let token = self.token();
        if self.cut && token.kind == TokenKind::End {
            return Err(Lost);
        }
        let found = match token.kind {
            TokenKind::End => "the end of the file".to_owned(),
            TokenKind::Code => "a code body".to_owned(),
            _ => format!("`{}`", self.text_of(token).chars().take(40).collect::<String>()),
        };
        let message = format!("expected {expected}, found {found}");
        self.lose(Diagnostic::error("LF0003", token.span, message).maybe_hint(hint))
    }

    fn lose<T>(&mut self, diagnostic: Diagnostic) -> Parsed<T> {
        self.report.add(diagnostic);
        Err(Lost)
    }

    /// Parses one level deeper, unless the nesting is too deep.
    fn nested<T>(&mut self, parse: impl FnOnce(&mut Self) -> Parsed<T>) -> Parsed<T> {
        if self.depth >= DEEPEST {
            let span = self.token().span;
            let message = format!("nested more than {DEEPEST} deep");
            return self.lose(Diagnostic::error("LF0004", span, message));
        }
        self.depth += 1;
        let parsed = parse(self);
        self.depth -= 1;
        parsed
    }

    /// `item (',' item)*`.
    fn list<T>(&mut self, item: fn(&mut Self) -> Parsed<T>) -> Parsed<Vec<T>> {
        let mut items = vec![item(self)?];
        while self.accept(',') {
            items.push(item(self)?);
        }
        Ok(items)
    }

    /// `open (item (',' item)* ','?)? close`.
    fn enclosed<T>(
        &mut self,
        (open, close): (char, char),
        item: fn(&mut Self) -> Parsed<T>,
    ) -> Parsed<Vec<T>> {
        self.expect(open)?;
        let mut items = Vec::new();
        while !self.is_mark(close) {
            items.push(item(self)?);
            if !self.accept(',') {
                break;
            }
        }
        self.expect(close)?;
        Ok(items)
    }

    fn model(mut self) -> FileNode {
        let mut model = FileNode::default();
        while !self.is(TokenKind::End) {
            let before = self.at;
            if self.top_level(&mut model).is_err() {
                self.skip_to_top_level(before);
            }
        }
        model
    }

    fn top_level(&mut self, model: &mut FileNode) -> Parsed<()> {
        if self.is_word("target") {
            model.target = Some(self.target()?);
        } else if self.is_word("import") {
            model.imports.push(self.import()?);
        } else if self.starts_preamble() {
            model.preambles.push(self.preamble()?);
        } else if self.starts_reactor() {
            model.reactors.push(self.reactor()?);
        } else {
            const WORDS: [&str; 6] =
                ["target", "import", "preamble", "reactor", "main", "federated"];
            let hint = did_you_mean(self.text_of(self.token()), WORDS);
            return self.fail_with("`target`, `import`, `preamble` or `reactor`", hint);
        }
        Ok(())
    }

    fn starts_reactor(&self) -> bool {
        self.is_mark('@')
            || ["reactor", "main", "federated", "realtime"].iter().any(|word| self.is_word(word))
    }

    fn starts_preamble(&self) -> bool {
        ["preamble", "private", "public"].iter().any(|word| self.is_word(word))
    }

    /// Skips the rest of what went wrong, and at least one token.
    fn skip_to_top_level(&mut self, before: usize) {
        if self.at == before {
            self.advance();
        }
        let starts = |parser: &Self| {
            let keyword = parser.starts_reactor() && !parser.is_mark('@');
            keyword || parser.starts_preamble() || parser.is_word("import")
        };
        while !self.is(TokenKind::End) && !starts(self) {
            self.advance();
        }
    }

    fn preamble(&mut self) -> Parsed<Span> {
        let span = self.token().span;
        if self.accept_word("private").or_else(|| self.accept_word("public")).is_some() {
            let message = "`private` and `public` have no meaning in the Python target";
            self.report
                .add(Diagnostic::warning("LF0219", span, message).hint("write `preamble` alone"));
        }
        self.expect_word("preamble")?;
        self.code()
    }

    fn import(&mut self) -> Parsed<Import> {
        self.expect_word("import")?;
        let reactors = self.list(|parser| {
            let name = parser.name("the name of a reactor")?;
            let renamed = parser.accept_word("as").is_some();
            let alias = if renamed { Some(parser.name("a new name")?) } else { None };
            Ok(ImportedReactor { name, alias })
        })?;
        self.expect_word("from")?;
        let from = if self.is_mark('<') { self.package()? } else { self.import_file()? };
        self.accept(';');
        Ok(Import { reactors, from })
    }

    fn import_file(&mut self) -> Parsed<ImportSource> {
        if !self.is(TokenKind::String) {
            return self.fail("a path in double quotes");
        }
        Ok(ImportSource::File(self.string()))
    }

    fn package(&mut self) -> Parsed<ImportSource> {
        let open = self.expect('<')?.span;
        while !self.is_mark('>') {
            if self.is(TokenKind::End) || self.is(TokenKind::String) || self.is(TokenKind::Code) {
                return self.fail("`>`");
            }
            self.advance();
        }
        let close = self.expect('>')?.span;
        let text = self.text[open.end as usize..close.start as usize].trim().to_owned();
        Ok(ImportSource::Package(Name { text, span: open.to(close) }))
    }
}
