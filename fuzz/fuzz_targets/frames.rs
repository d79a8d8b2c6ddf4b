//! Any bytes on a link are frames or an error, and machines take whatever the frames say.

#![no_main]

use libfuzzer_sys::fuzz_target;

#[path = "../../crates/hprm-federated/tests/common/frames.rs"]
mod common;

fuzz_target!(|bytes: &[u8]| {
    let program = common::program();
    common::tell(&program, common::frames(bytes));
});
