//! A share that a federate writes on this machine for the launcher of another one: it is taken away as it grows.
//!
//! The file has no name once it has been opened here, so that it is gone with the processes that have it open; and what has
//! been taken needs no room on the disk any more. How a share travels is up to the caller.

use std::fs::{self, DirBuilder, File};
use std::io::{self, Read};
use std::os::unix::fs::DirBuilderExt;
use std::path::PathBuf;

use rustix::fs::{FallocateFlags, fallocate};

use super::request::TraceRequest;

/// After how many bytes the disk gets back the room of what has been taken.
const FREED: u64 = 1 << 20;

/// See the module.
#[derive(Debug)]
pub struct Outbox {
    folder: PathBuf,
    /// The share, once the federate has made it.
    share: Option<File>,
    taken: u64,
    freed: u64,
}

impl Outbox {
    /// Makes a folder for the share of one federate, in a place that the caller removes.
    ///
    /// # Errors
    ///
    /// If it cannot be made.
    pub fn create(folder: PathBuf) -> io::Result<Self> {
        DirBuilder::new().mode(0o700).create(&folder)?;
        Ok(Self { folder, share: None, taken: 0, freed: 0 })
    }

    /// What the federate is asked for, which this process starts; each of its threads keeps so many records at most.
    #[must_use]
    pub fn request(&self, capacity: usize) -> TraceRequest {
        TraceRequest { path: self.folder.clone(), capacity, is_share: true }
    }

    /// Takes what has come, as far as there is room. Returns how many bytes that is; 0 if there are none now.
    ///
    /// # Errors
    ///
    /// If the share cannot be read.
    pub fn take(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.share.is_none() {
            self.share = self.open()?;
        }
        let Some(share) = &mut self.share else { return Ok(0) };
        let count = share.read(buffer)?;
        self.taken += count as u64;
        if self.taken - self.freed >= FREED {
            let how = FallocateFlags::PUNCH_HOLE | FallocateFlags::KEEP_SIZE;
            // A file system that cannot do that keeps it until the run ends.
            let _ = fallocate(share, how, self.freed, self.taken - self.freed);
            self.freed = self.taken;
        }
        Ok(count)
    }

    fn open(&self) -> io::Result<Option<File>> {
        let Some(entry) = fs::read_dir(&self.folder)?.next().transpose()? else { return Ok(None) };
        // A hole needs a file that may be written to.
        let share = File::options().read(true).write(true).open(entry.path())?;
        fs::remove_file(entry.path())?;
        Ok(Some(share))
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;
    use std::os::unix::fs::MetadataExt;

    use super::*;

    #[test]
    fn a_share_is_taken_as_it_grows_and_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let mut outbox = Outbox::create(folder.path().join("trace")).unwrap();
        let mut buffer = vec![0; 1 << 16];
        assert_eq!(outbox.take(&mut buffer).unwrap(), 0);
        let request = outbox.request(8);
        assert!(request.is_share && request.capacity == 8);
        let mut share = File::create(request.path.join("federate-3")).unwrap();
        let (mut sent, mut came) = (Vec::new(), Vec::<u8>::new());
        for round in 0..100_u8 {
            let bytes = vec![round; 50_000];
            share.write_all(&bytes).unwrap();
            sent.extend(bytes);
            loop {
                match outbox.take(&mut buffer).unwrap() {
                    0 => break,
                    count => came.extend(&buffer[..count]),
                }
            }
            assert_eq!(fs::read_dir(&request.path).unwrap().count(), 0);
        }
        assert_eq!(came, sent);
        let metadata = share.metadata().unwrap();
        assert_eq!(metadata.len(), 5_000_000);
        assert!(metadata.blocks() * 512 < 5_000_000 / 2, "{} blocks", metadata.blocks());
    }
}
