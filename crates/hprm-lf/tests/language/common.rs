//! What the tests of the front end share: programs in memory, and questions about what they compile
//! to.

#![allow(dead_code, reason = "each test file uses its share")]

use hprm_lf::compile;
use hprm_model::{CompileFailure, Compiled, render_all};

/// Compiles `Main.lf` among `files`.
pub(crate) fn compile_files(files: &[(&str, &str)]) -> Result<Compiled, CompileFailure> {
    let mut loader = |path: &str| {
        let file = files.iter().find(|(name, _)| *name == path);
        file.map(|(_, text)| (*text).to_owned()).ok_or_else(|| "no such file".to_owned())
    };
    compile("Main.lf", &mut loader)
}

/// Compiles a program of one file, which lacks only its target.
pub(crate) fn compile_text(text: &str) -> Compiled {
    let text = format!("target Python {text}");
    compile_files(&[("Main.lf", &text)]).unwrap_or_else(|failure| panic!("{failure}"))
}

/// What is wrong with a program of one file, which lacks only its target.
pub(crate) fn errors(text: &str) -> String {
    let text = format!("target Python\n{}", text.trim_start_matches('\n'));
    errors_in(&[("Main.lf", &text)])
}

/// What is wrong with a program.
pub(crate) fn errors_in(files: &[(&str, &str)]) -> String {
    match compile_files(files) {
        Ok(_) => panic!("the program has no errors"),
        Err(failure) => failure.to_string(),
    }
}

/// The warnings about a program of one file, which lacks only its target.
pub(crate) fn warnings(text: &str) -> String {
    let compiled = compile_text(text);
    render_all(&compiled.warnings, &compiled.sources, false)
}

/// The connections of a program as `from -> to`, in order, without the name of the main reactor.
pub(crate) fn connections(compiled: &Compiled) -> Vec<String> {
    let short = |port| {
        let name = compiled.program.port_name(port);
        name.split_once('.').map_or(name.clone(), |(_, rest)| rest.to_owned())
    };
    let all = compiled.program.connections.values();
    all.map(|connection| format!("{} -> {}", short(connection.from), short(connection.to)))
        .collect()
}
