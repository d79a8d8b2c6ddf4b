//! A file that gets its name when it is complete: nobody takes half a trace for a whole one.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use super::line::Line;

/// A trace that is being written, beside its final name.
#[derive(Debug)]
pub struct Draft {
    path: PathBuf,
    partial: PathBuf,
    out: BufWriter<File>,
}

impl Draft {
    /// Starts a file that will be called `path`. Until then it has the ending `.partial`.
    ///
    /// # Errors
    ///
    /// If it cannot be made.
    pub fn create(path: &Path) -> io::Result<Self> {
        let mut name = path.as_os_str().to_owned();
        name.push(".partial");
        let partial = PathBuf::from(name);
        let out = BufWriter::new(File::create(&partial)?);
        Ok(Self { path: path.to_owned(), partial, out })
    }

    /// Appends a line.
    ///
    /// # Errors
    ///
    /// If it cannot be written.
    pub fn write(&mut self, line: &Line) -> io::Result<()> {
        serde_json::to_writer(&mut self.out, line)?;
        self.out.write_all(b"\n")
    }

    /// Gives the file its name; one that had it before is gone.
    ///
    /// # Errors
    ///
    /// If that fails; the file keeps its partial name.
    pub fn publish(mut self) -> io::Result<()> {
        self.out.flush()?;
        std::fs::rename(&self.partial, &self.path)
    }
}
