//! Diagnostics as text for a terminal.

use std::ops::Range;

use annotate_snippets::{AnnotationKind, Element, Level, Origin, Renderer, Snippet};

use crate::diagnostic::{Diagnostic, Severity};
use crate::source::{FileId, Sources, Span};

/// The longest line that is shown.
const LONGEST_LINE: usize = 2_000;

const NOTHING: [Element<'static>; 0] = [];

/// The diagnostic with its file, line, column, source line and hint.
///
/// Plain text unless `color`.
#[must_use]
pub fn render(diagnostic: &Diagnostic, sources: &Sources, color: bool) -> String {
    let level = match diagnostic.severity {
        Severity::Error => Level::ERROR,
        Severity::Warning => Level::WARNING,
    };
    let mut files = vec![diagnostic.span.file];
    for label in &diagnostic.labels {
        if !files.contains(&label.span.file) {
            files.push(label.span.file);
        }
    }
    let mut group =
        level.primary_title(diagnostic.message.as_str()).id(diagnostic.code).elements(NOTHING);
    for file in files {
        group = match snippet(diagnostic, file, sources) {
            Some(snippet) => group.element(snippet),
            None if sources.is_stated(file) => group.element(Origin::path(sources.path(file))),
            None if file == diagnostic.span.file => {
                let at = sources.position(diagnostic.span);
                let origin = Origin::path(sources.path(file)).line(at.line as usize);
                group.element(origin.char_column(at.column as usize))
            }
            None => group,
        };
    }
    if let Some(hint) = &diagnostic.hint {
        group = group.element(Level::HELP.message(hint.as_str()));
    }
    let renderer = if color { Renderer::styled() } else { Renderer::plain() };
    renderer.render(&[group])
}

/// All diagnostics, with an empty line between one and the next.
#[must_use]
pub fn render_all(diagnostics: &[Diagnostic], sources: &Sources, color: bool) -> String {
    let texts: Vec<_> = diagnostics.iter().map(|d| render(d, sources, color)).collect();
    texts.join("\n\n")
}

/// The lines of a file that the diagnostic speaks of; none if one of them would fill the page, or if it is an
/// option.
fn snippet<'a>(
    diagnostic: &'a Diagnostic,
    file: FileId,
    sources: &'a Sources,
) -> Option<Snippet<'a, annotate_snippets::Annotation<'a>>> {
    if sources.is_stated(file) {
        return None;
    }
    let labels = || diagnostic.labels.iter().filter(|label| label.span.file == file);
    let primary = (diagnostic.span.file == file).then_some(diagnostic.span);
    let spans = || primary.into_iter().chain(labels().map(|label| label.span));
    let lines = lines(spans(), sources.text(file))?;
    let first = spans().map(|span| sources.position(span).line).min()?;
    let text = &sources.text(file)[lines.clone()];
    if text.trim().is_empty() && first > 1 {
        // Only how many lines there are is known of the text.
        return None;
    }
    if text.split('\n').any(|line| line.len() > LONGEST_LINE) {
        return None;
    }
    // A caret needs something to stand under, and a span over many lines would drown the page.
    let range = |span: Span| {
        let start = (span.start as usize).clamp(lines.start, lines.end) - lines.start;
        let line_end = text[start..].find('\n').map_or(text.len(), |n| start + n);
        start..(span.end as usize).saturating_sub(lines.start).clamp(start, line_end)
    };
    let primary = primary.map(|span| AnnotationKind::Primary.span(range(span)));
    let labels = labels()
        .map(|label| AnnotationKind::Context.span(range(label.span)).label(label.text.as_str()));
    let annotations = primary.into_iter().chain(labels);
    let snippet = Snippet::source(text).path(sources.path(file)).line_start(first as usize);
    Some(snippet.annotations(annotations))
}

/// Whole lines, from that of the first span's start to that of the last one's.
fn lines(spans: impl Iterator<Item = Span> + Clone, text: &str) -> Option<Range<usize>> {
    let starts = spans.map(|span| (span.start as usize).min(text.len()));
    let (first, last) = (starts.clone().min()?, starts.max()?);
    let start = text[..first].rfind('\n').map_or(0, |at| at + 1);
    let end = text[last..].find('\n').map_or(text.len(), |n| last + n);
    Some(start..end)
}
