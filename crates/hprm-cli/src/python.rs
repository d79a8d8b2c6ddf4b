//! Finding the interpreter that runs the bodies.
//!
//! What the user states comes first, then an active virtual environment that HPRM is installed in, then
//! the interpreter beside the command: it is the one that `hprm` was installed into.

use std::env;
use std::ffi::{OsStr, OsString};
use std::io::Read;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::args::Interpreter;
use crate::message::Error;

const PYTHON: &str = "python3";

/// The environment variable of an interpreter that loads a program which another one has declared, with what Python
/// warns of.
pub(crate) const WARNED: &str = "HPRM_WARNED";

/// More bytes than an interpreter answers that is asked what it is, and the script that starts it.
const LONGEST_ANSWER: u64 = 4096;

/// Has an interpreter say whether `python -m hprm` would find HPRM. A folder that is only called so has no origin.
const QUESTION: &str = "\
import importlib.util
found = importlib.util.find_spec('hprm')
print('an interpreter', 'with' if found and found.origin else 'without', 'hprm')
";

/// What the search depends on.
#[derive(Clone, Debug, Default)]
struct Surroundings {
    /// The command as it was called.
    called: Option<OsString>,
    /// The command as the system knows it, with links resolved.
    executable: Option<PathBuf>,
    virtual_env: Option<OsString>,
    path: Option<OsString>,
}

/// What an interpreter answers to the [`QUESTION`].
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Answer {
    WithHprm,
    WithoutHprm,
}

/// The interpreter that is stated, or else found: in the active virtual environment, beside `hprm`, or
/// on `PATH`.
///
/// # Errors
///
/// If there is none, or the stated one cannot be executed or has no HPRM.
pub(crate) fn find(interpreter: &Interpreter) -> Result<PathBuf, Error> {
    match &interpreter.python {
        Some(stated) => with_hprm(stated.clone()),
        None => {
            let here = Surroundings::of_this_process();
            match near(&here) {
                Some(near) => Ok(near),
                // The command was not installed into this one.
                None => with_hprm(found(search(&here))?),
            }
        }
    }
}

fn with_hprm(python: PathBuf) -> Result<PathBuf, Error> {
    match ask(&python)? {
        Answer::WithHprm => Ok(python),
        Answer::WithoutHprm => Err(without_hprm(&python)),
    }
}

/// The same, with or without HPRM.
///
/// # Errors
///
/// If there is none, or the stated one cannot be executed.
pub(crate) fn find_any(interpreter: &Interpreter) -> Result<PathBuf, Error> {
    match &interpreter.python {
        Some(stated) => ask(stated).map(|_| stated.clone()),
        None => found(search(&Surroundings::of_this_process())),
    }
}

fn without_hprm(stated: &Path) -> Error {
    let stated = stated.display();
    Error::option(format!("HPRM is not installed for the interpreter {stated}")).hint(format!(
        "install it there: `{stated} -m pip install` with its wheel, or with . in a checkout; or choose another interpreter with --python"
    ))
}

impl Surroundings {
    fn of_this_process() -> Self {
        Self {
            called: env::args_os().next(),
            executable: env::current_exe().ok(),
            virtual_env: env::var_os("VIRTUAL_ENV"),
            path: env::var_os("PATH"),
        }
    }
}

fn found(python: Option<PathBuf>) -> Result<PathBuf, Error> {
    python.ok_or_else(|| {
        Error::new("there is no python3 to run reactions with")
            .hint("install Python 3.10 or later, then HPRM into it: `pip install` with its wheel, or with . in a checkout")
    })
}

/// Asks a program whether it has HPRM. One that is near the command is not asked.
///
/// # Errors
///
/// If it does not understand Python.
fn ask(program: &Path) -> Result<Answer, Error> {
    let answer = if is_executable(program) { answer(program) } else { None };
    match answer {
        Some(answer) if answer.ends_with(b"an interpreter with hprm\n") => Ok(Answer::WithHprm),
        Some(answer) if answer.ends_with(b"an interpreter without hprm\n") => {
            Ok(Answer::WithoutHprm)
        }
        _ => Err(Error::option(format!("{} is no Python interpreter", program.display()))
            .hint("name an executable file, such as .venv/bin/python3")),
    }
}

/// What a program answers to the [`QUESTION`].
fn answer(program: &Path) -> Option<Vec<u8>> {
    let mut command = Command::new(program);
    // With the paths that it has for `-m hprm`.
    command.args(["-c", QUESTION]);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::null());
    let mut process = command.spawn().ok()?;
    let mut answer = Vec::new();
    let pipe = process.stdout.take().expect("it is piped");
    // What is something else may write without end.
    let read = pipe.take(LONGEST_ANSWER).read_to_end(&mut answer);
    // It may have ended by itself.
    let _ = process.kill();
    let ended = process.wait();
    (read.is_ok() && ended.is_ok()).then_some(answer)
}

/// The interpreter with one of the commands of the module `hprm`.
///
/// Options come first, then `--`, and then what may look like options and is not.
pub(crate) fn module(python: &Path, command: &str) -> Command {
    let mut process = Command::new(python);
    process.args(["-m", "hprm", command]);
    process
}

fn search(surroundings: &Surroundings) -> Option<PathBuf> {
    near(surroundings).or_else(|| on_path(surroundings.path.as_deref()?, OsStr::new(PYTHON)))
}

