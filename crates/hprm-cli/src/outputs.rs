//! The files that a command writes beside its output: none of them is a program, and no two are one file.
//!
//! Options that name files are easily mixed up with the program, which would be gone before it is read.

use std::fs;
use std::path::{Path, PathBuf};

use crate::args::{FederateArguments, LogFrames, RtiArguments, Run, Tracing};
use crate::declare;
use crate::message::Error;

/// An option, with the file that it names.
type Output<'a> = (&'static str, Option<&'a Path>);

/// Checks the options of `hprm run`.
///
/// # Errors
///
/// If one names the program, another text of a program that is there, or the file of another option.
pub(crate) fn check_of_run(run: &Run) -> Result<(), Error> {
    let logical_trace = ("--logical-trace", run.logical_trace.as_deref());
    check(&run.file, &[trace(&run.tracing), logical_trace, frames(&run.frames)])
}

/// Checks the options of `hprm federate`.
///
/// # Errors
///
/// As [`check_of_run`].
pub(crate) fn check_of_federate(federate: &FederateArguments) -> Result<(), Error> {
    let logical_trace = ("--logical-trace", federate.logical_trace.as_deref());
    check(&federate.file, &[trace(&federate.tracing), logical_trace, frames(&federate.frames)])
}

/// Checks the options of `hprm rti`.
///
/// # Errors
///
/// As [`check_of_run`].
pub(crate) fn check_of_rti(rti: &RtiArguments) -> Result<(), Error> {
    check(&rti.file, &[trace(&rti.tracing), frames(&rti.frames)])
}

fn trace(tracing: &Tracing) -> Output<'_> {
    ("--trace", tracing.file())
}

fn frames(frames: &LogFrames) -> Output<'_> {
    ("--log-frames-to", frames.log_frames_to.as_deref())
}

fn check(program: &Path, outputs: &[Output<'_>]) -> Result<(), Error> {
    let mut known = Vec::new();
    let program = place(declare::file_of(program));
    for (option, path) in outputs {
        let Some(path) = path.filter(|path| is_plain(path)) else { continue };
        let found = place(path);
        let is_text = path.extension().is_some_and(|ending| ending == "lf" || ending == "py");
        if found == program || (is_text && path.exists()) {
            let said = format!("{option} would replace the program {}", path.display());
            return Err(Error::option(said).hint("name a new file"));
        }
        if let Some((other, _)) = known.iter().find(|(_, other)| *other == found) {
            let said = format!("{other} and {option} name one file: {}", path.display());
            return Err(Error::option(said).hint("name a file for each"));
        }
        known.push((option, found));
    }
    Ok(())
}

/// Whether a path is, or would be, that of a plain file. Devices and pipes may be written to by several.
fn is_plain(path: &Path) -> bool {
    fs::metadata(path).map_or(true, |there| there.is_file())
}

/// The same path for all names of a file.
fn place(path: &Path) -> PathBuf {
    if let Ok(place) = fs::canonicalize(path) {
        return place;
    }
    let folder = path.parent().filter(|it| !it.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let folder = fs::canonicalize(folder).unwrap_or_else(|_| folder.to_owned());
    path.file_name().map_or(folder.clone(), |name| folder.join(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_written_once_and_is_no_program() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for name in ["Main.lf", "other.py", "there.trace"] {
            fs::write(at(name), "").unwrap();
        }
        let refused = |trace: &str, logical: &str| {
            let (trace, logical) = (at(trace), at(logical));
            let outputs =
                [("--trace", Some(&*trace)), ("--logical-trace", Some(&*logical)), ("-", None)];
            check(&at("Main.lf"), &outputs).err().map(|error| error.report().message.clone())
        };
        for (trace, logical, option) in [
            ("Main.lf", "new", "--trace would replace the program"),
            ("./Main.lf", "new", "--trace would replace the program"),
            ("new", "other.py", "--logical-trace would replace the program"),
            ("new", "new", "--trace and --logical-trace name one file"),
            ("there.trace", "./there.trace", "--trace and --logical-trace name one file"),
        ] {
            let said = refused(trace, logical).unwrap();
            assert!(said.starts_with(option), "{said}");
        }
        assert_eq!(refused("there.trace", "new"), None);
        assert_eq!(refused("new.py", "new"), None);
        let null = Some(Path::new("/dev/null"));
        assert!(check(&at("Main.lf"), &[("--trace", null), ("--logical-trace", null)]).is_ok());
    }
}
