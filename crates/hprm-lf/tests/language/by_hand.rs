//! A program that is declared without a parser is the same one as its text, with the same mistakes.

use crate::common::compile_files;
use crate::two_doors::{self, CAUSALITY_LOOP, Main, RIGHT, TWO_SOURCES};

fn parsed(main: &Main) -> Result<hprm_model::Compiled, hprm_model::CompileFailure> {
    compile_files(&[("Main.lf", &two_doors::text(main))])
}

#[test]
fn what_is_declared_is_what_the_text_says() {
    let (declared, parsed) = (two_doors::compiled(&RIGHT).unwrap(), parsed(&RIGHT).unwrap());
    // All of it: the program, classes, bodies, and where each of them is.
    assert_eq!(format!("{declared:#?}"), format!("{parsed:#?}"));
    assert_eq!(declared.fingerprint().digest(), parsed.fingerprint().digest());
}

#[test]
fn mistakes_are_the_same_and_at_the_same_places() {
    for (main, code) in [(&TWO_SOURCES, "LF0502"), (&CAUSALITY_LOOP, "LF0503")] {
        let (declared, parsed) =
            (two_doors::compiled(main).unwrap_err(), parsed(main).unwrap_err());
        assert_eq!(declared.diagnostics, parsed.diagnostics);
        assert_eq!(declared.to_string(), parsed.to_string());
        assert_eq!(declared.diagnostics[0].code, code);
    }
}
