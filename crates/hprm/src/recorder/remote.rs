//! A share that comes from another machine: what arrives, and beside it what is known of that machine.
//!
//! ```text
//! federate-3           the share, as far as it has arrived
//! federate-3.machine   lines of JSON: the names of both, comparisons of its clock, how the share ended
//! ```
//!
//! Both are written as things happen, so they say what is true when the process is killed that writes them.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use hprm_core::FederateId;
use serde::{Deserialize, Serialize};

use super::comparisons::Comparisons;
use super::names::Member;
use super::request::TraceRequest;
use super::share::file_of;

/// The most bytes of a share that comes from another machine.
pub const SHARE_LIMIT: u64 = 1 << 30;

/// What the name of a file ends with that says where a share comes from.
const MACHINE: &str = ".machine";

/// How a share has ended that came from another machine.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub(super) enum Ending {
    /// All of it has come.
    Whole,
    /// The rest is more than a share may be.
    Limit,
    /// The link to the machine has ended, or the process that writes the share.
    Link,
}

#[derive(Serialize, Deserialize)]
enum Line {
    Names { federate: String, machine: String },
    Compared([i64; 3]),
    Ended(Ending),
}

/// Writes the share of a federate of another machine.
#[derive(Debug)]
pub struct RemoteShare {
    share: File,
    origin: File,
    comparisons: Comparisons,
    len: u64,
    limit: u64,
}

impl RemoteShare {
    /// Begins the share of a federate that runs on `machine`, among those that are asked for.
    ///
    /// # Errors
    ///
    /// If it cannot be written.
    pub fn create(
        request: &TraceRequest,
        (federate, name): (FederateId, &str),
        machine: &str,
    ) -> io::Result<Self> {
        let path = request.path.join(file_of(Member::federate(federate)));
        let share = File::create(&path)?;
        let origin = File::create(beside(&path))?;
        let comparisons = Comparisons::default();
        let mut begun = Self { share, origin, comparisons, len: 0, limit: SHARE_LIMIT };
        begun.note(&Line::Names { federate: name.to_owned(), machine: machine.to_owned() })?;
        Ok(begun)
    }

    /// More of the share has come. What is more than a share may be is left out.
    ///
    /// # Errors
    ///
    /// If it cannot be written.
    pub fn add(&mut self, bytes: &[u8]) -> io::Result<()> {
        let room = usize::try_from(self.limit - self.len).unwrap_or(usize::MAX);
        let taken = &bytes[..bytes.len().min(room)];
        self.len += taken.len() as u64;
        self.share.write_all(taken)
    }

    /// The clock of the machine has shown the second of these times between the other two, which are of this machine's.
    ///
    /// # Errors
    ///
    /// As [`Self::add`].
    pub fn compare(&mut self, times: [i64; 3]) -> io::Result<()> {
        if self.comparisons.add(times) {
            self.note(&Line::Compared(times))?;
        }
        Ok(())
    }

    /// The share ends: all of it has come, or the link to the machine has ended.
    ///
    /// # Errors
    ///
    /// As [`Self::add`].
    pub fn end(&mut self, is_whole: bool) -> io::Result<()> {
        let ending = match is_whole {
            _ if self.len == self.limit => Ending::Limit,
            true => Ending::Whole,
            false => Ending::Link,
        };
        self.note(&Line::Ended(ending))
    }

    fn note(&mut self, line: &Line) -> io::Result<()> {
        let mut text = serde_json::to_string(line)?;
        text.push('\n');
        self.origin.write_all(text.as_bytes())
    }
}

/// Where a share comes from.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct Origin {
    pub(super) federate: String,
    pub(super) machine: String,
    pub(super) comparisons: Comparisons,
    pub(super) ending: Ending,
}

impl Origin {
    /// What lies beside a share; none for one of this machine.
    pub(super) fn of(share: &Path) -> Option<Self> {
        Self::read(&fs::read_to_string(beside(share)).ok()?)
    }

    fn read(text: &str) -> Option<Self> {
        let mut names = None;
        let (mut comparisons, mut ending) = (Comparisons::default(), Ending::Link);
        for line in text.lines() {
            match serde_json::from_str(line) {
                Ok(Line::Names { federate, machine }) => names = Some((federate, machine)),
                Ok(Line::Compared(times)) => _ = comparisons.add(times),
                Ok(Line::Ended(how)) => ending = how,
                // The process was killed within it.
                Err(_) => break,
            }
        }
        let (federate, machine) = names?;
        Some(Self { federate, machine, comparisons, ending })
    }
}

/// Whether a file says where a share comes from, and is none itself.
pub(super) fn is_origin(path: &Path) -> bool {
    path.as_os_str().to_string_lossy().ends_with(MACHINE)
}

fn beside(share: &Path) -> PathBuf {
    let mut path = share.as_os_str().to_owned();
    path.push(MACHINE);
    PathBuf::from(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_known_of_a_machine_is_written_as_it_comes() {
        let folder = tempfile::tempdir().unwrap();
        let request = TraceRequest::file(folder.path());
        let path = folder.path().join("federate-3");
        let mut share = RemoteShare::create(&request, (FederateId(3), "camera"), "robot2").unwrap();
        let origin = || Origin::of(&path).unwrap();
        assert_eq!((&*origin().machine, origin().ending), ("robot2", Ending::Link));
        share.add(b"some").unwrap();
        share.compare([0, 10, 20]).unwrap();
        share.compare([100, 130, 190]).unwrap();
        assert_eq!(origin().comparisons.worst_bound(), Some(10));
        share.end(true).unwrap();
        assert_eq!((origin().ending, &*fs::read(&path).unwrap()), (Ending::Whole, &b"some"[..]));
        assert_eq!(Origin::of(&folder.path().join("federate-4")), None);
        let text = fs::read_to_string(beside(&path)).unwrap();
        for end in 0..text.len() {
            let known = Origin::read(&text[..end]);
            assert!(known.is_none_or(|it| it.machine == "robot2"), "{end}");
        }
        assert!(is_origin(&beside(&path)) && !is_origin(&path));
    }

    #[test]
    fn a_share_has_a_most_and_says_that_it_has_reached_it() {
        let folder = tempfile::tempdir().unwrap();
        let request = TraceRequest::file(folder.path());
        let mut share = RemoteShare::create(&request, (FederateId(0), "camera"), "robot2").unwrap();
        share.limit = 10;
        for _ in 0..5 {
            share.add(b"abcd").unwrap();
        }
        share.end(true).unwrap();
        let path = folder.path().join("federate-0");
        assert_eq!(fs::read(&path).unwrap(), b"abcdabcdab");
        assert_eq!(Origin::of(&path).unwrap().ending, Ending::Limit);
    }
}
