//! The files that a program needs on another machine: its sources, the files that it names, its executables, and the modules
//! of Python that lie beside it. Others do not travel.

use std::collections::BTreeSet;
use std::env;
use std::fs::{self, File};
use std::io::{self, Read};
use std::os::unix::fs::PermissionsExt;
use std::path::{Component, Path, PathBuf};

use hprm_model::Compiled;
use sha2::{Digest as _, Sha256};

use super::protocol::{CHUNK, Digest, Listed};
use crate::declare;
use crate::message::{self, Error};

/// The most files of a program, and the most bytes of all of them.
pub(super) const FILES: usize = 5_000;
pub(super) const BYTES: u64 = 2 << 30;

/// Folders in which no module of a program lies, whatever they contain.
const NOT_SOURCES: [&str; 4] = ["__pycache__", "node_modules", "fed-gen", "src-gen"];

/// Files of a program, and where they lie here.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) struct Files {
    /// The program itself, as it is listed.
    pub(super) main: String,
    /// In the same order.
    pub(super) listed: Vec<Listed>,
    pub(super) paths: Vec<PathBuf>,
}

/// The files of the program at `path`.
///
/// # Errors
///
/// If one of them cannot be read, or there are too many.
pub(super) fn files(compiled: &Compiled, path: &Path) -> Result<Files, Error> {
    let main = absolute(declare::file_of(path))?;
    let home = main.parent().unwrap_or(Path::new("/")).to_owned();
    let mut paths = BTreeSet::from([main.clone()]);
    let sources = &compiled.sources;
    for source in sources.paths().filter(|source| Path::new(source).is_file()) {
        paths.insert(absolute(Path::new(source))?);
    }
    for (name, stated_in) in compiled.files.iter().chain(&compiled.protobufs) {
        paths.extend(named(name, sources.path(*stated_in))?);
    }
    for executable in compiled.executables.values() {
        paths.extend(built(executable.command.first())?);
    }
    modules(&home, &mut paths)?;
    let mut root = home;
    while !paths.iter().all(|path| path.starts_with(&root)) {
        root.pop();
    }
    let mut all = Files { main: String::new(), listed: Vec::new(), paths: Vec::new() };
    let mut bytes = 0;
    for path in paths {
        let listed = list(&path, &root)?;
        bytes += listed.len;
        if bytes > BYTES {
            return Err(too_many(&path));
        }
        if path == main {
            all.main.clone_from(&listed.path);
        }
        all.listed.push(listed);
        all.paths.push(path);
    }
    Ok(all)
}

/// A file that a program names: beside the file that names it. One that is missing is left out, as it is here.
fn named(name: &str, stated_in: &str) -> Result<Option<PathBuf>, Error> {
    let beside = absolute(Path::new(stated_in))?;
    let path = beside.parent().unwrap_or(Path::new("/")).join(name);
    Ok(Some(flat(&path)).filter(|path| path.is_file()))
}

/// An executable that belongs to the program: one on `PATH` is installed, there as here.
fn built(path: Option<&String>) -> Result<Option<PathBuf>, Error> {
    let Some(path) = path else { return Ok(None) };
    let path = absolute(Path::new(path))?;
    let folders = env::var_os("PATH").unwrap_or_default();
    let is_installed = env::split_paths(&folders).any(|folder| path.parent() == Some(&folder));
    Ok(Some(path).filter(|path| !is_installed && path.is_file()))
}

/// Adds the modules of Python below a folder.
fn modules(folder: &Path, paths: &mut BTreeSet<PathBuf>) -> Result<(), Error> {
    let Ok(entries) = folder.read_dir() else { return Ok(()) };
    for entry in entries.flatten() {
        let (path, name) = (entry.path(), entry.file_name());
        let name = name.to_string_lossy();
        let Ok(kind) = entry.file_type() else { continue };
        let is_source = !name.starts_with('.') && !NOT_SOURCES.contains(&&*name);
        if kind.is_dir() && is_source && !path.join("pyvenv.cfg").exists() {
            modules(&path, paths)?;
        } else if name.ends_with(".py") && path.is_file() {
            paths.insert(path);
        }
        if paths.len() > FILES {
            return Err(too_many(folder));
        }
    }
    Ok(())
}

fn list(path: &Path, root: &Path) -> Result<Listed, Error> {
    let failed = |error: io::Error| {
        Error::new(format!("cannot read {}: {}", path.display(), message::reason(&error)))
    };
    let below = path.strip_prefix(root).ok().and_then(Path::to_str);
    let below = below
        .ok_or_else(|| Error::new(format!("the name of {} is not UTF-8 text", path.display())))?;
    let mode = fs::metadata(path).map_err(failed)?.permissions().mode();
    let (len, digest) = File::open(path).and_then(digest).map_err(failed)?;
    Ok(Listed { path: below.to_owned(), len, digest, is_executable: mode & 0o100 != 0 })
}

/// The length and the digest of what a reader has.
pub(super) fn digest(mut reader: impl Read) -> io::Result<(u64, Digest)> {
    let (mut sum, mut len, mut buffer) = (Sha256::new(), 0, vec![0; CHUNK]);
    loop {
        match reader.read(&mut buffer)? {
            0 => return Ok((len, sum.finalize().into())),
            count => {
                sum.update(&buffer[..count]);
                len += count as u64;
            }
        }
    }
}

fn absolute(path: &Path) -> Result<PathBuf, Error> {
    let absolute = std::path::absolute(path);
    absolute.map(|path| flat(&path)).map_err(|error| {
        Error::new(format!("{} cannot be found: {}", path.display(), message::reason(&error)))
    })
}

/// A path without `..`.
fn flat(path: &Path) -> PathBuf {
    let mut flat = PathBuf::new();
    for component in path.components() {
        match component {
            Component::ParentDir => drop(flat.pop()),
            Component::CurDir => {}
            component => flat.push(component),
        }
    }
    flat
}

fn too_many(at: &Path) -> Error {
    let gigabytes = BYTES >> 30;
    Error::new(format!(
        "a program has at most {FILES} files and {gigabytes} GiB on another machine, and this one has more, as in {}",
        at.display()
    ))
    .hint("its files are its sources, those that it names in `files`, its executables, and the modules of Python in its folder")
}
