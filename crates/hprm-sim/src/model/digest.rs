//! A hash of 128 bits, the same everywhere: states that differ have different ones.
//!
//! Among ten million states, two that do not differ in it although they should are as likely as one
//! in 10^24. It is no protection against an attacker that looks for such states.

use std::cell::Cell;
use std::hash::{BuildHasherDefault, Hash, Hasher};
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

    fn write_u128(&mut self, number: u128) {
        self.add(number as u64);
        self.add((number >> 64) as u64);
    }

    fn write_usize(&mut self, number: usize) {
        self.add(number as u64);
    }
}

/// Hashes of states.
#[expect(clippy::disallowed_types, reason = "nothing depends on their order")]
pub(super) type Digests = std::collections::HashSet<u128, BuildHasherDefault<OfDigest>>;

/// A part of a hash is a hash itself.
#[derive(Default)]
pub(super) struct OfDigest(u64);

impl Hasher for OfDigest {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, _: &[u8]) {
        unreachable!("digests are numbers of 128 bits");
    }

    fn write_u128(&mut self, digest: u128) {
        self.0 = digest as u64;
    }
}

/// A value that states share until they differ in it, with its hash at hand once that was needed.
#[derive(Clone)]
pub(super) struct Shared<T> {
    value: Arc<T>,
    digest: Cell<Option<u128>>,
}

impl<T: Hash + Clone> Shared<T> {
    pub(super) fn new(value: T) -> Self {
        Self { value: Arc::new(value), digest: Cell::new(None) }
    }

    pub(super) fn get(&self) -> &T {
        &self.value
    }

    pub(super) fn digest(&self) -> u128 {
        let known = self.digest.get().unwrap_or_else(|| digest(&*self.value));
        self.digest.set(Some(known));
        known
    }

    /// The value, for this owner alone.
    pub(super) fn into_inner(self) -> T {
        Arc::unwrap_or_clone(self.value)
    }

    /// Changes it for this owner alone.
    pub(super) fn change<R>(&mut self, change: impl FnOnce(&mut T) -> R) -> R {
        self.digest.set(None);
        change(Arc::make_mut(&mut self.value))
    }
}
