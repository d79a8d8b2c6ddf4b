//! Where a starter keeps the files of programs: by their digests, so that a file travels once, and laid out as a
//! program expects them, for as long as it runs.
//!
//! ```text
//! ~/.cache/hprm/programs/files/DIGEST     kept; the oldest are removed when there are too many bytes
//! ~/.cache/hprm/programs/runs/PROCESS     one run; removed at its end, or by the next starter
//! ```

use std::collections::BTreeSet;
use std::fs::{self, DirBuilder, File};
use std::io::{self, ErrorKind, Read};
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt, PermissionsExt};
use std::path::{Component, Path, PathBuf};
use std::time::{Duration, SystemTime};

use hprm::printable;
use rustix::fs::{FlockOperation, flock};

use super::program::{BYTES, FILES, digest};
use super::protocol::{Digest, Listed};

/// The most bytes of all files that are kept.
const KEPT: u64 = 4 << 30;

/// For how long a file is a draft, at most, or a run without a lock.
const DRAFTING: Duration = Duration::from_secs(3600);

/// The most bytes of a path, and the most names in it.
const PATH_LIMIT: usize = 1024;
const DEPTH_LIMIT: usize = 64;

/// See the module.
pub(super) struct Cache {
    files: PathBuf,
    runs: PathBuf,
}

/// The files of a program, where it finds them. They are removed when this is dropped.
pub(super) struct Laid {
    folder: PathBuf,
    _lock: File,
}

impl Cache {
    /// That of this user, without what others have left.
    pub(super) fn open() -> io::Result<Self> {
        let named = |name| std::env::var_os(name).map(PathBuf::from).filter(|it| it.is_absolute());
        let cache = named("XDG_CACHE_HOME").or_else(|| Some(named("HOME")?.join(".cache")));
        let cache = cache.unwrap_or_else(|| {
            let user = rustix::process::geteuid().as_raw();
            std::env::temp_dir().join(format!("hprm-{user}"))
        });
        Self::at(&cache.join("hprm/programs"))
    }

    fn at(folder: &Path) -> io::Result<Self> {
        let cache = Self { files: folder.join("files"), runs: folder.join("runs") };
        for folder in [&cache.files, &cache.runs] {
            DirBuilder::new().recursive(true).mode(0o700).create(folder)?;
        }
        cache.sweep();
        Ok(cache)
    }

    /// The files, by their places among `listed`, that are not there.
    pub(super) fn missing(&self, listed: &[Listed]) -> Vec<usize> {
        let is_there = |file: &Listed| {
            let found = fs::metadata(self.file(&file.digest));
            found.is_ok_and(|found| found.is_file() && found.len() == file.len)
        };
        let mut asked = BTreeSet::new();
        let places = listed.iter().enumerate();
        let missing = places.filter(|(_, it)| !is_there(it) && asked.insert(it.digest));
        missing.map(|(place, _)| place).collect()
    }

    /// Keeps a file that comes, if it is what its digest says.
    pub(super) fn keep(&self, file: &Listed, reader: impl Read) -> io::Result<()> {
        let path = self.file(&file.digest);
        let draft = path.with_extension(std::process::id().to_string());
        let kept = self.receive(file, reader, &draft).and_then(|()| fs::rename(&draft, &path));
        if kept.is_err() {
            // What cannot be removed now, another starter removes.
            let _ = fs::remove_file(&draft);
        }
        kept
    }

    fn receive(&self, file: &Listed, reader: impl Read, draft: &Path) -> io::Result<()> {
        let mut options = File::options();
        let mut kept = options.write(true).create(true).truncate(true).mode(0o600).open(draft)?;
        io::copy(&mut reader.take(file.len), &mut kept)?;
        let (len, found) = digest(File::open(draft)?)?;
        if len == file.len && found == file.digest {
            return Ok(());
        }
        let text = format!("{} is not what its digest says", file.path);
        Err(io::Error::new(ErrorKind::InvalidData, text))
    }

