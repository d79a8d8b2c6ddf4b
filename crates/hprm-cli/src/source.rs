//! Compiling programs: `.lf` files, which are read for the front end that itself never touches a disk, and
//! programs in Python, which declare themselves.

use std::ffi::OsString;
use std::path::Path;

use hprm::{Disk, Kind, Report, Unreadable};
use hprm_model::{CompileFailure, Compiled, Purpose};

use crate::args::Interpreter;
use crate::declare::{self, Undeclared};
use crate::executable;
use crate::message::{Error, reason};

/// A program, and what decides what it is.
#[derive(Clone, Debug)]
pub(crate) struct Program<'a> {
    /// The path, as it was typed.
    pub(crate) path: &'a Path,
    /// Target properties and parameters, as `KEY=VALUE`.
    pub(crate) properties: Vec<String>,
    /// What it finds in `sys.argv`.
    pub(crate) arguments: Vec<&'a OsString>,
    /// Of a program in Python, what runs it.
    pub(crate) interpreter: &'a Interpreter,
}

/// What a program is compiled to.
#[derive(Debug)]
pub(crate) enum Outcome {
    /// It can run.
    Right(Box<Compiled>),
    /// It has mistakes.
    Wrong(CompileFailure),
    /// Its Python has failed.
    Undeclared(Undeclared),
}

impl From<Result<Compiled, CompileFailure>> for Outcome {
    fn from(compiled: Result<Compiled, CompileFailure>) -> Self {
        match compiled {
            Ok(compiled) => Self::Right(Box::new(compiled)),
            Err(failure) => Self::Wrong(failure),
        }
    }
}

impl Program<'_> {
    /// Compiles it.
    ///
    /// # Errors
    ///
    /// If there is no such program: the path is wrong, the file is unreadable or not text. What
    /// is wrong *in* the program, or with a file that it imports, is in the outcome.
    pub(crate) fn compile(&self) -> Result<Outcome, Error> {
        if declare::is_python(self.path) {
            return self.declared(Purpose::Run);
        }
        if executable::is_program(self.path) {
            return self.of_executable(Purpose::Run);
        }
        let (name, mut disk) = read(self.path)?;
        Ok(hprm_lf::compile_with(name, &self.properties, &mut disk).into())
    }

    /// Looks through it; an `.lf` file may also be one that others import.
    ///
    /// # Errors
    ///
    /// As [`compile`](Self::compile).
    pub(crate) fn check(&self) -> Result<Outcome, Error> {
        if declare::is_python(self.path) {
            return self.declared(Purpose::Check);
        }
        if executable::is_program(self.path) {
            return self.of_executable(Purpose::Check);
        }
        let (name, mut disk) = read(self.path)?;
        Ok(hprm_lf::check(name, &mut disk).into())
    }

    /// Compiles it for a diagram, which there may be even if it has mistakes.
    ///
    /// # Errors
    ///
    /// As [`compile`](Self::compile).
    #[cfg(feature = "diagram")]
    pub(crate) fn draw(&self) -> Result<Outcome, Error> {
        if declare::is_python(self.path) {
            return self.declared(Purpose::Draw);
        }
        if executable::is_program(self.path) {
            return self.of_executable(Purpose::Draw);
        }
        let (name, mut disk) = read(self.path)?;
        Ok(hprm_lf::draw(name, &self.properties, &mut disk).into())
    }

    /// Compiles a program that is an executable of its own.
    fn of_executable(&self, purpose: Purpose) -> Result<Outcome, Error> {
        let Self { path, properties, arguments, .. } = self;
        let itself = executable::declared(path, arguments, purpose)?;
        let text = &itself.declaration;
        let mut disk = Disk::from_environment();
        match hprm_lf::compile_declared(text, properties, &mut disk, purpose) {
            Ok(Ok(mut compiled)) => {
                executable::of_itself(&mut compiled, &itself);
                Ok(Outcome::Right(Box::new(compiled)))
            }
            Ok(Err(failure)) => Ok(Outcome::Wrong(failure)),
            Err(malformed) => Err(Error::new(format!("{}: {malformed}", path.display())).hint(
                "the executable may be built with another version of HPRM than this command",
            )),
        }
    }

    fn declared(&self, purpose: Purpose) -> Result<Outcome, Error> {
        utf8(self.path)?;
        let Self { path, properties, arguments, interpreter } = self;
        let declared = declare::declare(path, properties, arguments.iter().copied(), interpreter)?;
        let text = match declared {
            Ok(text) => text,
            Err(undeclared) => return Ok(Outcome::Undeclared(undeclared)),
        };
        match hprm_lf::compile_declared(&text, properties, &mut Disk::from_environment(), purpose) {
            Ok(compiled) => Ok(compiled.into()),
            Err(malformed) => Err(Error::new(format!("{}: {malformed}", path.display())).hint(
                "the package hprm of the interpreter may have another version than this command: \
                 hprm doctor tells",
            )),
        }
    }
}

