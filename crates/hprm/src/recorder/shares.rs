//! One trace of the shares of all processes of a run: a folder beside the trace while the run lasts.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use super::comparisons::Comparisons;
use super::convert::{Cut, Lost, Source, convert};
use super::remote::{Ending, Origin, is_origin};
use super::request::TraceRequest;
use super::share::{Content, ShareReader, file_of};
use super::times::{ClockSet, Times};
use crate::trace::{Draft, Folder, open_there};
use crate::{Failure, Kind, Report};

/// The shares of a trace. They are gone when this is.
#[derive(Debug)]
pub struct Shares {
    /// What the trace will be called.
    path: PathBuf,
    /// What is there already and is no plain file: it is written to.
    there: Option<File>,
    folder: Folder,
    capacity: usize,
}

impl Shares {
    /// Makes room for the shares of a trace that will be called `path`.
    ///
    /// # Errors
    ///
    /// If the folder cannot be made, or the trace cannot be written to what is there.
    pub fn of(path: &Path) -> Result<Self, Failure> {
        let unwritten = |error| Failure::trace(path, &error);
        let replaces = Draft::replaces(path).map_err(unwritten)?;
        let there = (!replaces).then(|| open_there(path)).transpose().map_err(unwritten)?;
        let folder = Folder::of(path)?;
        Ok(Self { path: path.to_owned(), there, folder, capacity: super::DEFAULT_CAPACITY })
    }

    /// The same, of processes of which each keeps so many records for each thread at most.
    #[must_use]
    pub fn with_capacity(self, capacity: usize) -> Self {
        Self { capacity, ..self }
    }

    /// Where the shares are.
    #[must_use]
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// What the processes are asked for.
    #[must_use]
    pub fn request(&self) -> TraceRequest {
        TraceRequest { path: self.folder().to_owned(), capacity: self.capacity, is_share: true }
    }

    /// Makes one trace of the shares that are there. Returns what the user should know: which processes were cut
    /// short, and what was lost.
    ///
    /// # Errors
    ///
    /// If the trace cannot be written.
    pub fn merge(mut self) -> Result<Option<Report>, Failure> {
        let unwritten = |error| Failure::trace(&self.path, &error);
        let mut lost = Vec::new();
        let mut files: Vec<_> = fs::read_dir(self.folder())
            .map_err(unwritten)?
            .filter_map(|entry| Some(entry.ok()?.path()))
            .collect();
        files.sort();
        let temporary = self.folder().join("trace.merged");
        let there = self.there.take();
        let replaces = there.is_none();
        let out = there.map_or_else(|| File::create(&temporary), Ok);
        let mut out = BufWriter::new(out.map_err(unwritten)?);
        for file in files.iter().filter(|file| !is_origin(file)) {
            lost.extend(add(file, &mut out).map_err(unwritten)?);
        }
        out.flush().map_err(unwritten)?;
        if replaces {
            fs::rename(&temporary, &self.path).map_err(unwritten)?;
        }
        Ok(self.report(&lost))
    }

    fn report(&self, lost: &[Lost]) -> Option<Report> {
        let records = lost.iter().fold(0_u64, |sum, lost| sum.saturating_add(lost.records));
        let of: Vec<_> = lost.iter().filter(|it| it.records > 0).map(|it| &*it.title).collect();
        let mut cut: BTreeMap<Cut, Vec<&str>> = BTreeMap::new();
        for Lost { title, cut: why, .. } in lost {
            why.iter().for_each(|why| cut.entry(*why).or_default().push(title));
        }
        let name = self.path.display();
        let mut said = Vec::new();
        if records > 0 {
            said.push(format!("{records} records of {} are missing", of.join(", ")));
        }
        for (cut, of) in cut {
            said.push(format!("the records of {} end {}", of.join(", "), cut.place()));
        }
        if said.is_empty() {
            return None;
        }
        let report = Report::new(Kind::Trace, format!("trace {name}: {}", said.join("; ")));
        Some(match records {
            0 => report,
            _ => report.hint(format!(
                "they came faster than they could be written; --trace-buffer {} keeps twice as many in memory",
                self.capacity * 2
            )),
        })
    }
}

