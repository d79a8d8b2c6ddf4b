//! References and memory that no honest peer would send: the same ones on each run. `fuzz/` looks for
//! more with the same function.

#[path = "common/strange_objects.rs"]
mod common;

/// How many stores are told something.
const ROUNDS: usize = 2_000;

#[test]
fn what_describes_no_object_is_refused() {
    // Numbers that are the same on each run (xorshift).
    let mut state = 0x9E37_79B9_7F4A_7C15_u64;
    let mut byte = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 33).to_le_bytes()[0]
    };
    let mut opened = 0;
    for _ in 0..ROUNDS {
        let script: Vec<u8> = (0..200).map(|_| byte()).collect();
        opened += common::strange_objects(&script);
    }
    // Otherwise this would be about errors alone.
    assert!(opened > ROUNDS / 50, "only {opened} objects were opened");
}