    /// Puts the files where the program expects them, below a folder of its own.
    pub(super) fn lay_out(&self, listed: &[Listed]) -> io::Result<Laid> {
        let folder = self.runs.join(std::process::id().to_string());
        // That number had another process, which was killed.
        let _ = fs::remove_dir_all(&folder);
        DirBuilder::new().mode(0o700).create(&folder)?;
        let lock = File::open(&folder)?;
        flock(&lock, FlockOperation::NonBlockingLockExclusive)?;
        let laid = Laid { folder, _lock: lock };
        for file in listed {
            let path = laid.folder.join(&file.path);
            if let Some(parent) = path.parent() {
                fs::create_dir_all(parent)?;
            }
            // A copy: what the program does with it stays in this run.
            fs::copy(self.file(&file.digest), &path)?;
            let mode = if file.is_executable { 0o700 } else { 0o600 };
            fs::set_permissions(&path, fs::Permissions::from_mode(mode))?;
            // A file that was kept and has changed since would be another program.
            let (len, found) = digest(File::open(&path)?)?;
            if (len, found) != (file.len, file.digest) {
                let _ = fs::remove_file(self.file(&file.digest));
                let text =
                    format!("{} has changed in the cache; it is removed: try again", file.path);
                return Err(io::Error::new(ErrorKind::InvalidData, text));
            }
        }
        self.touch(listed);
        Ok(laid)
    }

    /// Files that are used stay longest.
    fn touch(&self, listed: &[Listed]) {
        for file in listed {
            let kept = File::options().write(true).open(self.file(&file.digest));
            // It only decides which one is removed first.
            let _ = kept.and_then(|kept| kept.set_modified(SystemTime::now()));
        }
    }

    fn file(&self, digest: &Digest) -> PathBuf {
        let name: String = digest.iter().map(|byte| format!("{byte:02x}")).collect();
        self.files.join(name)
    }

    /// Removes what starters have left that were killed, and the oldest files if there are too many.
    fn sweep(&self) {
        for run in entries(&self.runs) {
            let lock = File::open(&run.path);
            let is_left = lock
                .as_ref()
                .is_ok_and(|lock| flock(lock, FlockOperation::NonBlockingLockExclusive).is_ok());
            // A new one may have no lock yet.
            if is_left && run.age > Duration::from_secs(60) {
                let _ = fs::remove_dir_all(&run.path);
            }
        }
        let mut kept = entries(&self.files);
        kept.sort_by_key(|file| file.age);
        let mut bytes = 0;
        for file in kept {
            bytes += file.len;
            let is_draft = file.path.extension().is_some() && file.age > DRAFTING;
            if bytes > KEPT || is_draft {
                let _ = fs::remove_file(&file.path);
            }
        }
    }
}

impl Laid {
    /// The folder with the files.
    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }
}

impl Drop for Laid {
    fn drop(&mut self) {
        // What cannot be removed now, another starter removes.
        let _ = fs::remove_dir_all(&self.folder);
    }
}

struct Entry {
    path: PathBuf,
    len: u64,
    age: Duration,
}

fn entries(folder: &Path) -> Vec<Entry> {
    let read = folder.read_dir().into_iter().flatten().flatten();
    let entry = |entry: fs::DirEntry| {
        let metadata = entry.metadata().ok()?;
        let age = SystemTime::now().duration_since(metadata.modified().ok()?).unwrap_or_default();
        Some(Entry { path: entry.path(), len: metadata.len(), age })
    };
    read.filter_map(entry).collect()
}

