//! A hash of 128 bits, the same everywhere: states that differ have different ones.
//!
//! Among ten million states, two that do not differ in it although they should are as likely as one
//! in 10^24. It is no protection against an attacker that looks for such states.

use std::hash::{Hash, Hasher};
use std::sync::Arc;

use crate::rng::mix;

/// The hash of a value.
pub(super) fn digest(value: &impl Hash) -> u128 {
    let mut lanes = Lanes { first: 1, second: 2 };
    value.hash(&mut lanes);
    u128::from(mix(lanes.first)) << 64 | u128::from(mix(lanes.second))
}

struct Lanes {
    first: u64,
    second: u64,
}

impl Lanes {
    fn add(&mut self, word: u64) {
        self.first = mix(self.first ^ word);
        self.second = mix(self.second.rotate_left(23).wrapping_add(word));
    }
}

impl Hasher for Lanes {
    fn finish(&self) -> u64 {
        mix(self.first ^ self.second)
    }

    fn write(&mut self, bytes: &[u8]) {
        let mut chunks = bytes.chunks_exact(8);
        for chunk in chunks.by_ref() {
            self.add(u64::from_le_bytes(chunk.try_into().expect("a chunk has eight bytes")));
        }
        let rest = chunks.remainder();
        if !rest.is_empty() {
            let mut word = [0; 8];
            word[..rest.len()].copy_from_slice(rest);
            self.add(u64::from_le_bytes(word));
        }
    }

    fn write_u8(&mut self, number: u8) {
        self.add(u64::from(number));
    }

    fn write_u32(&mut self, number: u32) {
        self.add(u64::from(number));
    }

    fn write_u64(&mut self, number: u64) {
        self.add(number);
    }

    fn write_usize(&mut self, number: usize) {
        self.add(number as u64);
    }
}

/// A value that states share until they differ in it, with its hash at hand.
#[derive(Clone)]
pub(super) struct Shared<T> {
    value: Arc<T>,
    digest: u128,
}

impl<T: Hash + Clone> Shared<T> {
    pub(super) fn new(value: T) -> Self {
        Self { digest: digest(&value), value: Arc::new(value) }
    }

    pub(super) fn get(&self) -> &T {
        &self.value
    }

    pub(super) fn digest(&self) -> u128 {
        self.digest
    }

    /// Changes it for this owner alone.
    pub(super) fn change<R>(&mut self, change: impl FnOnce(&mut T) -> R) -> R {
        let result = change(Arc::make_mut(&mut self.value));
        self.digest = digest(&*self.value);
        result
    }
}
