//! Handshakes with processes that do not know the secret. `fuzz/` looks for more with the same function.

#[path = "common/strange_bytes.rs"]
mod common;
// The machine is private to the crate; what is tested here is its source.
#[allow(dead_code, unused_imports, reason = "this test needs a part of it")]
#[path = "../src/link/proof.rs"]
mod proof;

use proptest::prelude::*;

/// What an opener sends first, without the rest of its nonce.
const GREETING: [u8; 9] = *b"\x07HPRM-L01";

proptest! {
    #[test]
    fn no_bytes_are_a_proof(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        common::strange_bytes(&bytes);
    }

    #[test]
    fn a_process_that_knows_the_protocol_does_not_know_the_secret(
        rest in prop::collection::vec(any::<u8>(), 0..200),
        accepts in any::<bool>(),
    ) {
        let mut bytes = GREETING.to_vec();
        bytes.extend(rest);
        // Where a verdict would be, if there are as many bytes.
        if let Some(verdict) = bytes.get_mut(1 + 40) {
            *verdict = u8::from(accepts);
        }
        common::strange_bytes(&bytes);
    }
}