fn utf8(path: &Path) -> Result<&str, Error> {
    path.to_str().ok_or_else(|| {
        Error::new(format!("the name of {} is not UTF-8 text", path.display()))
            .hint("give the file another name")
    })
}

const WHERE: &str = "is the path right? It is relative to the current directory";
const WHAT: &str = "programs are files whose name ends in .lf or .py, and executables";

/// Reads a file before anything else, so that a wrong path is one plain error, not a diagnostic in a
/// file that does not exist.
fn read(path: &Path) -> Result<(&str, Disk), Error> {
    let name = utf8(path)?;
    if path.extension().is_none_or(|extension| extension != "lf") {
        if !name.contains(':')
            && let Err(error) = path.metadata()
        {
            let error = Error::new(format!("cannot read {name}: {}", reason(&error)));
            return Err(error.hint(format!("{WHERE}; {WHAT}")));
        }
        let error = Error::new(format!("{name} is not a program"));
        if let Some((file, _)) = name.rsplit_once(':').filter(|(file, _)| file.ends_with(".lf")) {
            return Err(error.hint(format!("an .lf file has one main reactor: write {file} alone")));
        }
        return Err(error.hint(WHAT));
    }
    let mut disk = Disk::from_environment();
    disk.read_ahead(name).map_err(|found| unreadable(name, found))?;
    Ok((name, disk))
}

fn unreadable(name: &str, Unreadable { reason, line }: Unreadable) -> Error {
    let report = Report::new(Kind::Command, format!("cannot read {name}: {reason}"));
    if line.is_some() {
        return Error::from(Report { file: Some(name.to_owned()), line, ..report });
    }
    let error = Error::from(report);
    match Path::new(name).try_exists() {
        Ok(false) => error.hint(WHERE),
        _ => error,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error(path: &Path) -> Error {
        let interpreter = Interpreter::default();
        let (properties, arguments) = (Vec::new(), Vec::new());
        let program = Program { path, properties, arguments, interpreter: &interpreter };
        match program.compile() {
            Err(error) => error,
            Ok(outcome) => panic!("{} is {outcome:?}", path.display()),
        }
    }

    #[test]
    fn a_missing_file_is_one_error() {
        for (path, file) in [
            ("/nowhere/Main.lf", "/nowhere/Main.lf"),
            ("/nowhere/app.py", "/nowhere/app.py"),
            ("/nowhere/app.py:Vision", "/nowhere/app.py"),
            ("/nowhere/app", "/nowhere/app"),
        ] {
            let error = format!("{:?}", error(Path::new(path)));
            assert!(error.contains(&format!("cannot read {file}: No such file or directory")));
            assert!(error.contains("is the path right? It is relative to the current directory"));
        }
    }

    #[test]
    fn another_kind_of_file_is_refused() {
        for name in ["Cargo.toml", "src", "Main.lf:Main"] {
            let error = error(Path::new(name));
            assert!(format!("{error:?}").contains("is not a program"), "{error:?}");
        }
    }

    #[test]
    fn a_name_behind_a_file_of_lingua_franca_is_too_much() {
        let error = format!("{:?}", error(Path::new("src/Main.lf:Main")));
        assert!(error.contains("write src/Main.lf alone"), "{error}");
    }

    #[test]
    fn bytes_that_are_no_text_are_named_by_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("Main.lf");
        std::fs::write(&path, b"target Python\n\xff\n").unwrap();
        let error = error(&path);
        assert!(format!("{error:?}").contains("line 2 is not UTF-8 text"), "{error:?}");
        let report = error.report();
        assert_eq!((report.file.as_deref(), report.line), (path.to_str(), Some(2)));
    }

    #[test]
    fn a_folder_is_no_program() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("app.py");
        std::fs::create_dir(&path).unwrap();
        assert!(format!("{:?}", error(&path)).contains("it is a folder"));
    }
}
