//! The commands that start a transient federate again, where Lingua Franca puts them.
//!
//! Programs that bring back a federate run `fed-gen/NAME/bin/federate__FEDERATE` in their package
//! directory, with the option `-i` and the id of the federation. Here that is a shell script of one
//! line; where the federation is, it inherits from the federate that runs it.

use std::fs;
use std::io;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use hprm_core::Program;

use crate::message::Error;
use crate::{draft, registry};

/// The commands of a program whose federation runs. They go away with it.
#[derive(Debug)]
pub(crate) struct Commands {
    program: PathBuf,
    /// Files that were not there before.
    files: Vec<PathBuf>,
    /// Folders that were not there before, the innermost first.
    folders: Vec<PathBuf>,
}

impl Commands {
    /// Whether there is nothing to remove.
    pub(crate) fn is_empty(&self) -> bool {
        self.files.is_empty()
    }
}

impl Drop for Commands {
    fn drop(&mut self) {
        // Another federation of the program needs them, and removes them.
        if registry::of_program(&self.program).iter().any(|record| record.made) {
            return;
        }
        for file in &self.files {
            let _ = fs::remove_file(file);
        }
        for folder in &self.folders {
            // What else is in it is the user's.
            let _ = fs::remove_dir(folder);
        }
    }
}

/// Writes the commands for the transient federates of a program, unless they are there. Those that are
/// there belong to the federation if `inherits`: another one of the same program has made them, and
/// runs, or was killed.
///
/// # Errors
///
/// If they cannot be written.
pub(crate) fn write(program: &Program, file: &Path, inherits: bool) -> Result<Commands, Error> {
    let file = std::path::absolute(file).unwrap_or_else(|_| file.to_owned());
    let folder = package(&file).join("fed-gen").join(&program.name).join("bin");
    let mut commands = Commands { program: file.clone(), files: Vec::new(), folders: Vec::new() };
    let command = std::env::current_exe().unwrap_or_else(|_| PathBuf::from("hprm"));
    let unwritten = |path: &Path, error: io::Error| {
        Error::new(format!("cannot write {}: {error}", path.display()))
            .hint("a program with transient federates needs a folder for what starts them")
    };
    let folders = folder.ancestors().take(3);
    let missing = folders.filter(|folder| inherits || !folder.exists()).map(Path::to_owned);
    commands.folders = missing.collect();
    fs::create_dir_all(&folder).map_err(|error| unwritten(&folder, error))?;
    for federate in program.federates.values().filter(|federate| federate.transient) {
        let path = folder.join(format!("federate__{}", federate.name));
        if inherits || !path.exists() {
            commands.files.push(path.clone());
        }
        let text = format!(
            "#!/bin/sh\nexec {} federate {} {} \"$@\"\n",
            quoted(&command),
            quoted(&file),
            federate.name
        );
        install(&path, &text).map_err(|error| unwritten(&path, error))?;
    }
    Ok(commands)
}

/// Writes an executable file at once, so that a half of it is never run.
fn install(path: &Path, text: &str) -> io::Result<()> {
    if fs::read_to_string(path).is_ok_and(|there| there == text) {
        return Ok(());
    }
    draft::replace(path, |draft| {
        fs::write(draft, text)?;
        fs::set_permissions(draft, fs::Permissions::from_mode(0o755))
    })
}

/// What contains the nearest folder named `src`, or else the program's own folder: the same as
/// `lf.package_directory()`.
fn package(file: &Path) -> PathBuf {
    let folder = file.parent().unwrap_or(Path::new("/"));
    let source = folder.ancestors().find(|folder| folder.ends_with("src"));
    source.and_then(Path::parent).unwrap_or(folder).to_owned()
}

/// A path as a word of the shell.
fn quoted(path: &Path) -> String {
    format!("'{}'", path.display().to_string().replace('\'', r"'\''"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_package_contains_the_nearest_folder_of_sources() {
        assert_eq!(package(Path::new("/a/src/b/src/c/D.lf")), Path::new("/a/src/b"));
        assert_eq!(package(Path::new("/a/b/D.lf")), Path::new("/a/b"));
    }

    fn program() -> Program {
        let mut b = hprm_core::ProgramBuilder::new("Main", hprm_core::Properties::default());
        let reactor = b.reactor(b.main(), "mid");
        let federate = b.federate(reactor, "mid", 0, None);
        b.make_transient(federate);
        b.build().unwrap()
    }

    #[test]
    fn commands_go_away_and_leave_what_was_there() {
        let place = tempfile::tempdir().unwrap();
        let file = place.path().join("Main.lf");
        let folder = place.path().join("fed-gen");
        let script = folder.join("Main/bin/federate__mid");
        let commands = write(&program(), &file, false).unwrap();
        assert_eq!(script.metadata().unwrap().permissions().mode() & 0o777, 0o755);
        drop(commands);
        assert!(!folder.exists());
        fs::create_dir_all(folder.join("Other")).unwrap();
        drop(write(&program(), &file, false).unwrap());
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 1);
        // A federation that was killed has left them.
        std::mem::forget(write(&program(), &file, false).unwrap());
        drop(write(&program(), &file, false).unwrap());
        assert!(script.exists());
        drop(write(&program(), &file, true).unwrap());
        assert!(!folder.join("Main").exists() && folder.join("Other").exists());
    }

    #[test]
    fn a_path_stays_one_word() {
        assert_eq!(quoted(Path::new("/it's here")), r"'/it'\''s here'");
    }
}
