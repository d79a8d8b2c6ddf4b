//! Which crate may depend on which: read from the manifests, so that no arrow appears unnoticed.

use std::collections::{BTreeMap, BTreeSet};

use cargo_metadata::{DependencyKind, MetadataCommand};

/// Each of our crates, and those of ours that it may name.
const ARROWS: [(&str, &[&str]); 12] = [
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

fn dependencies() -> BTreeMap<String, BTreeSet<String>> {
    let metadata = MetadataCommand::new().no_deps().exec().expect("cargo metadata");
    metadata
        .packages
        .iter()
        .map(|package| {
            let normal = package.dependencies.iter().filter(|d| d.kind == DependencyKind::Normal);
            (package.name.to_string(), normal.map(|d| d.name.clone()).collect())
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
fn pure_crates_need_nothing_worldly() {
    let dependencies = dependencies();
    for package in PURE {
        for name in WORLDLY {
            assert!(!dependencies[package].contains(name), "{package} is pure and needs {name}");
        }
    }
}
