//! Files without a name, that another process of this user writes for this one, or reads.
//!
//! Nothing of such a file is ever left, however the processes end. What is in it, is up to the two.

use std::fs::File;
use std::io::{self, Read, Seek, Write};
use std::os::fd::AsRawFd;
use std::path::PathBuf;

use rustix::fs::{MemfdFlags, memfd_create};

/// The longest text that is read, in bytes.
const MAX: u64 = 64 << 20;

/// A file without a name in a file system; it is in memory, and goes away with the last process that has it open.
#[derive(Debug)]
pub struct Answer(File);

impl Answer {
    /// An empty file.
    ///
    /// # Errors
    ///
    /// If the system has no memory or no descriptor for it.
    pub fn new() -> io::Result<Self> {
        Ok(Self(memfd_create("hprm-answer", MemfdFlags::CLOEXEC)?.into()))
    }

    /// A file with these bytes.
    ///
    /// # Errors
    ///
    /// If the system has no memory or no descriptor for it.
    pub(crate) fn with(bytes: &[u8]) -> io::Result<Self> {
        let mut answer = Self::new()?;
        answer.0.write_all(bytes)?;
        Ok(answer)
    }

    /// Where other processes of this user find it, for as long as this process has it.
    pub fn path(&self) -> PathBuf {
        PathBuf::from(format!("/proc/{}/fd/{}", std::process::id(), self.0.as_raw_fd()))
    }

    /// What has been written; of a very long text only the beginning.
    ///
    /// # Errors
    ///
    /// If it is not UTF-8 text.
    pub fn read(&mut self) -> io::Result<String> {
        let mut text = String::new();
        self.0.rewind()?;
        (&self.0).take(MAX).read_to_string(&mut text)?;
        Ok(text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn another_writer_opens_it_by_its_path_and_it_is_read_from_the_beginning() {
        let mut answer = Answer::with(b"the old text").unwrap();
        assert_eq!(answer.read().unwrap(), "the old text");
        std::fs::write(answer.path(), "new").unwrap();
        assert_eq!(answer.read().unwrap(), "new");
        std::fs::write(answer.path(), b"\xff").unwrap();
        assert_eq!(answer.read().unwrap_err().kind(), io::ErrorKind::InvalidData);
        let path = answer.path();
        drop(answer);
        assert!(!path.exists());
    }
}
