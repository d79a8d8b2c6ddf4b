//! Any bytes are the declaration of a program, have at least one error, or are no declaration.

#![no_main]

use libfuzzer_sys::fuzz_target;

#[path = "../../crates/hprm-declared/tests/common/answers.rs"]
mod answers;

fuzz_target!(|bytes: &[u8]| answers::answers(&String::from_utf8_lossy(bytes)));
