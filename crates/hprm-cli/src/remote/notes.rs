//! What a stand-in leaves for its launcher when it ends as a federate did that a signal has ended: why.
//!
//! The launcher sees how the process of the stand-in ends, and no more. The note stands in the file in which the stand-in finds
//! its errand, behind it: both have that file.

use std::fs::File;
use std::io::{self, Write};
use std::os::fd::AsFd;
use std::os::unix::fs::FileExt;

use hprm::Report;
use serde::{Deserialize, Serialize};

use crate::top::bytes as bytes_in_words;

/// The most bytes of a note.
const LIMIT: usize = 4096;

/// Where a note may come to be.
pub(super) struct Note {
    file: File,
    begin: u64,
}

/// Why a federate has ended.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub(super) struct Why {
    pub(super) message: String,
    pub(super) hint: String,
}

impl Note {
    /// Behind all that is in a file now.
    ///
    /// # Errors
    ///
    /// If there is no descriptor left.
    pub(super) fn behind(file: &File) -> io::Result<Self> {
        Ok(Self { begin: file.metadata()?.len(), file: file.try_clone()? })
    }

    /// The note, if there is one. It is complete once the stand-in has ended.
    pub(super) fn read(&self) -> Option<Why> {
        let mut text = vec![0; LIMIT];
        let count = self.file.read_at(&mut text, self.begin).ok()?;
        postcard::from_bytes(text.get(..count)?).ok()
    }
}

impl Why {
    /// Writes it for the launcher of this process, which has read its errand by now.
    ///
    /// # Errors
    ///
    /// If the file cannot be written.
    pub(super) fn leave(&self) -> io::Result<()> {
        self.write(File::from(io::stdin().as_fd().try_clone_to_owned()?))
    }

    fn write(&self, mut file: File) -> io::Result<()> {
        file.write_all(&postcard::to_allocvec(self).map_err(io::Error::other)?)
    }

    /// Has a report say so that begins with how the process has ended, and may go on with what follows.
    pub(super) fn explain(self, report: Report) -> Report {
        let followed = report.message.split_once("; ").map(|(_, rest)| format!("; {rest}"));
        let message = self.message + &followed.unwrap_or_default();
        Report { message, hint: Some(self.hint), ..report }
    }
}

/// A number of bytes as `--program-memory` may have stated it.
pub(super) fn size(bytes: u64) -> String {
    let units = [("TiB", 40), ("GiB", 30), ("MiB", 20), ("KiB", 10)];
    let stated = units.iter().find(|(_, shift)| bytes.is_multiple_of(1 << shift) && bytes > 0);
    match stated {
        Some((unit, shift)) if bytes >> shift < 10_000 => format!("{} {unit}", bytes >> shift),
        _ => bytes_in_words(bytes),
    }
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use hprm::Kind;

    use super::*;

    #[test]
    fn a_note_stands_behind_the_errand() {
        let mut file = tempfile::tempfile().unwrap();
        file.write_all(b"an errand").unwrap();
        let note = Note::behind(&file).unwrap();
        assert_eq!(note.read(), None);
        io::Seek::rewind(&mut file).unwrap();
        file.read_to_string(&mut String::new()).unwrap();
        let why =
            Why { message: "it was too large".to_owned(), hint: "make it smaller".to_owned() };
        why.write(file).unwrap();
        assert_eq!(note.read(), Some(why));
    }

    #[test]
    fn sizes_are_told_as_they_were_stated() {
        for (bytes, told) in [
            (512 << 20, "512 MiB"),
            (4 << 30, "4 GiB"),
            (1500 << 30, "1500 GiB"),
            (8_343_457_792, "8.34 GB"),
        ] {
            assert_eq!(size(bytes), told);
        }
    }

    #[test]
    fn what_follows_of_an_end_is_told_as_before() {
        let why =
            Why { message: "it was too large".to_owned(), hint: "make it smaller".to_owned() };
        for (told, expected) in [
            ("federate a was killed by signal 9 (SIGKILL)", "it was too large"),
            ("federate a was killed; restart 1 follows", "it was too large; restart 1 follows"),
        ] {
            let report = why.clone().explain(Report::new(Kind::Killed, told).hint("see dmesg"));
            assert_eq!(report.message, expected);
            assert_eq!(report.hint.as_deref(), Some("make it smaller"));
        }
    }
}
