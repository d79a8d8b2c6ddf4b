//! The files of a program: their text, and positions in it.
//!
//! Nothing here opens a file; front ends bring the text.

use std::ops::Range;

/// A file among the [`Sources`] of a program.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub struct FileId(pub u32);

impl FileId {
    /// The main file, which is the first of a program.
    pub const MAIN: Self = Self(0);

    /// The number of the file, as an index.
    #[must_use]
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

/// A range of bytes in a file.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub struct Span {
    /// The file.
    pub file: FileId,
    /// Offset of the first byte.
    pub start: u32,
    /// Offset behind the last byte.
    pub end: u32,
}

impl Span {
    /// The bytes `range` of a file.
    #[must_use]
    pub fn new(file: FileId, range: Range<usize>) -> Self {
        // Front ends refuse a file long before its offsets outgrow the integer.
        let offset = |at| u32::try_from(at).unwrap_or(u32::MAX);
        Self { file, start: offset(range.start), end: offset(range.end) }
    }

    /// From the start of this span to the end of a later one.
    #[must_use]
    pub fn to(self, later: Self) -> Self {
        Self { end: later.end.max(self.end), ..self }
    }

    /// The bytes.
    #[must_use]
    pub fn range(self) -> Range<usize> {
        self.start as usize..self.end as usize
    }
}

/// A line and a column, both from 1.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub struct Position {
    /// The line, from 1.
    pub line: u32,
    /// The character within the line, from 1.
    pub column: u32,
}

#[derive(Clone, PartialEq, Eq, Debug)]
struct Source {
    path: String,
    /// Whether the text was stated on the command line; then the path is what the user has typed.
    stated: bool,
    text: String,
    /// Offset of each line's first byte.
    lines: Vec<usize>,
}

/// All files of a program, the main file first.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct Sources {
    files: Vec<Source>,
}

impl Sources {
    /// No files.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a file.
    pub fn add(&mut self, path: &str, text: String) -> FileId {
        self.add_source(path, text, false)
    }

    /// Adds what an option states. The user is shown the option, as it is `typed`, and no places in the text.
    pub(crate) fn add_stated(&mut self, typed: &str, text: String) -> FileId {
        self.add_source(typed, text, true)
    }

    fn add_source(&mut self, path: &str, text: String, stated: bool) -> FileId {
        let starts = text.match_indices('\n').map(|(at, _)| at + 1);
        let lines = std::iter::once(0).chain(starts).collect();
        self.files.push(Source { path: path.to_owned(), stated, text, lines });
        FileId(u32::try_from(self.files.len() - 1).expect("fewer files than u32 counts"))
    }

    /// Whether this is no file, but an option; then its path is the option.
    #[must_use]
    pub fn is_stated(&self, file: FileId) -> bool {
        self.files[file.index()].stated
    }

    /// The file of that path.
    #[must_use]
    pub fn find(&self, path: &str) -> Option<FileId> {
        let index = self.files.iter().position(|file| file.path == path)?;
        Some(FileId(u32::try_from(index).expect("fewer files than u32 counts")))
    }

    /// The empty span at a line and a column of the file of that path, which may come from Python. None if there is no such file; a place that is beyond its text is at the end.
    #[must_use]
    pub fn at(&self, path: &str, position: Position) -> Option<Span> {
        let file = self.find(path)?;
        let Source { text, lines, .. } = &self.files[file.index()];
        let line = position.line.saturating_sub(1) as usize;
        let start = lines.get(line).copied().unwrap_or(text.len());
        let end = text[start..].find('\n').map_or(text.len(), |length| start + length);
        let column = position.column.saturating_sub(1) as usize;
        let within = text[start..end].char_indices().nth(column);
        let offset = within.map_or(end, |(offset, _)| start + offset);
        Some(Span::new(file, offset..offset))
    }

    /// The number of files.
    #[must_use]
    pub fn len(&self) -> usize {
        self.files.len()
    }

    /// Whether nothing was read.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.files.is_empty()
    }

    /// The path of a file, as the front end knows it.
    #[must_use]
    pub fn path(&self, file: FileId) -> &str {
        &self.files[file.index()].path
    }

    /// The paths of all files.
    pub fn paths(&self) -> impl Iterator<Item = &str> {
        self.files.iter().filter(|file| !file.stated).map(|file| file.path.as_str())
    }

    /// The text of a file.
    #[must_use]
    pub fn text(&self, file: FileId) -> &str {
        &self.files[file.index()].text
    }

    /// The text of a span.
    #[must_use]
    pub fn slice(&self, span: Span) -> &str {
        self.text(span.file).get(span.range()).unwrap_or_default()
    }

    /// Where a span starts.
    #[must_use]
    pub fn position(&self, span: Span) -> Position {
        let source = &self.files[span.file.index()];
        let offset = (span.start as usize).min(source.text.len());
        let line = source.lines.partition_point(|start| *start <= offset);
        let before = source.text.get(source.lines[line - 1]..offset).unwrap_or_default();
        let count = |n| u32::try_from(n).unwrap_or(u32::MAX);
        Position { line: count(line), column: count(before.chars().count() + 1) }
    }
}

/// The name of a file without its folder and its extension.
pub(crate) fn stem(path: &str) -> &str {
    let name = path.rsplit(['/', '\\']).next().unwrap_or(path);
    name.rsplit_once('.').map_or(name, |(stem, _)| stem)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_count_characters() {
        let mut sources = Sources::new();
        let file = sources.add("a.lf", "one\nzwö drei\n".to_owned());
        let at = "one\nzwö ".len();
        let position = sources.position(Span::new(file, at..at + 4));
        assert_eq!((position.line, position.column), (2, 5));
        assert_eq!(sources.slice(Span::new(file, at..at + 4)), "drei");
    }

    #[test]
    fn a_line_and_a_column_are_a_span() {
        let mut sources = Sources::new();
        sources.add("a.lf", "one\nzwö drei\n".to_owned());
        let at = |line, column| sources.at("a.lf", Position { line, column });
        let span = at(2, 5).unwrap();
        assert_eq!(sources.position(span), Position { line: 2, column: 5 });
        assert_eq!(span.range(), 9..9);
        assert_eq!(at(2, 99).unwrap().range(), 13..13, "the end of the line");
        assert_eq!(at(9, 1).unwrap().range(), 14..14, "the end of the text");
        assert_eq!(sources.at("b.lf", Position { line: 1, column: 1 }), None);
    }
}
