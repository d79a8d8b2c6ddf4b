//! The shares that federates write of one trace: a folder beside the trace while the run lasts.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use hprm_core::{FederateId, Program};

use super::line::RunEnding;
use super::merge::{Known, merge};
use super::{Folder, Reader, TraceShare};
use crate::{Failure, Kind, Label, Report, random_bytes};

/// The folder with the shares. It is gone when this is.
#[derive(Debug)]
pub struct Parts {
    /// What the trace will be called.
    path: PathBuf,
    folder: Folder,
    /// How many processes of each federate took part, as far as that is known.
    took_part: BTreeMap<FederateId, u32>,
}

impl Parts {
    /// Makes room for the shares of a trace that will be called `path`.
    ///
    /// # Errors
    ///
    /// If the folder cannot be made.
    pub fn of(path: &Path) -> Result<Self, Failure> {
        let folder = Folder::of(path)?;
        Ok(Self { path: path.to_owned(), folder, took_part: BTreeMap::new() })
    }

    /// The same, where it is known how many processes of each federate took part: also those that others have started.
    #[must_use]
    pub fn of_processes(self, took_part: BTreeMap<FederateId, u32>) -> Self {
        Self { took_part, ..self }
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

    /// What a process writes that has joined as a federate of its own accord. `shares` is where it finds the others.
    ///
    /// # Errors
    ///
    /// If the system has no random numbers.
    pub fn share_of_joined(shares: TraceShare, federate: &str) -> Result<TraceShare, Failure> {
        let number = u64::from_ne_bytes(random_bytes()?);
        let file = shares.file.join(format!("{federate}{JOINED}{number:016x}"));
        Ok(TraceShare { file, ..shares })
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
            Err(failure) if code != 0 => tell(Label::Warning, failure.report()),
            Err(failure) => return Err(failure),
            Ok(missing) => missing.iter().for_each(|(federate, count)| {
                tell(Label::Warning, self.has_nothing_of(federate, *count));
            }),
        }
        Ok(())
    }

    /// Returns how many processes of which federates have left no share.
    fn merge_shares(
        &self,
        program: &Program,
        interrupted: bool,
    ) -> Result<BTreeMap<String, u32>, Failure> {
        let mut shares = Vec::new();
        let mut known = Known { interrupted, ..Known::default() };
        for (id, federate) in program.federates.iter() {
            let (mut own, begun) = self.shares_of(&federate.name)?;
            let took_part = self.took_part.get(&id).copied().unwrap_or_default();
            let missing = took_part.saturating_sub(begun);
            if missing > 0 {
                // Which of them was the last one is not known.
                known.missing.insert(federate.name.clone(), missing);
                shares.extend(own.into_iter().map(left_early));
                continue;
            }
            match own.pop() {
                Some(last) => shares.extend(own.into_iter().map(left_early).chain([last])),
                None => known.absent = Some(federate.name.as_str()),
            }
        }
        let missing = known.missing.clone();
        merge(program, shares, known, &self.path)?;
        Ok(missing)
    }

    /// What the processes of a federate have left, by time, unless they had written nothing; and how many had begun.
    fn shares_of(&self, federate: &str) -> Result<(Vec<Share>, u32), Failure> {
        let names = self.names_of(federate);
        let (mut shares, mut broken) = (Vec::new(), Ok(()));
        for name in &names {
            match self.open(name) {
                // One that was killed when it began may have left half of a line.
                Some(Err(failure)) => broken = Err(failure),
                share => shares.extend(share.transpose()?),
            }
        }
        if shares.is_empty() {
            broken?;
        }
        // Those that have joined of their own accord came at any time between the others.
        shares.sort_by_key(|share| share.end.end);
        Ok((shares, u32::try_from(names.len()).unwrap_or(u32::MAX)))
    }

    /// The names of the files that processes of a federate have begun.
    fn names_of(&self, federate: &str) -> BTreeSet<String> {
        let entries = self.folder.path().read_dir().into_iter().flatten().flatten();
        let names = entries.filter_map(|entry| {
            let file = entry.file_name().into_string().ok()?;
            let name = file.strip_suffix(PARTIAL).unwrap_or(&file);
            let more = name.strip_prefix(federate)?;
            let is_again = |it: &str| it.bytes().all(|byte| byte.is_ascii_digit());
            let is_own = more.is_empty()
                || more.starts_with(JOINED)
                || more.strip_prefix('.').is_some_and(is_again);
            is_own.then(|| name.to_owned())
        });
        names.collect()
    }

    /// The warning that processes took part of which the trace has nothing.
    fn has_nothing_of(&self, federate: &str, count: u32) -> Report {
        let processes = if count == 1 { "a process" } else { "processes" };
        let path = self.path.display();
        let said = format!("the trace {path} has nothing of {processes} of federate {federate}");
        Report::new(Kind::Trace, said).of(federate).hint(
            "what a machine has recorded is lost with it; what you start yourself writes for that trace \
             if it joins on this machine without a --logical-trace",
        )
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

/// What follows the name of a federate in the name of a share of a process that has joined of its own accord.
const JOINED: &str = ".joined-";

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
