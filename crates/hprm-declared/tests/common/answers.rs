//! The one promise about any input at all: an answer. Shared with the fuzz target in `fuzz/`.

use hprm_model::{Purpose, Severity, render_all};

/// Compiles a declaration and sees to it that the answer is a program, at least one error, or that it is no
/// declaration.
pub(crate) fn answers(text: &str) {
    let mut no_files = |_: &str| Err("no such file".to_owned());
    match hprm_lf::compile_declared(text, &[], &mut no_files, Purpose::Run) {
        Err(malformed) => assert!(!malformed.to_string().is_empty()),
        Ok(Ok(compiled)) => {
            assert_eq!(compiled.bodies.len(), compiled.program.reactions.len());
            assert_eq!(compiled.instances.len(), compiled.program.reactors.len());
            assert!(compiled.warnings.iter().all(|d| d.severity == Severity::Warning));
            assert!(!compiled.fingerprint().report().is_empty());
        }
        Ok(Err(failure)) => {
            let errors = failure.diagnostics.iter().filter(|d| d.severity == Severity::Error);
            assert!(errors.count() > 0, "it failed without an error: {text}");
            assert!(!render_all(&failure.diagnostics, &failure.sources, true).is_empty());
        }
    }
}
