//! `hprm new`: a project that runs and has a test, made of the files under `templates`.
//!
//! The project is written beside its place and moved there when it is whole. What it may be called is in
//! `name.rs`.

mod name;

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use crate::args::{Language, New};
use crate::message::{self, Error};
use name::Name;

/// A file of a project: where it is and what it says, both with the name of the template.
type File = (&'static str, &'static str);

const LF: [File; 5] = [
    (".gitignore", include_str!("../templates/gitignore")),
    ("README.md", include_str!("../templates/lf/README.md")),
    ("pyproject.toml", include_str!("../templates/lf/pyproject.toml")),
    ("src/NewProject.lf", include_str!("../templates/lf/src/NewProject.lf")),
    ("tests/test_new_project.py", include_str!("../templates/lf/tests/test_new_project.py")),
];

const PYTHON: [File; 6] = [
    (".gitignore", include_str!("../templates/gitignore")),
    ("README.md", include_str!("../templates/python/README.md")),
    ("pyproject.toml", include_str!("../templates/python/pyproject.toml")),
    (
        "src/new_project/__init__.py",
        include_str!("../templates/python/src/new_project/__init__.py"),
    ),
    ("src/new_project/app.py", include_str!("../templates/python/src/new_project/app.py")),
    ("tests/test_app.py", include_str!("../templates/python/tests/test_app.py")),
];

const RUST: [File; 5] = [
    (".gitignore", include_str!("../templates/gitignore")),
    ("README.md", include_str!("../templates/rust/README.md")),
    ("Cargo.toml", include_str!("../templates/rust/Cargo.toml.in")),
    ("src/lib.rs", include_str!("../templates/rust/src/lib.rs")),
    ("src/main.rs", include_str!("../templates/rust/src/main.rs")),
];

/// Where the template of a program in Rust names the crate.
const CRATE: &str = "PATH_OF_THE_LIBRARY";

/// The clone of the repository from which this command was built.
const BUILT_FROM: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");

/// Makes the project, and says how to run it.
///
/// # Errors
///
/// If it cannot be made; nothing is left of it then.
pub(crate) fn new(wanted: &New) -> Result<ExitCode, Error> {
    let folder = &wanted.folder;
    let name = Name::of(folder, wanted.lang)?;
    let library = match wanted.lang {
        Language::Rust => Some(library(wanted.checkout.as_deref())?),
        _ if wanted.checkout.is_some() => {
            return Err(Error::option("--checkout is only for programs in Rust")
                .hint("add --lang rust, or leave --checkout out"));
        }
        _ => None,
    };
    if folder.symlink_metadata().is_ok() {
        return Err(Error::new(format!("{} exists already", folder.display()))
            .hint("choose another name, or remove it first"));
    }
    let files: &[File] = match wanted.lang {
        Language::Lf => &LF,
        Language::Python => &PYTHON,
        Language::Rust => &RUST,
    };
    let files = files.iter().map(|(path, text)| {
        let text = name.instead_of_template(text);
        let text = library.as_ref().map_or(text.clone(), |library| text.replace(CRATE, library));
        (name.instead_of_template(path), text)
    });
    make(folder, files).map_err(|error| {
        Error::new(format!("cannot make {}: {}", folder.display(), message::reason(&error)))
    })?;
    message::print_line(&next_steps(folder, &name, wanted.lang));
    Ok(ExitCode::SUCCESS)
}

/// Where the crate `hprm` is, as it stands in a text of TOML.
fn library(checkout: Option<&Path>) -> Result<String, Error> {
    let found = checkout.unwrap_or(Path::new(BUILT_FROM)).join("crates/hprm");
    match found.canonicalize() {
        Ok(library) if library.join("Cargo.toml").is_file() => {
            Ok(library.display().to_string().replace('\\', r"\\").replace('"', "\\\""))
        }
        _ => {
            let message = match checkout {
                Some(stated) => format!("{} is no clone of HPRM's repository", stated.display()),
                None => "the crate hprm is not where this command was built".to_owned(),
            };
            Err(Error::option(message)
                .hint("name a clone of the repository, which has crates/hprm: --checkout FOLDER"))
        }
    }
}

/// Writes all files, or none.
fn make(folder: &Path, files: impl Iterator<Item = (String, String)>) -> io::Result<()> {
    let parent = folder.parent().filter(|it| *it != Path::new("")).unwrap_or(Path::new("."));
    let missing = |it: &&Path| *it != Path::new("") && it.symlink_metadata().is_err();
    let missing: Vec<_> = parent.ancestors().take_while(missing).collect();
    let unfinished = parent.join(format!(".hprm-new-{}", std::process::id()));
    let made = fs::create_dir_all(parent)
        .and_then(|()| fs::create_dir(&unfinished))
        .and_then(|()| write(&unfinished, files))
        .and_then(|()| fs::rename(&unfinished, folder));
    if made.is_err() {
        // The error that is told is the first one; a folder that another process has put something into stays.
        let _ = fs::remove_dir_all(&unfinished);
        missing.iter().all(|it| fs::remove_dir(it).is_ok() || it.symlink_metadata().is_err());
    }
    made
}

fn write(folder: &Path, files: impl Iterator<Item = (String, String)>) -> io::Result<()> {
    for (path, text) in files {
        let path: PathBuf = folder.join(path);
        fs::create_dir_all(path.parent().expect("it is in the folder"))?;
        fs::write(path, text)?;
    }
    Ok(())
}

fn next_steps(folder: &Path, name: &Name, language: Language) -> String {
    let (what, run, test) = match language {
        Language::Lf => (
            "a program in Lingua Franca",
            format!("hprm run src/{}.lf", name.pascal()),
            "python -m pytest",
        ),
        Language::Python => (
            "a program in Python",
            format!("hprm run src/{}/app.py", name.snake()),
            "python -m pytest",
        ),
        Language::Rust => ("a program in Rust", "cargo run".to_owned(), "cargo test"),
    };
    let folder = folder.display();
    format!("made {folder}: {what}, and its tests\n  cd {folder}\n  {run}\n  {test}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cannot_be_made_leaves_nothing_not_even_the_folders_above_it() {
        let within = tempfile::tempdir().unwrap();
        let of = |path: &str| (path.to_owned(), String::new());
        let folder = within.path().join("old/new/newer/project");
        fs::create_dir(within.path().join("old")).unwrap();
        // A file cannot be in a file.
        make(&folder, [of("src"), of("src/main.rs")].into_iter()).unwrap_err();
        assert_eq!(within.path().join("old").read_dir().unwrap().count(), 0);
        // A folder cannot either.
        fs::write(within.path().join("old/file"), "").unwrap();
        make(&within.path().join("old/file/new/project"), [of("src")].into_iter()).unwrap_err();
        assert_eq!(within.path().join("old").read_dir().unwrap().count(), 1);
        make(&folder, [of("src/main.rs")].into_iter()).unwrap();
        assert!(folder.join("src/main.rs").is_file());
        assert_eq!(folder.parent().unwrap().read_dir().unwrap().count(), 1);
    }
}
