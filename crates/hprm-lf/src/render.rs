//! Diagnostics as text for a terminal.

use annotate_snippets::{AnnotationKind, Level, Renderer, Snippet};

use crate::diagnostic::{Diagnostic, Severity};
use crate::source::{FileId, Sources, Span};

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
    let snippets = files.into_iter().map(|file| snippet(diagnostic, file, sources));
    let mut group =
        level.primary_title(diagnostic.message.as_str()).id(diagnostic.code).elements(snippets);
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

fn snippet<'a>(
    diagnostic: &'a Diagnostic,
    file: FileId,
    sources: &'a Sources,
) -> Snippet<'a, annotate_snippets::Annotation<'a>> {
    let text = sources.text(file);
    // A caret needs something to stand under, and a span over many lines would drown the page.
    let range = |span: Span| {
        let start = (span.start as usize).min(text.len());
        let line_end = text[start..].find('\n').map_or(text.len(), |n| start + n);
        start..(span.end as usize).clamp(start, line_end)
    };
    let primary = (diagnostic.span.file == file)
        .then(|| AnnotationKind::Primary.span(range(diagnostic.span)));
    let labels =
        diagnostic.labels.iter().filter(|label| label.span.file == file).map(|label| {
            AnnotationKind::Context.span(range(label.span)).label(label.text.as_str())
        });
    Snippet::source(text).path(sources.path(file)).annotations(primary.into_iter().chain(labels))
}
