//! Reading a trace, one tag after the other, without holding all of it.
//!
//! How a run ended stands in the last line, but says which tags are complete, so it is read first.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use super::line::{At, End, Entry, Header, Line, RunEnding, VERSION};
use crate::{Failure, console};

/// Bytes at the end of a file among which the last line is found.
const TAIL: u64 = 1 << 16;

/// A trace that is being read.
#[derive(Debug)]
pub struct Reader<R> {
    /// What to call it in messages.
    pub name: String,
    /// Its first line.
    pub header: Header,
    /// How the run ended.
    pub end: End,
    /// Whether that stands in the file; else the trace breaks off.
    pub whole: bool,
    source: R,
    line: usize,
    /// The first entry of the next tag.
    next: Option<Entry>,
}

/// What happened at one tag.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Group {
    /// The tag.
    pub tag: At,
    /// What its reactions did, in the order of the file.
    pub entries: Vec<Entry>,
}

/// The failure that a trace cannot be read.
fn unreadable(name: &str, error: &io::Error) -> Failure {
    Failure::command(format!("cannot read the trace {name}: {}", console::reason(error)))
}

impl Reader<BufReader<File>> {
    /// Opens a file.
    ///
    /// # Errors
    ///
    /// If it cannot be read, or does not begin like a trace.
    pub fn open(path: &Path) -> Result<Self, Failure> {
        let name = path.display().to_string();
        let file = File::open(path).map_err(|error| unreadable(&name, &error))?;
        Self::new(&name, BufReader::new(file))
    }
}

impl<R: BufRead + Seek> Reader<R> {
    /// Begins to read.
    ///
    /// # Errors
    ///
    /// If it does not begin like a trace.
    pub fn new(name: &str, mut source: R) -> Result<Self, Failure> {
        let (end, whole) = tail(&mut source).map_err(|error| unreadable(name, &error))?;
        let (program, names) = (String::new(), BTreeMap::new());
        let header = Header { hprm_logical_trace: 0, program, federated: false, names };
        let name = name.to_owned();
        let mut reader = Self { name, header, end, whole, source, line: 0, next: None };
        match reader.read()? {
            Some(Line::Header(header)) if header.hprm_logical_trace == VERSION => {
                reader.header = header;
            }
            Some(Line::Header(Header { hprm_logical_trace: version, .. })) => {
                let what =
                    format!("{} is a trace of version {version}, not {VERSION}", reader.name);
                return Err(
                    Failure::command(what).with_hint("record it again with this version of hprm")
                );
            }
            _ => return Err(reader.bad()),
        }
        reader.advance()?;
        Ok(reader)
    }

    /// The tag of the next group.
    pub fn next_tag(&self) -> Option<At> {
        self.next.as_ref().map(|entry| entry.tag)
    }

    /// What happened at the next tag; none at the end.
    ///
    /// # Errors
    ///
    /// If the file is no trace, or its tags are not in order.
    pub fn group(&mut self) -> Result<Option<Group>, Failure> {
        let Some(first) = self.next.take() else { return Ok(None) };
        let mut group = Group { tag: first.tag, entries: vec![first] };
        self.advance()?;
        while let Some(entry) = self.next.take_if(|entry| entry.tag == group.tag) {
            group.entries.push(entry);
            self.advance()?;
        }
        if self.next_tag().is_some_and(|next| next < group.tag) {
            return Err(self.bad());
        }
        Ok(Some(group))
    }

    fn advance(&mut self) -> Result<(), Failure> {
        self.next = match self.read()? {
            Some(Line::Entry(entry)) => Some(entry),
            Some(Line::Header(_)) => return Err(self.bad()),
            Some(Line::End(_)) if self.read()?.is_some() => return Err(self.is_over()),
            Some(Line::End(_)) | None => None,
        };
        Ok(())
    }

    /// The next line. What comes after the last line break was not written to its end.
    fn read(&mut self) -> Result<Option<Line>, Failure> {
        let mut text = String::new();
        self.line += 1;
        match self.source.read_line(&mut text) {
            Ok(_) if !text.ends_with('\n') => Ok(None),
            Ok(_) => serde_json::from_str(&text).map(Some).map_err(|_| self.bad()),
            Err(_) => Err(self.bad()),
        }
    }

    fn is_over(&self) -> Failure {
        Failure::command(format!("{}:{} comes after the end of the trace", self.name, self.line))
            .with_hint("a file has the logical trace of one run")
    }

