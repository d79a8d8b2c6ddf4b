//! The one promise about any input at all: an answer. Shared with the fuzz target in `fuzz/`.

use hprm_lf::compile;
use hprm_model::{Severity, render_all};

/// Compiles the program in `bytes` and sees to it that the answer is a program, or at least one
/// error.
///
/// A zero byte separates files. The first one is the main file; the others are spread over all
/// paths that anything imports.
pub(crate) fn answers(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    let files: Vec<&str> = text.split('\0').collect();
    let mut loader = |path: &str| match (path, files.len()) {
        ("Main.lf", _) => Ok(files[0].to_owned()),
        (_, 1) => Err("no such file".to_owned()),
        (path, count) => Ok(files[1 + path.len() % (count - 1)].to_owned()),
    };
    match compile("Main.lf", &mut loader) {
        Ok(compiled) => {
            let reactions = compiled.program.reactions.len();
            assert_eq!(compiled.bodies.len(), reactions);
            assert_eq!(compiled.instances.len(), compiled.program.reactors.len());
            assert!(compiled.warnings.iter().all(|d| d.severity == Severity::Warning));
        }
        Err(failure) => {
            let errors = failure.diagnostics.iter().filter(|d| d.severity == Severity::Error);
            assert!(errors.count() > 0, "it failed without an error");
            assert!(!render_all(&failure.diagnostics, &failure.sources, true).is_empty());
        }
    }
}
