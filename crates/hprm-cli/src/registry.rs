//! The federations of this user that run on this machine, for processes that want to join one.
//!
//! Each is a file in a folder that only this user can enter. It has the secret, so only its owner can read
//! it. `hprm run` holds a lock on it for as long as the federation runs; a file without one was left
//! by a command that was killed, and the next run of the program removes it. What the environment says does not
//! matter, so a process finds its federation from any terminal.

use std::fs::{self, DirBuilder, File, OpenOptions};
use std::io::{self, ErrorKind, Read, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use hprm::Address;
use hprm::FederationId;
use hprm::trace::{Parts, TraceShare};
use rustix::fs::{FlockOperation, flock};
use rustix::process::geteuid;
use serde::{Deserialize, Serialize};

use crate::declare;
use crate::message::Error;

/// How the names of the files end.
const ENDING: &str = "federation";

/// More is no such file.
const LONGEST: u64 = 1 << 20;

/// What a process needs to know to join a federation.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub(crate) struct Record {
    /// The file of the program, without links in its path.
    pub(crate) program: PathBuf,
    /// Where the RTI listens.
    pub(crate) rti: String,
    federation: String,
    /// Target properties that override the program's, as `KEY=VALUE`.
    pub(crate) properties: Vec<String>,
    /// The interpreter that runs the bodies.
    pub(crate) python: PathBuf,
    /// Whether it has made the commands that start its transient federates, and removes them.
    pub(crate) made: bool,
    /// If its logical trace is recorded: the folder for the shares of processes, and how the user calls the trace.
    #[serde(default)]
    pub(crate) shares: Option<(PathBuf, PathBuf)>,
}

impl Record {
    /// What is to be known of a federation that is about to run.
    pub(crate) fn new(
        program: &Path,
        rti: &Address,
        federation: FederationId,
        properties: Vec<String>,
        python: &Path,
    ) -> Self {
        Self {
            program: real(program),
            rti: rti.to_string(),
            federation: federation.to_string(),
            properties,
            python: python.to_owned(),
            made: false,
            shares: None,
        }
    }

    /// What a process that joins as a federate writes of the logical trace; none if there is no room for it here.
    ///
    /// # Errors
    ///
    /// If the system has no random numbers.
    pub(crate) fn share(&self, federate: &str) -> Result<Option<TraceShare>, Error> {
        let Some((folder, trace)) = &self.shares else { return Ok(None) };
        if !folder.is_dir() {
            return Ok(None);
        }
        let shares = TraceShare::new(folder.clone(), Some(trace.clone()));
        Ok(Some(Parts::share_of_joined(shares, federate)?))
    }

    /// The secret of the federation.
    pub(crate) fn federation(&self) -> Option<FederationId> {
        self.federation.parse().ok()
    }
}

/// Keeps a federation on record while this lives.
#[derive(Debug)]
pub(crate) struct Entry {
    path: PathBuf,
    /// Locked.
    _file: File,
}

impl Drop for Entry {
    fn drop(&mut self) {
        // The next run of the program does the same.
        let _ = fs::remove_file(&self.path);
    }
}

/// Puts a federation on record.
///
/// # Errors
///
/// If there is no folder that only this user can enter.
pub(crate) fn enter(record: &Record) -> Result<Entry, Error> {
    enter_in(&folder()?, record)
}

fn enter_in(folder: &Path, record: &Record) -> Result<Entry, Error> {
    let name = u64::from_ne_bytes(hprm::random_bytes()?);
    let path = folder.join(format!("{name:016x}.{ENDING}"));
    let draft = path.with_extension("draft");
    let text = serde_json::to_vec(record).expect("a record is plain data");
    let written =
        OpenOptions::new().write(true).create_new(true).mode(0o600).open(&draft).and_then(
            |mut file| {
                // Locked and whole before others see it.
                flock(&file, FlockOperation::NonBlockingLockExclusive)?;
                file.write_all(&text)?;
                fs::rename(&draft, &path)?;
                Ok(file)
            },
        );
    match written {
        Ok(file) => Ok(Entry { path, _file: file }),
        Err(error) => {
            let _ = fs::remove_file(&draft);
            Err(Error::new(format!("cannot write {}: {error}", path.display())))
        }
    }
}

/// Has other processes wait that change what the federations of a program share, while the result lives.
///
/// # Errors
///
/// If there is no folder that only this user can enter.
pub(crate) fn alone() -> Result<File, Error> {
    let path = folder()?.join("lock");
    let opened = OpenOptions::new().create(true).append(true).mode(0o600).open(&path);
    let locked = opened.and_then(|file| {
        flock(&file, FlockOperation::LockExclusive).map(|()| file).map_err(Into::into)
    });
    locked.map_err(|error| Error::new(format!("cannot lock {}: {error}", path.display())))
}

/// The federations of a program that run.
pub(crate) fn of_program(program: &Path) -> Vec<Record> {
    let program = real(program);
    let mut running = running();
    running.retain(|record| record.program == program);
    running
}

/// The federation whose RTI listens at an address, if it runs.
pub(crate) fn at(rti: &Address) -> Option<Record> {
    let rti = rti.to_string();
    running().into_iter().find(|record| record.rti == rti)
}

fn running() -> Vec<Record> {
    let found = folder().map_or_else(|_| Vec::new(), |folder| read(&folder));
    found.into_iter().filter_map(|(_, record, is_live)| record.filter(|_| is_live)).collect()
}

