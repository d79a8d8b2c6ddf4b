//! The examples print what they say, the README has the first of them, and a crate outside of this workspace can use
//! the library.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Each example, and what it prints.
const EXAMPLES: [(&str, &str); 7] = [
    ("counter", COUNTER),
    ("federation", FEDERATION),
    ("ping_pong", "1ms: 2 left\n2ms: 1 left\n3ms: 0 left\n"),
    (
        "sensor",
        "reading 0: 20 °C\nreading 1: 21 °C\nreading 2: 22 °C\nreading 3: 23 °C\nreading 4: 20 °C\n",
    ),
    (
        "modes",
        "2ms: worker 0 is tired\n3ms: worker 1 is tired\n4ms: worker 2 is tired\n6ms: worker 0 is rested\n\
         7ms: worker 1 is rested\n8ms: worker 0 is tired\n8ms: worker 2 is rested\n10ms: worker 1 is tired\n",
    ),
    (
        "deadline",
        "0ns: 12\n5ms: 30\nerror: reaction Parsing.parser.1 failed at (10000000 ns, 0): invalid digit found in \
         string\n",
    ),
    (
        "filter",
        "0ns: coarse Some(5)\n0ns: fine Some(0.5)\n1ms: coarse Some(15)\n1ms: fine Some(1.5)\n\
         2ms: coarse Some(30)\n2ms: fine Some(3.0)\n3ms: coarse Some(60)\n3ms: fine Some(6.0)\n\
         4ms: coarse Some(80)\n4ms: fine Some(8.0)\n",
    ),
];

const FEDERATION: &str = "[detector] 0 0.5\n[detector] 100000000 0.5\n[detector] 200000000 0.5\n";

const COUNTER: &str = "0ns: 1\n100ms: 3\n200ms: 6\n";

/// Examples that are federates of programs in other languages, whose tests run them: `tests/python/test_mixed.py`.
const FEDERATES: [&str; 2] = ["camera", "controller"];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize().unwrap()
}

fn cargo(folder: &Path, arguments: &[&str]) -> Output {
    let output = Command::new(env!("CARGO")).args(arguments).current_dir(folder).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    output
}

#[test]
fn examples_print_what_they_say() {
    let files = fs::read_dir(root().join("crates/hprm/examples")).unwrap();
    assert_eq!(files.count(), EXAMPLES.len() + FEDERATES.len());
    for (name, printed) in EXAMPLES {
        let run = ["run", "--quiet", "--offline", "-p", "hprm", "--example", name];
        let output = cargo(&root(), &run);
        assert_eq!(String::from_utf8(output.stdout).unwrap(), printed, "{name}");
    }
}

#[test]
fn a_federate_that_is_started_alone_says_what_it_is() {
    for name in FEDERATES {
        let run = ["run", "--quiet", "--offline", "-p", "hprm", "--example", name];
        let output = Command::new(env!("CARGO")).args(run).current_dir(root()).output().unwrap();
        let shown = String::from_utf8(output.stderr).unwrap();
        assert!(
            shown.contains("is a federate of a program that is described elsewhere"),
            "{shown}"
        );
        assert_eq!(output.status.code(), Some(1));
    }
}

/// The first code block of the README in Rust.
fn readme_program() -> String {
    let readme = fs::read_to_string(root().join("README.md")).unwrap();
    let (_, block) = readme.split_once("```rust\n").unwrap();
    block.split_once("```\n").unwrap().0.to_owned()
}

#[test]
fn the_first_example_is_that_of_the_readme() {
    let example = fs::read_to_string(root().join("crates/hprm/examples/federation.rs")).unwrap();
    assert!(example.ends_with(&readme_program()));
    assert!(fs::read_to_string(root().join("README.md")).unwrap().contains(FEDERATION));
}

#[test]
fn a_crate_outside_of_the_workspace_adds_the_library_and_runs() {
    let folder = tempfile::tempdir().unwrap();
    let outside = folder.path().join("counting");
    let library = root().join("crates/hprm");
    cargo(folder.path(), &["new", "--quiet", "--vcs", "none", "counting"]);
    cargo(&outside, &["add", "--quiet", "--offline", "--path", library.to_str().unwrap()]);
    fs::write(outside.join("src/main.rs"), readme_program()).unwrap();
    // The same versions as here: they have been downloaded.
    fs::copy(root().join("Cargo.lock"), outside.join("Cargo.lock")).unwrap();
    let target = root().join("target/outside");
    let target = target.to_str().unwrap();
    let output = cargo(&outside, &["run", "--quiet", "--offline", "--target-dir", target]);
    assert_eq!(String::from_utf8(output.stdout).unwrap(), FEDERATION);
}