/// The interpreter of the active virtual environment, or the one beside the command.
fn near(surroundings: &Surroundings) -> Option<PathBuf> {
    let beside = [called(surroundings), surroundings.executable.clone()];
    let beside = beside.into_iter().flatten().map(|command| command.with_file_name(PYTHON));
    let active = surroundings
        .virtual_env
        .as_deref()
        .filter(|folder| !folder.is_empty())
        .map(|folder| Path::new(folder).join("bin").join(PYTHON));
    let installed = active.clone().filter(|python| has_hprm(python));
    installed.into_iter().chain(beside).chain(active).find(|candidate| is_executable(candidate))
}

/// Whether HPRM is installed in the virtual environment of an interpreter.
fn has_hprm(python: &Path) -> bool {
    let Some(environment) = python.parent().and_then(Path::parent) else { return false };
    let Ok(libraries) = environment.join("lib").read_dir() else { return false };
    let packages = libraries.flatten().map(|library| library.path().join("site-packages"));
    packages.filter_map(|folder| folder.read_dir().ok()).flat_map(Iterator::flatten).any(|entry| {
        entry.file_name().to_str().is_some_and(|name| {
            name == "hprm" || name.starts_with("hprm-") && name.ends_with(".dist-info")
        })
    })
}

/// Where the command was called, without resolving links: a link in a virtual environment stands
/// beside that environment's interpreter, its target does not.
fn called(surroundings: &Surroundings) -> Option<PathBuf> {
    let called = surroundings.called.as_deref()?;
    if Path::new(called).components().count() > 1 {
        return Some(PathBuf::from(called));
    }
    on_path(surroundings.path.as_deref()?, called)
}

fn on_path(path: &OsStr, name: &OsStr) -> Option<PathBuf> {
    env::split_paths(path)
        .filter(|folder| folder.is_absolute())
        .map(|folder| folder.join(name))
        .find(|candidate| is_executable(candidate))
}

fn is_executable(path: &Path) -> bool {
    path.metadata().is_ok_and(|file| file.is_file() && file.permissions().mode() & 0o111 != 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A folder with executables.
    fn folder(names: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for name in names {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(&path, "").unwrap();
            std::fs::set_permissions(&path, PermissionsExt::from_mode(0o755)).unwrap();
        }
        folder
    }

    fn surroundings(called: &Path, virtual_env: &Path, path: &Path) -> Surroundings {
        Surroundings {
            called: Some(called.into()),
            executable: None,
            virtual_env: Some(virtual_env.into()),
            path: Some(path.into()),
        }
    }

    #[test]
    fn the_nearest_wins() {
        let beside = folder(&["hprm", "python3"]);
        let active = folder(&["bin/python3"]);
        let path = folder(&["python3"]);
        let all = surroundings(&beside.path().join("hprm"), active.path(), path.path());
        assert_eq!(search(&all), Some(beside.path().join("python3")));
        std::fs::remove_file(beside.path().join("python3")).unwrap();
        assert_eq!(search(&all), Some(active.path().join("bin/python3")));
        std::fs::remove_dir_all(active.path().join("bin")).unwrap();
        assert_eq!(search(&all), Some(path.path().join("python3")));
        std::fs::remove_file(path.path().join("python3")).unwrap();
        assert_eq!(search(&all), None);
    }

    #[test]
    fn an_active_environment_with_hprm_comes_before_what_is_beside_the_command() {
        let beside = folder(&["hprm", "python3"]);
        let active =
            folder(&["bin/python3", "lib/python3.11/site-packages/hprm-0.1.0.dist-info/x"]);
        let all = surroundings(&beside.path().join("hprm"), active.path(), Path::new("/nowhere"));
        assert_eq!(search(&all), Some(active.path().join("bin/python3")));
    }

    #[test]
    fn what_is_stated_is_taken_or_refused() {
        let there = folder(&["python3"]);
        let stated = |path: PathBuf| find(&Interpreter { python: Some(path) });
        let python = there.path().join("python3");
        // It can be executed, and says nothing.
        assert!(stated(python.clone()).is_err());
        assert!(stated(PathBuf::from("/bin/ls")).is_err());
        std::fs::write(&python, "#!/bin/sh\necho an interpreter with hprm\n").unwrap();
        assert_eq!(stated(python.clone()).unwrap(), python);
        std::fs::write(&python, "#!/bin/sh\necho an interpreter without hprm\n").unwrap();
        let error = format!("{:?}", stated(python.clone()).unwrap_err());
        assert!(error.contains("HPRM is not installed for the interpreter"), "{error}");
        let error = stated(there.path().join("python4")).unwrap_err();
        assert!(format!("{error:?}").contains("python4 is no Python interpreter"), "{error:?}");
    }

    #[test]
    fn a_command_from_the_path_is_found_there() {
        let path = folder(&["hprm", "python3"]);
        let nowhere = Path::new("/nowhere");
        let typed = surroundings(Path::new("hprm"), nowhere, path.path());
        assert_eq!(search(&typed), Some(path.path().join("python3")));
    }

    #[test]
    fn links_are_not_resolved() {
        let real = folder(&["hprm", "python3"]);
        let environment = folder(&["python3"]);
        let link = environment.path().join("hprm");
        std::os::unix::fs::symlink(real.path().join("hprm"), &link).unwrap();
        let nowhere = Path::new("/nowhere");
        let called = surroundings(&link, nowhere, nowhere);
        assert_eq!(search(&called), Some(environment.path().join("python3")));
    }

    #[test]
    fn what_cannot_be_executed_is_passed_over() {
        let beside = folder(&["hprm", "python3"]);
        let python = beside.path().join("python3");
        std::fs::set_permissions(python, PermissionsExt::from_mode(0o644)).unwrap();
        let nowhere = Path::new("/nowhere");
        assert_eq!(search(&surroundings(&beside.path().join("hprm"), nowhere, nowhere)), None);
    }
}
