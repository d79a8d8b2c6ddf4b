//! The examples of `hprm explain`: each wrong program gives its code and nothing else, and the mended one gives
//! nothing.
//!
//! Those that need Python, an executable or another command are run by `tests/python/test_explain.py`.

use hprm_lf::{SourceLoader, check};
use hprm_model::explanation::{Example, groups};

/// The files of an example.
struct Files<'a>(&'a Example);

impl Files<'_> {
    fn text(&self, path: &str) -> Option<&str> {
        self.0.files.iter().find(|(name, _)| *name == path).map(|(_, text)| *text)
    }
}

impl SourceLoader for Files<'_> {
    fn load(&mut self, path: &str) -> Result<String, String> {
        self.text(path).map(str::to_owned).ok_or_else(|| "No such file or directory".to_owned())
    }

    fn exists(&mut self, path: &str) -> bool {
        self.text(path).is_some()
    }
}

/// Whether the check alone answers it.
fn is_pure(example: &Example) -> bool {
    example.command.is_none() && example.files.iter().all(|(name, _)| !name.ends_with(".py"))
}

#[test]
fn each_example_gives_its_code_and_the_mended_one_nothing() {
    let mut count = 0;
    for group in groups().iter().filter(|group| !["LF10", "LF11"].contains(&group.prefix)) {
        for explanation in &group.explanations {
            for example in explanation.examples().iter().filter(|example| is_pure(example)) {
                let found = match check("Main.lf", &mut Files(example)) {
                    Ok(compiled) => compiled.warnings,
                    Err(failure) => failure.diagnostics,
                };
                let mut codes: Vec<_> = found.iter().map(|it| (it.code, it.severity)).collect();
                codes.dedup();
                let expected = (explanation.code, explanation.severity);
                let expected = (!example.is_right).then_some(expected);
                assert_eq!(codes, Vec::from_iter(expected), "{}: {found:#?}", explanation.code);
                count += 1;
            }
        }
    }
    assert!(count > 150, "{count}");
}
