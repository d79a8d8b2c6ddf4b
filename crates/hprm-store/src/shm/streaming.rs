//! Copies past the caches of the processor. When that is the better way, `ways.rs` decides.
//!
//! An ordinary store to a line that is in no cache loads the line first, and keeps it: one third of what passes the memory
//! bus is for nothing, and a large value has driven itself out of the caches before a reader comes. A non-temporal store does
//! neither, but some processors have few of them under way at a time.

#![allow(unsafe_code)]

/// Copies bytes to a place of the same size.
#[cfg(not(all(target_arch = "x86_64", not(miri))))]
pub(crate) fn stream(to: &mut [u8], from: &[u8]) {
    to.copy_from_slice(from);
}

/// Copies bytes to a place of the same size.
#[cfg(all(target_arch = "x86_64", not(miri)))]
pub(crate) fn stream(to: &mut [u8], from: &[u8]) {
    use std::arch::x86_64::{
        __m128i, _MM_HINT_NTA, _mm_loadu_si128, _mm_prefetch, _mm_sfence, _mm_stream_si128,
    };

    const LINE: usize = 64;
    const WORD: usize = size_of::<__m128i>();
    /// How far ahead the source is fetched.
    const AHEAD: usize = 16 * LINE;

    let skipped = to.as_ptr().align_offset(LINE).min(to.len());
    let (to_first, to) = to.split_at_mut(skipped);
    let (from_first, from) = from.split_at(skipped);
    to_first.copy_from_slice(from_first);
    let (mut to, mut from) = (to.chunks_exact_mut(LINE), from.chunks_exact(LINE));
    for (to, from) in (&mut to).zip(&mut from) {
        // SAFETY: a prefetch reads nothing that the program sees, and faults nowhere.
        unsafe { _mm_prefetch::<_MM_HINT_NTA>(from.as_ptr().wrapping_add(AHEAD).cast()) };
        for (to, from) in to.chunks_exact_mut(WORD).zip(from.chunks_exact(WORD)) {
            // SAFETY: there are 16 bytes to read, at any address; all x86-64 have this instruction.
            let word = unsafe { _mm_loadu_si128(from.as_ptr().cast::<__m128i>()) };
            // SAFETY: there are 16 bytes to write, aligned to as many, because what came before a line was split off.
            unsafe { _mm_stream_si128(to.as_mut_ptr().cast::<__m128i>(), word) };
        }
    }
    to.into_remainder().copy_from_slice(from.remainder());
    // Non-temporal stores are not in order with others: what tells a reader of these bytes must come after them.
    // SAFETY: all x86-64 have this instruction.
    unsafe { _mm_sfence() };
}
