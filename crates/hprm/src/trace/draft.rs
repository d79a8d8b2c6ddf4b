//! A file that gets its name when it is complete: so a part of a trace is never taken for a whole one.
//!
//! What is there and is no plain file, such as a device, a pipe or a link, is written to instead. It
//! must never be replaced by a file.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};
use rustix::io::Errno;

use super::line::Line;

/// A trace that is being written, beside its final name unless that is no plain file. Without
/// [`Self::publish`] it leaves no file.
#[derive(Debug)]
pub struct Draft {
    /// Its name for now, and the one that it will have; none if it writes to what is there, or has its name.
    names: Option<[PathBuf; 2]>,
    out: BufWriter<File>,
}

impl Draft {
    /// Starts a file that will be called `path`. Until then it has the ending `.partial`.
    ///
    /// # Errors
    ///
    /// If it cannot be made.
    pub fn create(path: &Path) -> io::Result<Self> {
        if !Self::replaces(path)? {
            return Ok(Self { names: None, out: BufWriter::new(open_there(path)?) });
        }
        let mut name = path.as_os_str().to_owned();
        name.push(".partial");
        let partial = PathBuf::from(name);
        let out = BufWriter::new(File::create(&partial)?);
        Ok(Self { names: Some([partial, path.to_owned()]), out })
    }

    /// Whether a trace called `path` is a new file, and not written to what is there.
    ///
    /// # Errors
    ///
    /// If there cannot be a trace of that name.
    pub fn replaces(path: &Path) -> io::Result<bool> {
        if fs::metadata(path).is_ok_and(|there| there.is_dir()) {
            return Err(io::ErrorKind::IsADirectory.into());
        }
        match fs::symlink_metadata(path) {
            Ok(there) => Ok(there.is_file()),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(true),
            Err(error) => Err(error),
        }
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

    /// Hands what was written to the system, so that it stays if this process is killed.
    ///
    /// # Errors
    ///
    /// If it cannot be written.
    pub fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }

    /// Gives the file its name; one that had it before is gone.
    ///
    /// # Errors
    ///
    /// If that fails; there is no file then.
    pub fn publish(mut self) -> io::Result<()> {
        self.out.flush()?;
        if let Some([partial, path]) = &self.names {
            fs::rename(partial, path)?;
        }
        self.names = None;
        Ok(())
    }
}

impl Drop for Draft {
    fn drop(&mut self) {
        if let Some([partial, _]) = &self.names {
            // If that fails, its name says what it is.
            let _ = fs::remove_file(partial);
        }
    }
}

/// Opens what is there and is no plain file, at once: a pipe that nothing reads is an error. What programs have printed
/// to `/dev/stdout` stays.
pub(crate) fn open_there(path: &Path) -> io::Result<File> {
    let stream = ["/dev", "/proc"].iter().any(|folder| path.starts_with(folder));
    let mut options = OpenOptions::new();
    options.custom_flags(OFlags::NONBLOCK.bits().cast_signed());
    if stream {
        options.append(true);
    } else {
        options.write(true).create(true).truncate(true);
    }
    let file = options.open(path).map_err(|error| match Errno::from_io_error(&error) {
        Some(Errno::NXIO) => io::Error::other("nothing reads this pipe"),
        _ => error,
    })?;
    // A reader of the pipe may be slower than what is written.
    let flags = fcntl_getfl(&file)?;
    fcntl_setfl(&file, flags - OFlags::NONBLOCK)?;
    Ok(file)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use rustix::fs::{CWD, FileType, Mode, mknodat};

    use super::super::line::{Header, VERSION};
    use super::*;

    fn header() -> Line {
        let program = "x".repeat(100_000);
        let names = BTreeMap::new();
        Line::Header(Header { hprm_logical_trace: VERSION, program, federated: false, names })
    }

    #[test]
    fn what_is_there_and_is_no_plain_file_stays() {
        let folder = tempfile::tempdir().unwrap();
        let [pipe, link, file] = ["pipe", "link", "file"].map(|name| folder.path().join(name));
        mknodat(CWD, &pipe, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
        assert_eq!(Draft::create(&pipe).unwrap_err().to_string(), "nothing reads this pipe");
        std::os::unix::fs::symlink(&file, &link).unwrap();
        for _ in 0..2 {
            let mut draft = Draft::create(&link).unwrap();
            draft.write(&header()).unwrap();
            draft.publish().unwrap();
        }
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(fs::read_to_string(&file).unwrap().lines().count(), 1);
    }

    #[test]
    fn a_draft_gets_its_name_or_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("trace");
        let mut draft = Draft::create(&path).unwrap();
        draft.write(&header()).unwrap();
        drop(draft);
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 0);
        let mut draft = Draft::create(&path).unwrap();
        draft.write(&header()).unwrap();
        draft.publish().unwrap();
        assert!(path.is_file());
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 1);
    }

    #[test]
    fn a_full_device_is_an_error_and_stays() {
        let mut draft = Draft::create(Path::new("/dev/full")).unwrap();
        assert_eq!(draft.write(&header()).unwrap_err().kind(), io::ErrorKind::StorageFull);
        drop(draft);
        assert!(Path::new("/dev/full").exists());
    }
}
