//! Any bytes are a value that Rust can decode, or an error.

#![no_main]

use libfuzzer_sys::fuzz_target;

#[path = "../../crates/hprm-codec/tests/common/strange_values.rs"]
mod common;

fuzz_target!(|bytes: &[u8]| common::strange_values(bytes));
