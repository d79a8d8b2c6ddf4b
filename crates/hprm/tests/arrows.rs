//! Which crate may depend on which: read from the manifests, so that no arrow appears unnoticed.

use std::collections::{BTreeMap, BTreeSet};
use std::process::Command;

use serde_json::Value;

/// Each of our crates, and those of ours that it may name.
const ARROWS: [(&str, &[&str]); 13] = [
    ("hprm-core", &[]),
    ("hprm-codec", &["hprm-core"]),
    ("hprm-federated", &["hprm-core"]),
    ("hprm-store", &["hprm-core"]),
    ("hprm-model", &["hprm-core"]),
    ("hprm-lf", &["hprm-core", "hprm-declared", "hprm-model"]),
    ("hprm-declared", &["hprm-core", "hprm-model"]),
    ("hprm-diagram", &["hprm-core", "hprm-model"]),
    (
        "hprm",
        &[
            "hprm-codec",
            "hprm-core",
            "hprm-declared",
            "hprm-federated",
            "hprm-store",
            "hprm-model",
            "hprm-lf",
        ],
    ),
    ("hprm-agent", &["hprm", "hprm-core", "hprm-federated"]),
    ("hprm-sim", &["hprm-core", "hprm-federated", "hprm-store"]),
    (
        "hprm-python",
        &[
            "hprm",
            "hprm-codec",
            "hprm-core",
            "hprm-declared",
            "hprm-lf",
            "hprm-model",
            "hprm-store",
        ],
    ),
    (
        "hprm-cli",
        &[
            "hprm",
            "hprm-core",
            "hprm-declared",
            "hprm-diagram",
            "hprm-lf",
            "hprm-model",
            "hprm-sim",
        ],
    ),
];

/// What a pure crate must not name: whatever touches the world.
const WORLDLY: [&str; 5] = ["rustix", "socket2", "libc", "tokio", "mio"];
const PURE: [&str; 8] = [
    "hprm-codec",
    "hprm-core",
    "hprm-declared",
    "hprm-diagram",
    "hprm-federated",
    "hprm-lf",
    "hprm-model",
    "hprm-sim",
];

/// What each package names for its own code, not for its tests. The agent is a workspace of its own.
fn dependencies() -> BTreeMap<String, BTreeSet<String>> {
    let agent = concat!(env!("CARGO_MANIFEST_DIR"), "/../hprm-agent/Cargo.toml");
    let mut all = dependencies_in(concat!(env!("CARGO_MANIFEST_DIR"), "/../../Cargo.toml"));
    all.extend(dependencies_in(agent));
    all
}

fn dependencies_in(manifest: &str) -> BTreeMap<String, BTreeSet<String>> {
    let arguments = ["metadata", "--no-deps", "--format-version", "1", "--manifest-path", manifest];
    let output = Command::new(env!("CARGO")).args(arguments).output().expect("cargo runs");
    let metadata: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let name = |of: &Value| of["name"].as_str().expect("a name").to_owned();
    let packages = metadata["packages"].as_array().expect("packages").iter();
    packages
        .map(|package| {
            let dependencies = package["dependencies"].as_array().expect("dependencies").iter();
            let normal = dependencies.filter(|dependency| dependency["kind"].is_null());
            (name(package), normal.map(name).collect())
        })
        .collect()
}

#[test]
fn arrows_point_one_way() {
    let dependencies = dependencies();
    let allowed: BTreeMap<_, _> = ARROWS.into_iter().collect();
    assert!(dependencies.keys().map(String::as_str).eq(allowed.keys().copied()));
    for (package, names) in &dependencies {
        let ours = names.iter().map(String::as_str).filter(|name| allowed.contains_key(name));
        for name in ours {
            assert!(allowed[package.as_str()].contains(&name), "{package} must not need {name}");
        }
    }
}

#[test]
fn only_the_agent_links_zenoh() {
    for (package, names) in dependencies() {
        assert_eq!(names.contains("zenoh"), package == "hprm-agent", "{package}");
    }
}

#[test]
fn pure_crates_need_nothing_worldly() {
    let dependencies = dependencies();
    for package in PURE {
        for name in WORLDLY {
            assert!(!dependencies[package].contains(name), "{package} is pure and needs {name}");
        }
    }
}
