//! The shares that federates write of one trace: a folder beside the trace while the run lasts.

use std::fs::{self, File};
use std::io::BufReader;
use std::path::{Path, PathBuf};

use hprm_core::Program;

use super::{Reader, merge};
use crate::message::Error;

/// The folder with the shares. It is gone when this is.
#[derive(Debug)]
pub(crate) struct Parts {
    /// What the trace will be called.
    path: PathBuf,
    folder: PathBuf,
}

impl Parts {
    /// Makes room for the shares of a trace that will be called `path`.
    ///
    /// # Errors
    ///
    /// If the folder cannot be made.
    pub(crate) fn of(path: &Path) -> Result<Self, Error> {
        let mut name = path.as_os_str().to_owned();
        name.push(format!(".parts-{}", std::process::id()));
        let folder = PathBuf::from(name);
        fs::create_dir(&folder).map_err(|error| {
            Error::new(format!("cannot write the trace {}: {error}", path.display()))
        })?;
        // Federates may run elsewhere in the file system.
        let folder = folder.canonicalize().unwrap_or(folder);
        Ok(Self { path: path.to_owned(), folder })
    }

    /// Where a federate writes its share.
    pub(crate) fn share(&self, federate: &str) -> PathBuf {
        self.folder.join(federate)
    }

    /// Makes one trace of the shares.
    ///
    /// # Errors
    ///
    /// If a share cannot be read, or the trace cannot be written.
    pub(crate) fn merge(self, program: &Program, interrupted: bool) -> Result<(), Error> {
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
    fn open(&self, federate: &str) -> Option<Result<Reader<BufReader<File>>, Error>> {
        let whole = self.share(federate);
        let partial = whole.with_file_name(format!("{federate}.partial"));
        let path = [whole, partial].into_iter().find(|path| path.exists())?;
        let empty = path.metadata().is_ok_and(|file| file.len() == 0);
        (!empty).then(|| Reader::open(&path))
    }
}

impl Drop for Parts {
    fn drop(&mut self) {
        // If that fails, what is left tells where it is.
        let _ = fs::remove_dir_all(&self.folder);
    }
}
