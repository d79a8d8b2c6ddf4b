//! Where the text of files comes from, and how paths are joined.
//!
//! Nothing here opens a file. The caller of the compiler supplies a [`SourceLoader`]; paths are
//! joined by text alone.

use hprm_declared::Described;
use hprm_model::Executable;

/// Where the text of a file comes from.
///
/// A closure from path to text is one, without packages but those of the project.
pub trait SourceLoader {
    /// The text of the file at `path`, or why there is none.
    ///
    /// # Errors
    ///
    /// A sentence for the user: `No such file or directory`.
    fn load(&mut self, path: &str) -> Result<String, String>;

    /// The names of what is in a folder, those of folders with a `/` at the end. Nothing if there
    /// is no such folder.
    fn list(&mut self, _folder: &str) -> Vec<String> {
        Vec::new()
    }

    /// Whether there is a file or a folder at `path`. Yes if that cannot be told.
    fn exists(&mut self, _path: &str) -> bool {
        true
    }

    /// Folders with packages that any program can import, such as those that the environment
    /// variable `LF_PACKAGES` names.
    fn packages(&mut self) -> Vec<String> {
        Vec::new()
    }

    /// What an executable declares that a program names.
    ///
    /// # Errors
    ///
    /// Why that is not known, as a sentence for the user; a second line may say what to do.
    fn describe(&mut self, executable: &Executable) -> Result<Described, String> {
        Err(format!(
            "the executable {} cannot be asked here what it declares",
            executable.command[0]
        ))
    }

    /// The absolute path from which relative ones lead on, if there is one.
    fn working_folder(&mut self) -> Option<String> {
        None
    }
}

impl<F: FnMut(&str) -> Result<String, String>> SourceLoader for F {
    fn load(&mut self, path: &str) -> Result<String, String> {
        self(path)
    }
}

/// The longest file that is read, in bytes.
pub(crate) const MAX_FILE: usize = 16 << 20;

/// The path of a file that `importer` names as `relative`: `a/b.lf` and `../c.lf` give `c.lf`.
pub(crate) fn sibling(importer: &str, relative: &str) -> String {
    let rooted = relative.starts_with('/');
    let absolute = rooted || importer.starts_with('/');
    let folder = if rooted { "" } else { importer };
    let mut parts: Vec<&str> = folder.split('/').filter(|part| !part.is_empty()).collect();
    parts.pop();
    for part in relative.split(['/', '\\']) {
        match part {
            "" | "." => {}
            ".." if parts.last().is_some_and(|last| *last != "..") => {
                parts.pop();
            }
            ".." if absolute => {}
            part => parts.push(part),
        }
    }
    let joined = parts.join("/");
    if absolute { format!("/{joined}") } else { joined }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_joined_by_text() {
        assert_eq!(sibling("src/Main.lf", "lib/Gain.lf"), "src/lib/Gain.lf");
        assert_eq!(sibling("src/a/Main.lf", "../Gain.lf"), "src/Gain.lf");
        assert_eq!(sibling("Main.lf", "../Gain.lf"), "../Gain.lf");
        assert_eq!(sibling("/x/Main.lf", "./Gain.lf"), "/x/Gain.lf");
        assert_eq!(sibling("/Main.lf", "../../Gain.lf"), "/Gain.lf");
        assert_eq!(sibling("src/Main.lf", "/abs/x/../Gain.lf"), "/abs/Gain.lf");
        assert_eq!(sibling("", "../Main.lf"), "../Main.lf");
    }
}
