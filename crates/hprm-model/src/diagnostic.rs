//! Diagnostics of front ends and of the stages, as data.
//!
//! Codes are stable: `LF00` text, `LF01` files, `LF02` declarations, `LF03` references, `LF04`
//! values, `LF05` connections, `LF06` target, `LF07` not supported yet, `LF08` federations, `LF09`
//! modes, `LF10` Python, which other crates check, `LF11` executables. [`explanation`](crate::explanation) has what each
//! means, and [`render()`](crate::render()) makes text of them for a terminal.

use std::collections::BTreeSet;

use crate::source::Span;
use crate::syntax::Syntax;

/// How bad it is.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub enum Severity {
    /// The program cannot run.
    Error,
    /// The program runs, perhaps not as meant.
    Warning,
}

/// A note on a second place.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Label {
    /// The place.
    pub span: Span,
    /// The remark.
    pub text: String,
}

/// One thing that is wrong, or looks wrong, with a program.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Diagnostic {
    /// A stable code: `LF0301`.
    pub code: &'static str,
    /// Error or warning.
    pub severity: Severity,
    /// What is wrong.
    pub message: String,
    /// Where.
    pub span: Span,
    /// Other places that have to do with it.
    pub labels: Vec<Label>,
    /// What to do about it.
    pub hint: Option<String>,
}

impl Diagnostic {
    /// An error.
    pub fn error(code: &'static str, span: Span, message: impl Into<String>) -> Self {
        let (severity, labels, hint) = (Severity::Error, Vec::new(), None);
        Self { code, severity, message: message.into(), span, labels, hint }
    }

    /// A warning.
    pub fn warning(code: &'static str, span: Span, message: impl Into<String>) -> Self {
        Self { severity: Severity::Warning, ..Self::error(code, span, message) }
    }

    /// The one error for everything that the language has and this version does not.
    pub(crate) fn unsupported(span: Span, what: &str, instead: &str) -> Self {
        Self::error("LF0701", span, format!("{what} not supported yet")).hint(instead)
    }

    /// With what to do about it.
    #[must_use]
    pub fn hint(mut self, hint: impl Into<String>) -> Self {
        self.hint = Some(hint.into());
        self
    }

    /// With what to do about it, if something is known.
    #[must_use]
    pub fn maybe_hint(mut self, hint: Option<String>) -> Self {
        self.hint = hint.or(self.hint);
        self
    }

    /// With a remark at another place.
    #[must_use]
    pub fn label(mut self, span: Span, text: impl Into<String>) -> Self {
        self.labels.push(Label { span, text: text.into() });
        self
    }
}

/// The most errors that are kept of one compilation, and the most warnings.
const MAX: usize = 200;

/// Diagnostics as they are found; the same one is kept once, however many instances it concerns.
#[derive(Clone, Debug, Default)]
pub struct Report {
    syntax: Syntax,
    diagnostics: Vec<Diagnostic>,
    seen: BTreeSet<(&'static str, Span)>,
    /// How many errors there have been, the same ones counted again.
    errors: usize,
    /// How many errors are kept, and how many warnings.
    kept: [usize; 2],
}

impl Report {
    /// A report whose hints show how things are written in a language.
    #[must_use]
    pub fn new(syntax: Syntax) -> Self {
        Self { syntax, ..Self::default() }
    }

    /// What the program is written in.
    pub(crate) fn syntax(&self) -> Syntax {
        self.syntax
    }

    /// Adds one.
    pub fn add(&mut self, diagnostic: Diagnostic) {
        self.errors += usize::from(diagnostic.severity == Severity::Error);
        let kept = &mut self.kept[diagnostic.severity as usize];
        if *kept < MAX && self.seen.insert((diagnostic.code, diagnostic.span)) {
            *kept += 1;
            self.diagnostics.push(diagnostic);
        }
    }

    /// How many errors there have been, the same ones counted again.
    #[must_use]
    pub fn errors(&self) -> usize {
        self.errors
    }

    /// Whether one of that code is kept.
    pub(crate) fn has(&self, code: &str) -> bool {
        self.diagnostics.iter().any(|diagnostic| diagnostic.code == code)
    }

    /// Whether there was an error.
    #[must_use]
    pub fn has_errors(&self) -> bool {
        self.errors > 0
    }

    /// Whether no more errors would be kept, so that no check needs to look for more.
    #[must_use]
    pub fn is_full(&self) -> bool {
        self.kept[Severity::Error as usize] >= MAX
    }

    /// All of them, in the order of the text.
    #[must_use]
    pub fn into_sorted(mut self) -> Vec<Diagnostic> {
        self.diagnostics.sort_by_key(|diagnostic| (diagnostic.span, diagnostic.code));
        self.diagnostics
    }
}

/// Of `candidates`, the one that `name` was probably meant to be, as a question.
#[must_use]
pub fn did_you_mean<'a>(
    name: &str,
    candidates: impl IntoIterator<Item = &'a str>,
) -> Option<String> {
    // A candidate that has nothing in common with the name is no help.
    let letters = name.chars().count();
    let limit = (1 + letters / 4).min(letters.saturating_sub(1));
    candidates
        .into_iter()
        .map(|candidate| (distance(name, candidate), candidate))
        .filter(|(distance, _)| *distance <= limit)
        .min()
        .map(|(_, candidate)| format!("did you mean `{candidate}`?"))
}

/// The question of [`did_you_mean`], or else a list of all that there is.
#[must_use]
pub fn existing<'a>(
    name: &str,
    what: &str,
    candidates: impl IntoIterator<Item = &'a str> + Clone,
) -> String {
    did_you_mean(name, candidates.clone()).unwrap_or_else(|| {
        // A name that is declared twice, by mistake, is one name.
        let mut seen = BTreeSet::new();
        let each = candidates.into_iter().filter(|name| seen.insert(*name));
        let all: Vec<_> = each.map(|name| format!("`{name}`")).collect();
        if all.is_empty() { format!("{what}: there are none") } else { list(what, &all) }
    })
}

fn list(what: &str, names: &[String]) -> String {
    const SHOWN: usize = 8;
    let shown = names[..names.len().min(SHOWN)].join(", ");
    let rest = names.len().saturating_sub(SHOWN);
    if rest == 0 { format!("{what}: {shown}") } else { format!("{what}: {shown} and {rest} more") }
}

/// Levenshtein's distance, without regard to case.
fn distance(a: &str, b: &str) -> usize {
    const LONGEST: usize = 64;
    let letters = |text: &str| -> Vec<char> {
        text.chars().take(LONGEST).map(|c| c.to_ascii_lowercase()).collect()
    };
    let (a, b) = (letters(a), letters(b));
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, left) in a.iter().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, right) in b.iter().enumerate() {
            let substituted = diagonal + usize::from(left != right);
            diagonal = row[j + 1];
            row[j + 1] = substituted.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slip_of_the_finger_is_guessed() {
        let names = ["inp", "updated_parameters", "out"];
        assert_eq!(
            did_you_mean("updated_paramters", names).unwrap(),
            "did you mean `updated_parameters`?"
        );
        assert_eq!(did_you_mean("observation", names), None);
        assert_eq!(
            existing("observation", "ports", names),
            "ports: `inp`, `updated_parameters`, `out`"
        );
        assert_eq!(existing("x", "ports", []), "ports: there are none");
        assert_eq!(existing("x", "ports", ["b", "a", "b"]), "ports: `b`, `a`");
    }
}
