//! Whatever the text is, the front end answers: with a program or with at least one error.

mod common;

use common::compile_files;
use hprm_lf::{Severity, render_all};
use proptest::collection::vec;
use proptest::prelude::*;

const PROGRAM: &str = include_str!("fuzz_seed.lf");

/// Pieces of programs, which find more than random characters do.
const PIECES: [&str; 48] = [
    "{",
    "}",
    "(",
    ")",
    "[",
    "]",
    "<",
    ">",
    "{=",
    "=}",
    "'",
    "\"",
    "\"\"\"",
    "'''",
    "#",
    "//",
    "/*",
    "*/",
    ";",
    ",",
    ".",
    ":",
    "=",
    "->",
    "~>",
    "+",
    "-",
    "@",
    "\\",
    "\n",
    " ",
    "reactor",
    "main",
    "federated",
    "reaction",
    "input",
    "output",
    "state x",
    "mode M {",
    "new[3] Relay()",
    "after 0",
    "interleaved(",
    "99999999999999999999",
    "1.5e-3",
    "10 ms",
    "@maxwait(",
    "import A from \"Main.lf\"",
    "é",
];

fn answers(text: &str) {
    match compile_files(&[("Main.lf", text)]) {
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

/// Replaces `length` characters at `at`, both in thousandths of the text, by `piece`.
fn mutated(text: &str, (at, length, piece): (usize, usize, &str)) -> String {
    let characters: Vec<char> = text.chars().collect();
    let start = characters.len() * at / 1_000;
    let end = (start + length).min(characters.len());
    let mut result: String = characters[..start].iter().collect();
    result.push_str(piece);
    result.extend(&characters[end..]);
    result
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 512, ..ProptestConfig::default() })]

    #[test]
    fn any_text(text in "\\PC{0,200}") {
        answers(&text);
    }

    #[test]
    fn any_bytes(bytes in vec(any::<u8>(), 0..200)) {
        answers(&String::from_utf8_lossy(&bytes));
    }

    #[test]
    fn any_pieces(pieces in vec(prop::sample::select(&PIECES[..]), 0..60)) {
        answers(&format!("target Python {}", pieces.join(" ")));
        answers(&pieces.concat());
    }

    #[test]
    fn a_program_with_changes(
        changes in vec((0_usize..1_000, 0_usize..12, prop::sample::select(&PIECES[..])), 1..4)
    ) {
        answers(&changes.into_iter().fold(PROGRAM.to_owned(), |text, change| mutated(&text, change)));
    }

    #[test]
    fn a_program_cut_off(at in 0_usize..=1_000) {
        let text: String = PROGRAM.chars().take(PROGRAM.chars().count() * at / 1_000).collect();
        answers(&text);
    }
}

#[test]
fn the_seed_is_a_program() {
    assert!(compile_files(&[("Main.lf", PROGRAM)]).is_ok());
}

#[test]
fn deep_nesting_is_refused() {
    let lists = format!("target Python main reactor {{ state x = {} }}", "[".repeat(100_000));
    let types = format!("target Python main reactor {{ state x: {} }}", "a<".repeat(100_000));
    let objects = format!("target Python {{ a: {}", "{a: ".repeat(100_000));
    let modes = format!("target Python main reactor {{ {}", "mode M { ".repeat(100_000));
    for text in [lists, types, objects, modes] {
        answers(&text);
    }
}

#[test]
fn a_tower_of_reactors_is_refused() {
    let storey = |i: usize| format!("reactor A{i} {{ a = new A{}() }}\n", i + 1);
    let tower: String = (0..1_000).map(storey).collect();
    answers(&format!("target Python\n{tower} reactor A1000 {{ }} main reactor {{ a = new A0() }}"));
}

#[test]
fn a_program_that_multiplies_is_refused() {
    let storey = |i: usize| format!("reactor A{i} {{ a = new[1000] A{}() }}\n", i + 1);
    let storeys: String = (0..5).map(storey).collect();
    let text = format!("target Python\n{storeys} reactor A5 {{ }} main reactor {{ a = new A0() }}");
    let failure = compile_files(&[("Main.lf", &text)]).expect_err("too large");
    assert_eq!(failure.diagnostics[0].code, "LF0406");
}
