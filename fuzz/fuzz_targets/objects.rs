//! Any reference and any memory that a peer offers is refused, or lies in sealed memory.

#![no_main]

use libfuzzer_sys::fuzz_target;

#[path = "../../crates/hprm-store/tests/common/strange_objects.rs"]
mod common;

fuzz_target!(|bytes: &[u8]| {
    common::strange_objects(bytes);
});