/// Adds a share to the trace. A process that was killed at once may not have written its names.
fn add(file: &Path, out: &mut impl Write) -> io::Result<Option<Lost>> {
    let origin = Origin::of(file);
    let share = ShareReader::open(file).ok();
    // What another machine says of itself is not what other members have recorded.
    let is_of = |share: &ShareReader<_>| file.ends_with(file_of(share.names.member));
    let Some(share) = share.filter(is_of) else { return Ok(origin.and_then(absent)) };
    let (machine, comparisons, cut) = match origin {
        Some(Origin { machine, comparisons, ending, .. }) => {
            (Some(machine), comparisons, cut(ending))
        }
        None => (None, Comparisons::default(), Cut::Killed),
    };
    let times = Times::new(clock_set(file), comparisons);
    convert(share, Source { machine, times, cut }, out).map(Some)
}

fn cut(ending: Ending) -> Cut {
    match ending {
        // What the process has written has all come.
        Ending::Whole => Cut::Killed,
        Ending::Limit => Cut::Limit,
        Ending::Link => Cut::Link,
    }
}

/// What is said of a share of which nothing has arrived. Why a process has ended before it began, it says itself.
fn absent(Origin { federate, machine, ending, .. }: Origin) -> Option<Lost> {
    let title = format!("{federate} on {machine}");
    (ending == Ending::Link).then_some(Lost { title, records: 0, cut: Some(Cut::Link) })
}

/// When and how a process has set its clock: before the program starts, if it does at all.
fn clock_set(file: &Path) -> Option<ClockSet> {
    let mut share = ShareReader::open(file).ok()?;
    while let Some(content) = share.next_content().ok()? {
        let Content::Records(_, records) = content else { continue };
        if let Some(set) = records.iter().find_map(ClockSet::of) {
            return Some(set);
        }
        if records.iter().any(|record| record.kind == super::Kind::Started) {
            return None;
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use hprm_core::{FederateId, Tag};

    use super::super::collector::Reader;
    use super::super::names::Member;
    use super::super::perfetto::packets;
    use super::super::record::{Flags, Kind, Record};
    use super::super::remote::RemoteShare;
    use super::super::share::ShareWriter;
    use super::super::share::tests::names;
    use super::*;

    /// What a federate writes until a moment before its end.
    fn share(member: Member) -> Vec<u8> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("share");
        let record = Record::new(Kind::Scheduled, Flags::NONE, 0, Tag::new(5, 1));
        let record = Record { time: hprm_core::PhysicalTime(1_000), ..record };
        let mut writer = ShareWriter::create(&path, &names(member)).unwrap();
        writer.records(0, &[record.words()]).unwrap();
        fs::read(path).unwrap()
    }

    /// What is told of a share that has come so far, and how many packets the trace has.
    fn merged(bytes: &[u8], is_whole: Option<bool>) -> (Option<String>, usize) {
        let folder = tempfile::tempdir().unwrap();
        let trace = folder.path().join("trace");
        let shares = Shares::of(&trace).unwrap();
        let camera = (FederateId(0), "camera");
        let mut remote = RemoteShare::create(&shares.request(), camera, "robot2").unwrap();
        remote.add(bytes).unwrap();
        is_whole.into_iter().for_each(|is_whole| remote.end(is_whole).unwrap());
        let report = shares.merge().unwrap();
        let told = report.map(|it| it.message.split_once(": ").unwrap().1.to_owned());
        let text = fs::read(&trace).unwrap();
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
        (told, packets(&text).map(Result::unwrap).count())
    }

    #[test]
    fn a_share_that_has_come_in_part_is_in_the_trace_and_is_told() {
        let whole = share(Member::Federate(0));
        let killed = "the records of a on robot2 end where the process was killed";
        let cut = "the records of a on robot2 end where the link to its machine ended";
        assert_eq!(merged(&whole, Some(true)), (Some(killed.to_owned()), 4));
        for is_whole in [Some(false), None] {
            assert_eq!(merged(&whole, is_whole), (Some(cut.to_owned()), 4));
        }
        assert_eq!(merged(&whole[..whole.len() - 1], Some(false)), (Some(cut.to_owned()), 1));
    }

    #[test]
    fn of_a_share_of_which_nothing_has_come_the_link_is_told() {
        let cut = "the records of camera on robot2 end where the link to its machine ended";
        let bytes = share(Member::Federate(0));
        for some in [&bytes[..0], &bytes[..20]] {
            assert_eq!(merged(some, Some(false)), (Some(cut.to_owned()), 0));
            assert_eq!(merged(some, Some(true)), (None, 0));
        }
    }

    #[test]
    fn a_machine_records_for_its_own_federates_only() {
        for member in [Member::Rti, Member::Whole, Member::Federate(1)] {
            assert_eq!(merged(&share(member), Some(true)), (None, 0));
        }
    }
}
