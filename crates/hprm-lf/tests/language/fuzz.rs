//! Whatever the text is, the front end answers: with a program or with at least one error.

use crate::common::compile_files;
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
    crate::answers::answers(text.as_bytes());
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

/// The code of the first error of a program, or nothing if it has none.
fn first_error(text: &str) -> &'static str {
    let text = format!("target Python\n{text}");
    let failure = compile_files(&[("Main.lf", &text)]).err();
    failure.map_or("", |failure| failure.diagnostics[0].code)
}

#[test]
fn products_are_limited() {
    let wide = "reactor A(p = 0) { input[10000] i output[10000] o }";
    let refuse = |text: String| assert_eq!(first_error(&text), "LF0406", "{text:.200}");
    refuse(format!("{wide} main reactor {{ a = new[100000] A() }}"));
    refuse(format!("{wide} main reactor {{ a = new A() {} -> a.i }}", ["a.o"; 1_000].join(", ")));
    let reactions = "reaction(a.o) {= pass =} ".repeat(1_000);
    refuse(format!("{wide} main reactor {{ a = new A() {reactions} }}"));
    let long = "y".repeat(200_000);
    let many = "reactor B(p = 0) { } main reactor { b = new[100000] B(p = {= \"";
    refuse(format!("{many}{long}\" =}}) }}"));
    let modes: String = (0..300).map(|i| format!("mode M{i} {{ }} ")).collect();
    refuse(format!("main reactor {{ {modes} }}"));
}

#[test]
fn what_would_take_long_is_found_soon() {
    let ring = "reactor A { input i output o reaction(i) -> o {= pass =} }
        main reactor { a = new[20000] A() b = new A() a.o, b.o -> b.i, a.i }";
    assert_eq!(first_error(ring), "LF0503");
    let quotes = "''' \\''' ".repeat(50_000);
    assert_eq!(first_error(&format!("main reactor {{ reaction(startup) {{={quotes}=}} }}")), "");
    let quotes = "'a \\".repeat(50_000);
    assert_eq!(first_error(&format!("main reactor {{ reaction(startup) {{={quotes}=}} }}")), "");
    let storey = |i: usize| {
        let parts: String = (0..6).map(|k| format!("c{k} = new L{}() ", i + 1)).collect();
        format!("reactor L{i} {{ {parts} }} ")
    };
    let storeys: String = (0..30).map(storey).collect();
    let modal = "main reactor { timer t initial mode A { reaction(t) -> reset(B) {= pass =} }";
    let tower =
        format!("reactor L30 {{ state x = 0 }} {storeys} {modal} mode B {{ c = new L0() }} }}");
    assert_eq!(first_error(&format!("reactor X {{ state x: int }} {tower}")), "LF0202");
    let names: String = (0..3_000).map(|i| format!("input p{i} ")).collect();
    let missing: String = (0..3_000).map(|i| format!("reaction(q{i}) {{= pass =}} ")).collect();
    assert_eq!(first_error(&format!("main reactor {{ {names} {missing} }}")), "LF0303");
    let name = "n".repeat(100_000);
    assert_eq!(first_error(&format!("main reactor {{ state {name} = 0 }}")), "LF0007");
}

#[test]
fn a_line_that_would_fill_the_page_is_only_named() {
    let text = format!("target Python\nmain reactor {{ {} x }}", "/* */".repeat(1_000));
    let failure = compile_files(&[("Main.lf", &text)]).expect_err("`x` is nothing");
    let text = failure.to_string();
    assert_eq!(text.lines().last().map(str::trim), Some("--> Main.lf:2:5019"), "{text}");
}
