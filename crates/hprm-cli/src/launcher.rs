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

/// Writes the commands for the transient federates of a program, unless they are there.
///
/// # Errors
///
/// If they cannot be written.
pub(crate) fn write(program: &Program, file: &Path) -> Result<(), Error> {
    let file = std::path::absolute(file).unwrap_or_else(|_| file.to_owned());
    let folder = package(&file).join("fed-gen").join(&program.name).join("bin");
    let command = std::env::current_exe().unwrap_or_else(|_| PathBuf::from("hprm"));
    let unwritten = |path: &Path, error: io::Error| {
        Error::new(format!("cannot write {}: {error}", path.display()))
            .hint("a program with transient federates needs a folder for what starts them")
    };
    fs::create_dir_all(&folder).map_err(|error| unwritten(&folder, error))?;
    for federate in program.federates.values().filter(|federate| federate.transient) {
        let path = folder.join(format!("federate__{}", federate.name));
        let text = format!(
            "#!/bin/sh\nexec {} federate {} {} \"$@\"\n",
            quoted(&command),
            quoted(&file),
            federate.name
        );
        install(&path, &text).map_err(|error| unwritten(&path, error))?;
    }
    Ok(())
}

/// Writes an executable file at once, so that nobody runs half of it.
fn install(path: &Path, text: &str) -> io::Result<()> {
    if fs::read_to_string(path).is_ok_and(|there| there == text) {
        return Ok(());
    }
    let draft = path.with_extension(format!("{}.tmp", std::process::id()));
    fs::write(&draft, text)?;
    fs::set_permissions(&draft, fs::Permissions::from_mode(0o755))?;
    fs::rename(&draft, path)
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

    #[test]
    fn a_path_stays_one_word() {
        assert_eq!(quoted(Path::new("/it's here")), r"'/it'\''s here'");
    }
}
