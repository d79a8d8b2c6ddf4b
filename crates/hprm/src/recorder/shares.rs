//! One trace of the shares of all processes of a run: a folder beside the trace while the run lasts.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use super::convert::{Lost, convert};
use super::request::TraceRequest;
use super::share::ShareReader;
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
        for file in files {
            lost.extend(add(&file, &mut out).map_err(unwritten)?);
        }
        out.flush().map_err(unwritten)?;
        if replaces {
            fs::rename(&temporary, &self.path).map_err(unwritten)?;
        }
        Ok(self.report(&lost))
    }

    fn report(&self, lost: &[Lost]) -> Option<Report> {
        let records: u64 = lost.iter().map(|lost| lost.records).sum();
        let of: Vec<_> = lost.iter().filter(|it| it.records > 0).map(|it| &*it.title).collect();
        let cut: Vec<_> = lost.iter().filter(|it| it.is_cut).map(|it| &*it.title).collect();
        let name = self.path.display();
        let mut said = Vec::new();
        if records > 0 {
            said.push(format!("{records} records of {} are missing", of.join(", ")));
        }
        if !cut.is_empty() {
            said.push(format!(
                "the records of {} end where the process was killed",
                cut.join(", ")
            ));
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
    match ShareReader::open(file) {
        Ok(share) => convert(share, out).map(Some),
        Err(_) => Ok(None),
    }
}
