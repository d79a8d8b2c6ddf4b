//! The shares that federates write of one trace: a folder beside the trace while the run lasts.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use hprm_core::Program;

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

    /// What a federate writes.
    #[must_use]
    pub fn share(&self, federate: &str) -> TraceShare {
        self.share_at(self.folder.path().join(federate))
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
            match self.open(&federate.name) {
                Some(share) => shares.push(share?),
                None => missing = Some(federate.name.as_str()),
            }
        }
        merge(program, shares, missing, interrupted, &self.path)
    }

    /// What a federate has left: all of its share, or what it had written when it ended.
    fn open(&self, federate: &str) -> Option<Result<Reader<BufReader<File>>, Failure>> {
        let whole = self.folder.path().join(federate);
        let partial = whole.with_file_name(format!("{federate}.partial"));
        let path = [whole, partial].into_iter().find(|path| path.exists())?;
        let empty = path.metadata().is_ok_and(|file| file.len() == 0);
        (!empty).then(|| Reader::open(&path))
    }
}
