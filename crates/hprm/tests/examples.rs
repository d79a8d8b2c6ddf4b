//! The examples print what they say, the handbook has the first of them, and a crate outside of this workspace can use
//! the library.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

/// Each example that is in Rust only, and what it prints.
const EXAMPLES: [(&str, &str); 2] = [
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

/// How a crate is compiled that is compiled once.
const QUICKLY: [&str; 4] =
    ["--config", "profile.dev.debug=false", "--config", "profile.dev.incremental=false"];

const FEDERATION: &str = "[detector] 0 0.5\n[detector] 100000000 0.5\n[detector] 200000000 0.5\n";

/// Examples that are federates of programs in other languages, whose tests run them: `tests/python/test_mixed.py`.
const FEDERATES: [&str; 5] = ["brighten", "camera", "controller", "mixer", "scanner"];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize().unwrap()
}

fn cargo(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO"));
    // What cargo tells this process about its own package. Build scripts ask for it, `ring`'s for one: cargo would run them
    // again, and compile all that depends on them, whenever a person's shell and this test have called it in turn.
    for (name, _) in std::env::vars_os() {
        let name = name.to_string_lossy();
        if name.starts_with("CARGO_PKG_") || name.starts_with("CARGO_MANIFEST_") {
            command.env_remove(&*name);
        }
    }
    let output = command.args(arguments).current_dir(folder).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    output
}

/// Where the examples are. They are built once, together with what is built for other tests: other packages would mean
/// other features, and another build.
fn examples() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let packages = ["--workspace", "--features", "hprm-cli/whole", "--examples"];
        cargo(&root(), &[&["build", "--quiet", "--offline"], &packages[..]].concat());
        // The folder of this test is `deps`, beside that of the examples.
        std::env::current_exe().unwrap().ancestors().nth(2).unwrap().join("examples")
    })
}

fn run_example(name: &str) -> String {
    let output = Command::new(examples().join(name)).current_dir(root()).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// The examples that the READMEs in `examples/` run with cargo, and what each prints.
fn gallery() -> Vec<(String, String)> {
    let mut found = Vec::new();
    for folder in fs::read_dir(root().join("examples")).unwrap() {
        let Ok(readme) = fs::read_to_string(folder.unwrap().path().join("README.md")) else {
            continue;
        };
        let Some((before, behind)) = readme.split_once("cargo run --example ") else { continue };
        assert!(before.contains("```sh\n"));
        let name = behind.lines().next().unwrap().to_owned();
        let (_, block) = behind.split_once("```text\n").unwrap();
        found.push((name, block.split_once("```").unwrap().0.to_owned()));
    }
    found
}

/// The READMEs, and the pages of the tutorial, whose commands `tests/python` runs.
fn texts() -> String {
    let read = |path: PathBuf| fs::read_to_string(path).unwrap_or_default();
    let pages = fs::read_dir(root().join("docs/tutorial")).unwrap();
    let pages = pages.map(|page| read(page.unwrap().path()));
    let folders = fs::read_dir(root().join("examples")).unwrap();
    pages.chain(folders.map(|folder| read(folder.unwrap().path().join("README.md")))).collect()
}

/// What was printed, sorted by federate: the lines of several federates come in any order.
fn by_federate(printed: &str) -> Vec<&str> {
    let mut lines: Vec<_> = printed.lines().collect();
    lines.sort_by_key(|line| line.strip_prefix('[').and_then(|it| it.split(']').next()));
    lines
}

#[test]
fn examples_print_what_they_say() {
    let files = fs::read_dir(root().join("crates/hprm/examples")).unwrap();
    assert_eq!(files.count(), EXAMPLES.len() + FEDERATES.len());
    for (name, printed) in EXAMPLES {
        assert_eq!(run_example(name), printed, "{name}");
    }
}

#[test]
fn examples_of_the_gallery_print_what_their_readmes_say() {
    let gallery = gallery();
    let manifest = fs::read_to_string(root().join("crates/hprm/Cargo.toml")).unwrap();
    let texts = texts();
    for name in manifest.lines().filter_map(|line| line.strip_prefix("name = \"")) {
        let name = name.trim_end_matches('"');
        let is_shown =
            ["\n", "`"].iter().any(|end| texts.contains(&format!("--example {name}{end}")));
        let is_example = manifest.contains(&format!("[[example]]\nname = \"{name}\"\n"));
        assert!(is_shown || !is_example, "neither a README nor the handbook runs {name}");
    }
    for (name, printed) in gallery {
        assert_eq!(by_federate(&run_example(&name)), by_federate(&printed), "{name}");
    }
}

#[test]
fn a_federate_that_is_started_alone_says_what_it_is() {
    for name in FEDERATES {
        let output = Command::new(examples().join(name)).current_dir(root()).output().unwrap();
        let shown = String::from_utf8(output.stderr).unwrap();
        assert!(
            shown.contains("is a federate of a program that is described elsewhere"),
            "{shown}"
        );
        assert_eq!(output.status.code(), Some(1));
    }
}

/// The program that the handbook shows: the first example, without what it says of itself.
fn first_program() -> String {
    let example = fs::read_to_string(root().join("examples/federation/federation.rs")).unwrap();
    let (_, program) = example.split_once("\nuse std").unwrap();
    format!("use std{program}")
}

#[test]
fn the_handbook_shows_the_first_example_and_what_it_prints() {
    let page = fs::read_to_string(root().join("docs/index.md")).unwrap();
    assert!(page.contains("```{literalinclude} ../examples/federation/federation.rs\n"));
    assert!(page.contains(FEDERATION));
}

#[test]
fn a_crate_outside_of_the_workspace_adds_the_library_and_runs() {
    let folder = tempfile::tempdir().unwrap();
    let outside = folder.path().join("counting");
    let library = root().join("crates/hprm");
    cargo(folder.path(), &["new", "--quiet", "--vcs", "none", "counting"]);
    cargo(&outside, &["add", "--quiet", "--offline", "--path", library.to_str().unwrap()]);
    fs::write(outside.join("src/main.rs"), first_program()).unwrap();
    // The same versions as here: they have been downloaded.
    fs::copy(root().join("Cargo.lock"), outside.join("Cargo.lock")).unwrap();
    // What other crates of the library need is there already; what differs has names of its own there.
    let target = root().join("target");
    let target = target.to_str().unwrap();
    let run = ["run", "--quiet", "--offline", "--target-dir", target];
    let output = cargo(&outside, &[&run[..], &QUICKLY].concat());
    assert_eq!(String::from_utf8(output.stdout).unwrap(), FEDERATION);
}
