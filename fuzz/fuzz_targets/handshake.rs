//! No bytes are a proof of a secret that is not in them.

#![no_main]

use libfuzzer_sys::fuzz_target;

#[path = "../../crates/hprm/tests/common/strange_bytes.rs"]
mod common;
#[allow(dead_code)]
#[path = "../../crates/hprm/src/link/proof.rs"]
mod proof;

fuzz_target!(|bytes: &[u8]| common::strange_bytes(bytes));
