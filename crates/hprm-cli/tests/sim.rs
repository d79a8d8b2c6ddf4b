//! `hprm sim` as a person types it.

use std::process::{Command, Output};

fn sim(words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_hprm")).arg("sim").args(words).output().unwrap()
}

fn text(output: &Output) -> &str {
    std::str::from_utf8(&output.stdout).unwrap()
}

#[test]
fn a_seed_prints_the_same_each_time() {
    let (one, other) = (sim(&["--seed", "11", "--schedule"]), sim(&["--seed", "11", "--schedule"]));
    assert!(one.status.success());
    assert!(text(&one).starts_with("seed 11: "), "{}", text(&one));
    assert_eq!(text(&one), text(&other));
    assert_ne!(text(&one), text(&sim(&["--seed", "12", "--schedule"])));
}

#[test]
fn many_seeds_are_each_looked_at_once() {
    let output = sim(&["--seed", "3", "--seeds", "1200"]);
    assert!(output.status.success());
    let expected = "seeds 3 to 1202: 1200 federations, ";
    assert!(text(&output).starts_with(expected), "{}", text(&output));
    assert!(text(&output).trim_end().ends_with("; 0 wrong"), "{}", text(&output));
    assert_eq!(text(&output), text(&sim(&["--seed", "3", "--seeds", "1200"])));
}
