//! Packages: where `import R from <package/path>` may find its file.
//!
//! A package is a folder with its reactors in `src/lib`. It is looked for in `build/lfc_include`
//! and `lf-packages` of the project, and then in the folders that the loader names. The project of
//! a file is the folder that holds the nearest `src` above it.

use crate::source::{SourceLoader, sibling};

/// Folders of a project that hold packages: what its package manager has fetched, then its own.
const SHELVES: [&str; 2] = ["build/lfc_include", "lf-packages"];

const EXTENSIONS: [&str; 2] = [".lf", ".ulf"];

/// The most folders that are looked through for a file.
const MAX_FOLDERS: usize = 200;

/// The text between `<` and `>`.
pub(crate) struct Wanted<'a> {
    package: &'a str,
    path: &'a str,
}

impl<'a> Wanted<'a> {
    pub(crate) fn new(text: &'a str) -> Self {
        let (package, path) = text.split_once(['/', '\\']).unwrap_or((text, ""));
        Self { package, path: path.trim_end_matches(['/', '\\']) }
    }

    /// Whether it names a file, and not only a package or a folder of one.
    pub(crate) fn names_a_file(&self) -> bool {
        EXTENSIONS.iter().any(|extension| self.path.ends_with(extension))
    }

    /// The paths at which the file may be, in the order in which they are tried, if `reactor` is
    /// what is imported.
    pub(crate) fn candidates(&self, folders: &[String], reactor: &str) -> Vec<String> {
        let mut candidates = Vec::new();
        for folder in folders {
            let library = self.library(folder);
            if self.names_a_file() {
                candidates.push(join(&library, self.path));
                continue;
            }
            let home = join(&library, self.path);
            let named = |extension| join(&home, &format!("{reactor}{extension}"));
            candidates.extend(EXTENSIONS.map(named));
        }
        candidates
    }

    /// The first file below the package's `src/lib` that is called like `reactor`, wherever it is.
    pub(crate) fn search(
        &self,
        folders: &[String],
        reactor: &str,
        loader: &mut dyn SourceLoader,
    ) -> Option<String> {
        let names = EXTENSIONS.map(|extension| format!("{reactor}{extension}"));
        folders
            .iter()
            .find_map(|folder| find_below(join(&self.library(folder), self.path), &names, loader))
    }

    /// Where the file is in a folder of packages, if it is where it should be.
    pub(crate) fn path_in_shelf(&self, reactor: &str) -> String {
        self.candidates(&[String::new()], reactor).swap_remove(0)
    }

    fn library(&self, folder: &str) -> String {
        join(folder, &format!("{}/src/lib", self.package))
    }
}

/// Looks through folders, those higher up first.
fn find_below(folder: String, names: &[String], loader: &mut dyn SourceLoader) -> Option<String> {
    let mut folders = vec![folder];
    let mut next = 0;
    while let Some(folder) = folders.get(next).cloned() {
        next += 1;
        let mut entries = loader.list(&folder);
        entries.sort_unstable();
        if let Some(name) = names.iter().find(|name| entries.contains(*name)) {
            return Some(join(&folder, name));
        }
        let inner = entries.iter().filter_map(|entry| entry.strip_suffix('/'));
        folders.extend(inner.map(|inner| join(&folder, inner)));
        folders.truncate(MAX_FOLDERS);
    }
    None
}

/// The folders that hold packages for a file at `importer` of the program whose main file is `main`.
pub(crate) fn folders(importer: &str, main: &str, loader: &mut dyn SourceLoader) -> Vec<String> {
    let working = loader.working_folder();
    let mut folders: Vec<String> = Vec::new();
    for file in [importer, main] {
        let root = root(file, working.as_deref());
        folders.extend(SHELVES.map(|shelf| join(&root, shelf)));
    }
    folders.extend(loader.packages());
    let mut seen = Vec::new();
    folders.retain(|folder| {
        let new = !seen.contains(folder);
        seen.push(folder.clone());
        new
    });
    folders
}

/// The project of a file: where its nearest `src` is, or else where the program was started.
fn root(file: &str, working: Option<&str>) -> String {
    let below = |path: &str| {
        let folders: Vec<&str> = path.split('/').collect();
        let source = folders.iter().rposition(|folder| *folder == "src")?;
        (source + 1 < folders.len()).then(|| {
            let root = folders[..source].join("/");
            if root.is_empty() && path.starts_with('/') { "/".to_owned() } else { root }
        })
    };
    let absolute = working.map(|working| sibling(&format!("{working}/."), file));
    below(file).or_else(|| below(absolute.as_deref()?)).unwrap_or_default()
}

fn join(folder: &str, path: &str) -> String {
    if folder.is_empty() { sibling("", path) } else { sibling(&format!("{folder}/."), path) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_project_holds_the_nearest_src() {
        assert_eq!(root("src/Main.lf", None), "");
        assert_eq!(root("a/src/b/src/c/Main.lf", None), "a/src/b");
        assert_eq!(root("/src/Main.lf", None), "/");
        assert_eq!(root("Main.lf", None), "");
        assert_eq!(root("src", None), "", "a file called so is no folder");
        assert_eq!(root("Main.lf", Some("/home/p/src")), "/home/p");
        assert_eq!(root("../Main.lf", Some("/home/p/src/deep")), "/home/p");
        assert_eq!(root("Main.lf", Some("/home/p")), "");
    }

    #[test]
    fn candidates_are_files_of_the_package() {
        let folders = ["lf-packages".to_owned()];
        let all = |text: &str| Wanted::new(text).candidates(&folders, "Count");
        assert_eq!(all("p-1/sub/Import.lf"), ["lf-packages/p-1/src/lib/sub/Import.lf"]);
        assert_eq!(all("p"), ["lf-packages/p/src/lib/Count.lf", "lf-packages/p/src/lib/Count.ulf"]);
        assert_eq!(all("p/sub")[0], "lf-packages/p/src/lib/sub/Count.lf");
    }
}
