//! Files for the front end, which opens no file itself: their text, what lies in a folder, where packages are, and
//! what executables declare.

use std::collections::BTreeMap;
use std::io;
use std::path::Path;

use hprm_declared::Described;
use hprm_lf::SourceLoader;
use hprm_model::Executable;

use crate::console::reason;
use crate::describing;

/// The files of this machine, with the packages that the environment names.
#[derive(Clone, Debug, Default)]
pub struct Disk {
    packages: Vec<String>,
    /// Files that were read in advance.
    ahead: BTreeMap<String, String>,
}

/// Why a file cannot be read.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Unreadable {
    /// The reason, as a sentence for people.
    pub reason: String,
    /// The line that is no text, if that is the reason.
    pub line: Option<u32>,
}

impl Disk {
    /// Takes the folders with packages from the environment variable `LF_PACKAGES`.
    #[must_use]
    pub fn from_environment() -> Self {
        let folders = std::env::var_os("LF_PACKAGES").unwrap_or_default();
        let folders = std::env::split_paths(&folders).filter_map(|path| text_of(&path));
        Self { packages: folders.filter(|folder| !folder.is_empty()).collect(), ..Self::default() }
    }

    /// Reads a file now, for when it is asked for.
    ///
    /// # Errors
    ///
    /// Why it cannot be read.
    pub fn read_ahead(&mut self, path: &str) -> Result<(), Unreadable> {
        self.ahead.insert(path.to_owned(), read(path)?);
        Ok(())
    }
}

impl SourceLoader for Disk {
    fn load(&mut self, path: &str) -> Result<String, String> {
        self.ahead.remove(path).map_or_else(|| read(path).map_err(|found| found.reason), Ok)
    }

    fn list(&mut self, folder: &str) -> Vec<String> {
        let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
        let name = |entry: io::Result<std::fs::DirEntry>| {
            let entry = entry.ok()?;
            let name = entry.file_name().into_string().ok()?;
            // A link to a folder is not followed: it might lead in a cycle.
            let is_folder = entry.file_type().ok()?.is_dir();
            Some(if is_folder { format!("{name}/") } else { name })
        };
        entries.filter_map(name).collect()
    }

    fn exists(&mut self, path: &str) -> bool {
        Path::new(path).exists()
    }

    fn describe(&mut self, executable: &Executable) -> Result<Described, String> {
        describing::describe(executable)
    }

    fn packages(&mut self) -> Vec<String> {
        self.packages.clone()
    }

    fn working_folder(&mut self) -> Option<String> {
        text_of(&std::env::current_dir().ok()?)
    }
}

fn text_of(path: &Path) -> Option<String> {
    path.to_str().map(str::to_owned)
}

fn read(path: &str) -> Result<String, Unreadable> {
    let bytes =
        std::fs::read(path).map_err(|error| Unreadable { reason: reason(&error), line: None })?;
    String::from_utf8(bytes).map_err(|error| {
        let before = &error.as_bytes()[..error.utf8_error().valid_up_to()];
        let line = before.iter().filter(|byte| **byte == b'\n').count() + 1;
        let reason = format!("line {line} is not UTF-8 text");
        Unreadable { reason, line: u32::try_from(line).ok() }
    })
}
