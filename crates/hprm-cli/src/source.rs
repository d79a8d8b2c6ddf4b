//! Reading `.lf` files for the front end, which itself never touches a disk.

use std::path::Path;

use hprm::{Disk, Kind, Report, Unreadable};
use hprm_model::{CompileFailure, Compiled};

use crate::message::Error;

/// Compiles the program at `path` with these target properties, or gives what the front end has against it.
///
/// # Errors
///
/// If there is no such program: the path is wrong, the file is unreadable or not text. What
/// is wrong *in* the program, or with a file that it imports, is the
/// inner result.
pub(crate) fn compile(
    path: &Path,
    properties: &[String],
) -> Result<Result<Compiled, CompileFailure>, Error> {
    let (name, mut disk) = read(path)?;
    Ok(hprm_lf::compile_with(name, properties, &mut disk))
}

/// Looks through the file at `path`, which may also be one that others import.
///
/// # Errors
///
/// As [`compile`].
pub(crate) fn check(path: &Path) -> Result<Result<Compiled, CompileFailure>, Error> {
    let (name, mut disk) = read(path)?;
    Ok(hprm_lf::check(name, &mut disk))
}

/// Reads a file before anything else, so that a wrong path is one plain error, not a diagnostic in a
/// file that does not exist.
fn read(path: &Path) -> Result<(&str, Disk), Error> {
    let name = path.to_str().ok_or_else(|| {
        Error::new(format!("the name of {} is not UTF-8 text", path.display()))
            .hint("give the file another name")
    })?;
    if path.extension().is_none_or(|extension| extension != "lf") {
        return Err(Error::new(format!("{name} is not a Lingua Franca program"))
            .hint("programs are files whose name ends in .lf"));
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
        Ok(false) => error.hint("is the path right? It is relative to the current directory"),
        _ => error,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_file_is_one_error() {
        let Err(error) = compile(Path::new("/nowhere/Main.lf"), &[]) else { panic!("it is there") };
        assert_eq!(
            error,
            Error::new("cannot read /nowhere/Main.lf: No such file or directory")
                .hint("is the path right? It is relative to the current directory")
        );
    }

    #[test]
    fn another_kind_of_file_is_refused() {
        for name in ["main.py", "Main", "lf"] {
            let Err(error) = compile(Path::new(name), &[]) else { panic!("{name}") };
            assert!(format!("{error:?}").contains("not a Lingua Franca program"), "{error:?}");
        }
    }

    #[test]
    fn bytes_that_are_no_text_are_named_by_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("Main.lf");
        std::fs::write(&path, b"target Python\n\xff\n").unwrap();
        let Err(error) = compile(&path, &[]) else { panic!("it is text") };
        assert!(format!("{error:?}").contains("line 2 is not UTF-8 text"), "{error:?}");
        let report = error.report();
        assert_eq!((report.file.as_deref(), report.line), (path.to_str(), Some(2)));
    }
}