    fn bad(&self) -> Failure {
        Failure::command(format!("{}:{} is no line of a logical trace", self.name, self.line))
            .with_hint("traces are written by hprm run --logical-trace FILE")
    }
}

/// How the run ended, as far as the last complete line tells, and whether it tells that at all.
fn tail(source: &mut (impl Read + Seek)) -> io::Result<(End, bool)> {
    let len = source.seek(SeekFrom::End(0))?;
    source.seek(SeekFrom::Start(len.saturating_sub(TAIL)))?;
    let mut bytes = Vec::new();
    source.read_to_end(&mut bytes)?;
    source.seek(SeekFrom::Start(0))?;
    let complete = bytes.iter().rposition(|byte| *byte == b'\n').map_or(&[][..], |at| &bytes[..at]);
    let last = complete.rsplit(|byte| *byte == b'\n').next().unwrap_or_default();
    let end = match serde_json::from_slice(last) {
        Ok(Line::End(end)) => return Ok((end, true)),
        Ok(Line::Entry(entry)) => entry.tag,
        Ok(Line::Header(_)) | Err(_) => (0, 0),
    };
    let message = Some("the trace breaks off: its process has not ended in order".to_owned());
    Ok((
        End {
            end,
            outcome: RunEnding::Failed,
            message,
            physical: false,
            tardy: 0,
            early: false,
            missing: BTreeMap::new(),
        },
        false,
    ))
}

#[cfg(test)]
pub(super) mod tests {
    use std::io::Cursor;

    use super::*;

    pub(crate) const HEADER: &str =
        "{\"hprm_logical_trace\":2,\"program\":\"M\",\"federated\":false}\n";

    /// A trace with these lines after its header.
    pub(crate) fn trace(name: &str, lines: &str) -> Reader<Cursor<String>> {
        Reader::new(name, Cursor::new(format!("{HEADER}{lines}"))).unwrap()
    }

    fn refused(text: &str) -> String {
        match Reader::new("a", Cursor::new(text.to_owned())) {
            Err(error) => format!("{error:?}"),
            Ok(mut reader) => loop {
                match reader.group() {
                    Ok(Some(_)) => {}
                    Ok(None) => return "nothing wrong".to_owned(),
                    Err(error) => return format!("{error:?}"),
                }
            },
        }
    }

    #[test]
    fn entries_come_by_tag() {
        let mut reader = trace(
            "a",
            "{\"tag\":[0,0],\"reaction\":\"M.1\"}\n{\"tag\":[0,0],\"reaction\":\"M.2\"}\n\
             {\"tag\":[0,1],\"reaction\":\"M.1\"}\n{\"end\":[0,1],\"outcome\":\"done\"}\n",
        );
        assert_eq!((reader.end.end, reader.end.outcome), ((0, 1), RunEnding::Done));
        let sizes = [Some(((0, 0), 2)), Some(((0, 1), 1)), None];
        for expected in sizes {
            let group = reader.group().unwrap();
            assert_eq!(group.map(|group| (group.tag, group.entries.len())), expected);
        }
    }

    #[test]
    fn a_trace_may_break_off_anywhere() {
        let line = "{\"tag\":[5,0],\"reaction\":\"M.1\"}\n";
        for cut in 1..=line.len() {
            let reader = trace("a", &format!("{line}{}", &line[..cut - 1]));
            assert!(!reader.whole);
            assert_eq!((reader.end.end, reader.end.outcome), ((5, 0), RunEnding::Failed));
        }
        assert_eq!(trace("a", "").end.end, (0, 0));
    }

    #[test]
    fn what_is_no_trace_is_refused_with_its_line() {
        assert!(refused("").contains("a:1 is no line"));
        assert!(refused("hello\n").contains("a:1 is no line"));
        assert!(refused(&format!("{HEADER}{HEADER}")).contains("a:2 is no line"));
        assert!(refused(&HEADER.replace(":2,", ":7,")).contains("version 7, not 2"));
        let entry = |tag: i64| format!("{{\"tag\":[{tag},0],\"reaction\":\"M.1\"}}\n");
        let back = format!("{HEADER}{}{}{}", entry(5), entry(4), entry(6));
        assert!(refused(&back).contains("is no line"));
        let end = "{\"end\":[5,0],\"outcome\":\"done\"}\n";
        let twice = format!("{HEADER}{}{end}{}{end}", entry(5), entry(5));
        assert!(refused(&twice).contains("a:4 comes after the end"));
    }
}
