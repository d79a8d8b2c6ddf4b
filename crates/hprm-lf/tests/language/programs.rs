//! The programs in `tests/lf` at the root of the repository compile, without a warning.

#![allow(clippy::disallowed_methods, reason = "the loader of these tests reads files")]

use std::path::{Path, PathBuf};

use hprm_core::{Coordination, Delay, Nanos};
use hprm_lf::compile;
use hprm_model::{Compiled, render_all};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/lf")
}

fn compile_program(name: &str) -> Compiled {
    let path = folder().join(name);
    let mut loader = |path: &str| std::fs::read_to_string(path).map_err(|error| error.to_string());
    match compile(path.to_str().expect("a path in UTF-8"), &mut loader) {
        Ok(compiled) => compiled,
        Err(failure) => panic!("{failure}"),
    }
}

#[test]
fn all_compile_without_warnings() {
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder()).expect("the folder is there") {
        let name = entry.expect("it can be listed").file_name().into_string().expect("UTF-8");
        if name.ends_with(".lf") {
            let compiled = compile_program(&name);
            assert_eq!(render_all(&compiled.warnings, &compiled.sources, false), "", "{name}");
            names.push(name);
        }
    }
    assert!(names.len() >= 3, "{names:?}");
}

#[test]
fn gather_is_five_federates() {
    let compiled = compile_program("Gather.lf");
    let program = &compiled.program;
    let names: Vec<_> = program.federates.values().map(|f| (f.name.as_str(), f.maxwait)).collect();
    let forever = Nanos::MAX;
    assert_eq!(
        names,
        [
            ("client__0", forever),
            ("client__1", forever),
            ("client__2", forever),
            ("client__3", forever),
            ("server", forever),
        ]
    );
    assert_eq!(program.properties.coordination, Coordination::Decentralized);
    assert!(compiled.federated);
    assert_eq!(program.name, "Gather");
    assert_eq!(program.channels.len(), 8);
    let waits: Vec<_> = program.connections.values().map(|c| (c.delay, c.absent_after)).collect();
    assert_eq!(waits[..4], [(Delay::None, 0); 4]);
    assert_eq!(waits[4..], [(Delay::Microstep, forever); 4]);
    assert_eq!(compiled.preambles[0].text, "import time\nROUNDS = 5");
}

#[test]
fn drive_keeps_its_old_spellings() {
    const SECOND: Nanos = 1_000_000_000;
    let compiled = compile_program("Drive.lf");
    let program = &compiled.program;
    assert!(program.federates.values().all(|federate| federate.maxwait == 10 * SECOND));
    let waits: Vec<_> = program.connections.values().map(|c| c.absent_after).collect();
    let handled = 1_000 * SECOND;
    assert_eq!(waits, [handled, Nanos::MAX, handled, handled, 0]);
    let tardy: Vec<_> = program.reactions.values().map(|r| r.handles_tardy).collect();
    assert_eq!(tardy, [false, false, true, true, true, true]);
    let serializers: Vec<_> =
        program.connections.values().filter_map(|c| c.serializer.as_deref()).collect();
    assert_eq!(serializers, ["native", "native"]);
}
