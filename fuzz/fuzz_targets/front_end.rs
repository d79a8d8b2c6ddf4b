//! Any bytes are a program, or have at least one error.

#![no_main]

use libfuzzer_sys::fuzz_target;

#[path = "../../crates/hprm-lf/tests/language/answers.rs"]
mod answers;

fuzz_target!(|bytes: &[u8]| answers::answers(bytes));
