//! The files with which a session of Zenoh connects, as long as it may.
//!
//! A session that is closed while other agents connect with one another can come back: what one of them tells of a third
//! after Zenoh 1.10 has stopped the tasks of the session, and before it has closed the connections, makes it connect to that
//! one (`net/protocol/gossip.rs`, `net/runtime/mod.rs` there). Such a session is never closed again. It has no tables to
//! speak of, which makes threads of Zenoh panic (`match_.upgrade().unwrap()` in `net/routing/hat/mod.rs`), and with them
//! the agent ends. When a roster changes, all agents close their sessions at about the same time, so it is no rare case.
//!
//! Zenoh reads the files of a certificate anew for each connection that it makes, and is told where they are once. So each
//! session has names of its own for them, which lead nowhere once it is to end: then it connects no more.

use std::fs::File;
use std::io;
use std::os::fd::{AsRawFd, OwnedFd};
use std::path::{Path, PathBuf};

use rustix::fs::{Mode, OFlags, open};
use rustix::io::{DupFlags, dup3};

use crate::credentials::tls_in;
use crate::options::Tls;

/// See the module.
pub(crate) struct Door {
    /// The folder of the files. Its number is not free for another one before the session is gone.
    folder: OwnedFd,
}

impl Door {
    /// Opens the folder of the credentials of this machine.
    pub(crate) fn open(folder: &Path) -> io::Result<Self> {
        let flags = OFlags::PATH | OFlags::DIRECTORY | OFlags::CLOEXEC;
        Ok(Self { folder: open(folder, flags, Mode::empty())? })
    }

    /// Where the session finds the files.
    pub(crate) fn tls(&self) -> Tls {
        tls_in(&PathBuf::from(format!("/proc/self/fd/{}", self.folder.as_raw_fd())))
    }

    /// From now on, the session finds nothing.
    pub(crate) fn shut(&mut self) -> io::Result<()> {
        Ok(dup3(File::open("/dev/null")?, &mut self.folder, DupFlags::CLOEXEC)?)
    }
}

#[cfg(test)]
mod tests {
    use std::fs::{read, write};

    use super::*;

    #[test]
    fn files_are_there_until_the_door_is_shut() {
        let folder = tempfile::tempdir().unwrap();
        let names = tls_in(folder.path());
        for file in [&names.cert, &names.key, &names.ca] {
            write(file, file.to_str().unwrap()).unwrap();
        }
        let mut door = Door::open(folder.path()).unwrap();
        let behind = door.tls();
        assert_eq!(read(&behind.cert).unwrap(), read(&names.cert).unwrap());
        assert_eq!(read(&behind.key).unwrap(), read(&names.key).unwrap());
        // As of a certificate that is renewed: another file of that name.
        std::fs::remove_file(&names.ca).unwrap();
        write(&names.ca, "another").unwrap();
        assert_eq!(read(&behind.ca).unwrap(), b"another");
        door.shut().unwrap();
        // What is opened next does not take its place.
        let next = Door::open(folder.path()).unwrap();
        assert!([&behind.cert, &behind.key, &behind.ca].iter().all(|file| read(file).is_err()));
        assert!(read(next.tls().cert).is_ok());
        assert!(Door::open(&folder.path().join("absent")).is_err());
    }
}
