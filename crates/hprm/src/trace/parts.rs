//! The shares that federates write of one trace: a folder beside the trace while the run lasts.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use hprm_core::Program;

use super::line::RunEnding;
use super::merge::merge;
use super::{Folder, Reader, TraceShare};
use crate::{Failure, Label, Report};

/// The folder with the shares. It is gone when this is.
#[derive(Debug)]
pub struct Parts {
    /// What the trace will be called.
    path: PathBuf,
    folder: Folder,
}

impl Parts {
    /// Makes room for the shares of a trace that will be called `path`.
    ///
    /// # Errors
    ///
    /// If the folder cannot be made.
    pub fn of(path: &Path) -> Result<Self, Failure> {
        Ok(Self { path: path.to_owned(), folder: Folder::of(path)? })
    }

    /// What a federate writes that was started so many times before.
    #[must_use]
    pub fn share(&self, federate: &str, restarts: u32) -> TraceShare {
        self.share_at(self.folder.path().join(name_of(federate, restarts)))
    }

    /// What a process writes that has several federates: the shares of all, each in a file with the name of
    /// its federate.
    #[must_use]
    pub fn shares(&self) -> TraceShare {
        self.share_at(self.folder.path().to_owned())
    }

    /// A failure names the trace, unless the shares are elsewhere: then the place matters.
    fn share_at(&self, place: PathBuf) -> TraceShare {
        TraceShare::new(place, self.folder.is_beside().then(|| self.path.clone()))
    }

    /// Makes one trace of the shares. If the run has failed, with an exit `code` and a report, that is what
    /// the user should see first: then `tell` only gets a warning that there is no trace.
    ///
    /// # Errors
    ///
    /// If a share cannot be read, or the trace cannot be written.
    pub fn merge(
        self,
        program: &Program,
        interrupted: bool,
        code: i32,
        tell: &mut dyn FnMut(Label, Report),
    ) -> Result<(), Failure> {
        if !self.folder.path().exists() {
            // The federates could not write their shares, and have said why.
            return Ok(());
        }
        match self.merge_shares(program, interrupted) {
            Err(failure) if code != 0 => {
                tell(Label::Warning, failure.report());
                Ok(())
            }
            outcome => outcome,
        }
    }

    fn merge_shares(&self, program: &Program, interrupted: bool) -> Result<(), Failure> {
        let mut shares = Vec::new();
        let mut missing = None;
        for federate in program.federates.values() {
            let mut own = self.shares_of(&federate.name)?;
            match own.pop() {
                Some(last) => shares.extend(own.into_iter().map(left_early).chain([last])),
                None => missing = Some(federate.name.as_str()),
            }
        }
        merge(program, shares, missing, interrupted, &self.path)
    }

    /// What a federate has left each time that it was started, unless it had written nothing.
    fn shares_of(&self, federate: &str) -> Result<Vec<Share>, Failure> {
        let last = self.last_start(federate);
        let mut shares = Vec::new();
        for restarts in 0..=last {
            match self.open(&name_of(federate, restarts)) {
                // One that was killed when it began may have left half of a line.
                Some(Err(_)) if restarts < last => {}
                share => shares.extend(share.transpose()?),
            }
        }
        Ok(shares)
    }

    /// How often a federate was started again, as far as it has left something.
    fn last_start(&self, federate: &str) -> u32 {
        let entries = self.folder.path().read_dir().into_iter().flatten().flatten();
        let starts = entries.filter_map(|entry| {
            let name = entry.file_name().into_string().ok()?;
            let number = name.strip_prefix(federate)?.strip_prefix('.')?;
            number.trim_end_matches(PARTIAL).parse().ok()
        });
        starts.max().unwrap_or_default()
    }

    /// What a process has left: all of its share, or what it had written when it ended.
    fn open(&self, name: &str) -> Option<Result<Share, Failure>> {
        let whole = self.folder.path().join(name);
        let partial = whole.with_file_name(format!("{name}{PARTIAL}"));
        let path = [whole, partial].into_iter().find(|path| path.exists())?;
        let empty = path.metadata().is_ok_and(|file| file.len() == 0);
        (!empty).then(|| Reader::open(&path))
    }
}

type Share = Reader<BufReader<File>>;

/// How the name of a share ends that is not complete.
const PARTIAL: &str = ".partial";

/// The name of the file of a federate that was started so many times before.
fn name_of(federate: &str, restarts: u32) -> String {
    match restarts {
        0 => federate.to_owned(),
        _ => format!("{federate}.{restarts}"),
    }
}

/// The share of a process after which the federate was started again: it ends before the others, however it ended; and
/// at which tag the next one begins depends on clocks.
fn left_early(mut share: Share) -> Share {
    share.end.outcome = RunEnding::Done;
    (share.end.early, share.end.physical, share.end.message) = (true, true, None);
    share
}
