//! Places in the files of a program: lines and columns to spans.
//!
//! A place may come from an older text than the one that is there, so one beyond the text is moved into it.

use hprm_model::{FileId, Library, Span};

use crate::Malformed;
use crate::document::{At, File};

/// The last line of a file without text that has a place of its own.
const LAST_LINE: u32 = 1 << 20;

/// The files of a program, as they are in its library.
pub(crate) struct Places {
    files: Vec<Lines>,
}

struct Lines {
    file: FileId,
    /// The range of each line, without white space at its end.
    lines: Vec<(usize, usize)>,
    text: String,
}

impl Places {
    /// Puts the files into a library of their own. A file without text gets as many empty lines as `last`
    /// says for it, so that its places have the right lines.
    pub(crate) fn new(
        files: &[File],
        last: impl Fn(usize) -> u32,
    ) -> Result<(Self, Library), Malformed> {
        let mut texts = texts(files, last);
        let Some((main, text)) = texts.next() else {
            return Err(Malformed::new("it has no files"));
        };
        let mut library = Library::new(&main.path, text.clone());
        let mut places = Self { files: vec![Lines::new(FileId::MAIN, text)] };
        places.add(texts, &mut library);
        Ok((places, library))
    }

    /// Puts the files into a library that has others.
    pub(crate) fn within(
        files: &[File],
        last: impl Fn(usize) -> u32,
        library: &mut Library,
    ) -> Self {
        let mut places = Self { files: Vec::new() };
        places.add(texts(files, last), library);
        places
    }

    fn add<'f>(&mut self, texts: impl Iterator<Item = (&'f File, String)>, library: &mut Library) {
        for (file, text) in texts {
            let id = library.add_file(&file.path, text.clone());
            self.files.push(Lines::new(id, text));
        }
    }

    /// The span of a place.
    pub(crate) fn span(&self, (file, line, column, end): At) -> Result<Span, Malformed> {
        let Some(Lines { file, lines, text }) = self.files.get(file) else {
            return Err(Malformed::new(format!("it has no file {file}")));
        };
        let line = (line.saturating_sub(1) as usize).min(lines.len() - 1);
        let (start, stop) = lines[line];
        let within = |column: usize| {
            let mut at = start.saturating_add(column).min(stop);
            while !text.is_char_boundary(at) {
                at -= 1;
            }
            at
        };
        let from = within(column as usize);
        let to = usize::try_from(end).map_or(stop, within).max(from);
        Ok(Span::new(*file, from..to))
    }
}

/// The files with their texts.
fn texts(files: &[File], last: impl Fn(usize) -> u32) -> impl Iterator<Item = (&File, String)> {
    let text = move |(index, file): (usize, &File)| match file.text.as_str() {
        "" => "\n".repeat(last(index).clamp(1, LAST_LINE) as usize - 1),
        text => text.to_owned(),
    };
    files.iter().enumerate().map(move |(index, file)| (file, text((index, file))))
}

impl Lines {
    fn new(file: FileId, text: String) -> Self {
        let mut start = 0;
        let line = |line: &str| {
            let range = (start, start + line.trim_end().len());
            start += line.len() + 1;
            range
        };
        let lines = text.split('\n').map(line).collect();
        Self { file, lines, text }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spans(text: &str, places: &[At]) -> Vec<(u32, u32)> {
        let file = File { path: "app.py".to_owned(), text: text.to_owned() };
        let (known, _) = Places::new(&[file], |_| 7).unwrap();
        let span = |at: &At| known.span(*at).unwrap();
        places.iter().map(span).map(|span| (span.start, span.end)).collect()
    }

    #[test]
    fn columns_are_bytes_and_a_line_ends_before_its_white_space() {
        let places = [(0, 1, 0, -1), (0, 2, 0, 2), (0, 2, 1, 3), (0, 2, 4, 1), (0, 1, 2, 3)];
        assert_eq!(spans("ab  \nü=1", &places), [(0, 2), (5, 7), (5, 8), (9, 9), (2, 2)]);
    }

    #[test]
    fn what_is_beyond_the_text_is_moved_into_it() {
        let places =
            [(0, 0, 0, -1), (0, 9, 0, -1), (0, 1, 99, 99), (0, u32::MAX, u32::MAX, i64::MIN)];
        assert_eq!(spans("ab\ncd", &places), [(0, 2), (3, 5), (2, 2), (5, 5)]);
        let (places, _) =
            Places::new(&[File { path: String::new(), text: String::new() }], |_| 1).unwrap();
        assert!(places.span((1, 1, 0, -1)).is_err());
    }

    #[test]
    fn a_text_that_is_not_known_has_lines() {
        assert_eq!(
            spans("", &[(0, 1, 0, -1), (0, 7, 4, 9), (0, 8, 4, 9)]),
            [(0, 0), (6, 6), (6, 6)]
        );
    }
}