/// What is wrong with a list of files, of which `main` must be one.
pub(super) fn mistake(main: &str, listed: &[Listed]) -> Option<String> {
    if listed.len() > FILES
        || listed.iter().fold(0, |sum: u64, it| sum.saturating_add(it.len)) > BYTES
    {
        return Some(format!("a program has at most {FILES} files and {BYTES} bytes"));
    }
    let mut paths = BTreeSet::new();
    for Listed { path, .. } in listed {
        if !is_below(path) || !paths.insert(path) {
            return Some(format!("'{}' is no path of a file of a program", path.escape_debug()));
        }
    }
    (!listed.iter().any(|file| file.path == main)).then(|| "the program is not listed".to_owned())
}

/// Whether a path leads to a file below a folder, whatever is there.
fn is_below(path: &str) -> bool {
    let names = || Path::new(path).components();
    // Names of programs are shown to users of this machine.
    let is_plain = path.len() <= PATH_LIMIT && printable(path) == path && !path.ends_with('/');
    let is_named = names().all(|name| matches!(name, Component::Normal(_)));
    is_plain && is_named && (1..=DEPTH_LIMIT).contains(&names().count())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn listed(path: &str, text: &str) -> Listed {
        let (len, digest) = digest(text.as_bytes()).unwrap();
        Listed { path: path.to_owned(), len, digest, is_executable: path.ends_with(".sh") }
    }

    #[test]
    fn a_file_travels_once_and_every_run_has_its_own() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::at(folder.path()).unwrap();
        let files = [listed("Main.lf", "one"), listed("lib/a.py", "two"), listed("b.sh", "two")];
        assert_eq!(cache.missing(&files), [0, 1]);
        cache.keep(&files[0], "one and more".as_bytes()).unwrap();
        cache.keep(&files[1], "two".as_bytes()).unwrap();
        assert_eq!(cache.missing(&files), [] as [usize; 0]);
        let laid = cache.lay_out(&files).unwrap();
        let path = laid.folder().join("lib/a.py");
        assert_eq!(fs::read_to_string(&path).unwrap(), "two");
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o777;
        assert_eq!((mode(&path), mode(&laid.folder().join("b.sh"))), (0o600, 0o700));
        fs::write(&path, "changed").unwrap();
        let here = laid.folder().to_owned();
        drop(laid);
        assert!(!here.exists());
        assert_eq!(cache.missing(&files), [] as [usize; 0]);
    }

    #[test]
    fn what_is_not_what_its_digest_says_is_not_kept() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::at(folder.path()).unwrap();
        let file = listed("Main.lf", "one");
        for text in ["two", "on", ""] {
            assert!(cache.keep(&file, text.as_bytes()).is_err(), "{text}");
        }
        assert_eq!(fs::read_dir(&cache.files).unwrap().count(), 0);
        cache.keep(&file, "one".as_bytes()).unwrap();
        fs::write(cache.file(&file.digest), "two").unwrap();
        assert!(cache.lay_out(std::slice::from_ref(&file)).is_err());
        assert_eq!(cache.missing(&[file]), [0]);
        assert_eq!(fs::read_dir(&cache.runs).unwrap().count(), 0);
    }

    #[test]
    fn paths_stay_below_their_folder() {
        let main = listed("Main.lf", "");
        for path in
            ["", "/etc/passwd", "../x", "a/../../x", "a/..", ".", "./x", "a\0b", "a/", "Main.lf"]
        {
            let wrong = mistake("Main.lf", &[main.clone(), listed(path, "")]);
            assert!(wrong.is_some(), "{path}");
        }
        let deep = "a/".repeat(DEPTH_LIMIT) + "a";
        assert!(mistake("Main.lf", &[main.clone(), listed(&deep, "")]).is_some());
        assert!(mistake("Other.lf", std::slice::from_ref(&main)).is_some());
        let huge = Listed { len: BYTES, ..listed("a", "") };
        let more = Listed { len: u64::MAX, path: "b".to_owned(), ..huge.clone() };
        assert!(mistake("Main.lf", &[main.clone(), huge, more]).is_some());
        assert_eq!(mistake("Main.lf", &[main, listed("lib/ä b.py", "")]), None);
    }
}