/// Removes what federations of a program have left that were killed. Returns whether they have left
/// commands, too, which the caller is to remove.
pub(crate) fn sweep(program: &Path) -> bool {
    let program = real(program);
    let dead = folder().map_or_else(|_| Vec::new(), |folder| read(&folder));
    let mut made = false;
    for (path, record, _) in dead.into_iter().filter(|(_, _, is_live)| !is_live) {
        // Another program's commands are for its next run to remove, as long as it is there.
        let other = record.as_ref().filter(|record| record.program != program);
        if other.is_none_or(|record| !declare::file_of(&record.program).exists()) {
            let _ = fs::remove_file(&path);
            made |= record.is_some_and(|record| record.program == program && record.made);
        }
    }
    made
}

/// All files on record, with what is in them, and whether the federation runs.
fn read(folder: &Path) -> Vec<(PathBuf, Option<Record>, bool)> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.extension().is_none_or(|extension| extension != ENDING) {
            continue;
        }
        let Ok(file) = File::open(&path) else { continue };
        let is_live = flock(&file, FlockOperation::NonBlockingLockShared).is_err();
        let mut text = Vec::new();
        let whole = file.take(LONGEST).read_to_end(&mut text).is_ok();
        let record = serde_json::from_slice(&text).ok().filter(|_| whole);
        found.push((path, record, is_live));
    }
    found
}

/// The folder for the records of this user, which is made if it is missing.
fn folder() -> Result<PathBuf, Error> {
    let user = geteuid().as_raw();
    let runtime = PathBuf::from(format!("/run/user/{user}"));
    let folder = match is_private(&runtime) {
        Ok(true) => runtime.join("hprm"),
        _ => PathBuf::from(format!("/tmp/hprm-{user}")),
    };
    private(folder)
}

fn private(folder: PathBuf) -> Result<PathBuf, Error> {
    let wrong = |reason: &dyn std::fmt::Display| {
        Error::new(format!("{} cannot keep secrets: {reason}", folder.display()))
    };
    match DirBuilder::new().mode(0o700).create(&folder) {
        Err(error) if error.kind() != ErrorKind::AlreadyExists => Err(wrong(&error)),
        _ => match is_private(&folder) {
            Ok(true) => Ok(folder),
            Ok(false) => Err(wrong(&"others can enter it, or own it").hint("remove it")),
            Err(error) => Err(wrong(&error)),
        },
    }
}

/// Whether this is a folder, and no link to one, that only this user can enter.
fn is_private(folder: &Path) -> io::Result<bool> {
    let metadata = fs::symlink_metadata(folder)?;
    let is_own = metadata.uid() == geteuid().as_raw();
    Ok(metadata.is_dir() && is_own && metadata.mode() & 0o077 == 0)
}

/// The path of a program without links. The name of a reactor that follows it stays.
fn real(path: &Path) -> PathBuf {
    let file = declare::file_of(path);
    let Ok(real) = file.canonicalize() else { return path.to_owned() };
    let name = &path.as_os_str().as_encoded_bytes()[file.as_os_str().len()..];
    let mut real = real.into_os_string();
    real.push(String::from_utf8_lossy(name).as_ref());
    real.into()
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::{PermissionsExt, symlink};

    use super::*;

    fn record(program: &Path) -> Record {
        let rti = "unix:@here".parse().unwrap();
        let python = Path::new("/usr/bin/python3");
        Record::new(program, &rti, FederationId(7), vec!["timeout=5 s".to_owned()], python)
    }

    #[test]
    fn a_federation_is_on_record_while_it_runs() {
        let folder = tempfile::tempdir().unwrap();
        let entry = enter_in(folder.path(), &record(Path::new("/a.lf"))).unwrap();
        assert_eq!(entry.path.metadata().unwrap().mode() & 0o777, 0o600);
        let path = entry.path.clone();
        assert_eq!(read(folder.path()), [(path, Some(record(Path::new("/a.lf"))), true)]);
        drop(entry);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn what_was_killed_does_not_run() {
        let folder = tempfile::tempdir().unwrap();
        let text = serde_json::to_vec(&record(Path::new("/a.lf"))).unwrap();
        let path = folder.path().join("1.federation");
        fs::write(&path, text).unwrap();
        assert_eq!(read(folder.path()), [(path.clone(), Some(record(Path::new("/a.lf"))), false)]);
        fs::write(&path, "{").unwrap();
        assert_eq!(read(folder.path()), [(path, None, false)]);
    }

    #[test]
    fn a_program_is_known_by_its_real_path() {
        let folder = tempfile::tempdir().unwrap();
        let (file, link) = (folder.path().join("A.lf"), folder.path().join("B.lf"));
        fs::write(&file, "").unwrap();
        symlink(&file, &link).unwrap();
        assert_eq!(record(&file), record(&link));
    }

    #[test]
    fn a_folder_that_others_enter_keeps_no_secrets() {
        let place = tempfile::tempdir().unwrap();
        let folder = private(place.path().join("made")).unwrap();
        assert_eq!(folder.metadata().unwrap().mode() & 0o777, 0o700);
        private(folder.clone()).unwrap();
        symlink(&folder, place.path().join("link")).unwrap();
        assert!(private(place.path().join("link")).is_err());
        fs::set_permissions(&folder, fs::Permissions::from_mode(0o750)).unwrap();
        assert!(private(folder).is_err());
        fs::write(place.path().join("file"), "").unwrap();
        assert!(private(place.path().join("file")).is_err());
    }

    #[test]
    fn a_program_in_python_keeps_the_name_of_its_reactor() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path().canonicalize().unwrap();
        fs::write(folder.join("app.py"), "").unwrap();
        symlink(folder.join("app.py"), folder.join("link.py")).unwrap();
        assert_eq!(real(&folder.join("link.py:Vision")), folder.join("app.py:Vision"));
        assert_eq!(real(&folder.join("link.py")), folder.join("app.py"));
    }
}
