//! The limits that every part of the system agrees on, in one place.
//!
//! A limit that only one module knows lives in that module; these are the ones that two sides of a
//! link, or two crates, must share.

/// The most bytes of a payload that travel inside a message, in bytes. A larger buffer goes to the
/// object store (paper, section III-C: payloads greater than 64 KB).
pub const INLINE_LIMIT: usize = 64 * 1024;

/// Size of the read buffer that every link preallocates, in bytes: one eager message and its
/// frame header (paper, section III-C, eager protocol).
pub const EAGER_BUFFER: usize = INLINE_LIMIT + 4 * 1024;

/// The largest frame that a link accepts, in bytes. A message may be longer: its payload travels in
/// parts then, and only what describes it has to be one frame.
pub const FRAME_LIMIT: usize = 16 << 20;

/// How many bytes of messages to one receiver may be unprocessed when a federate begins a tag.
pub const FLOW_LIMIT: u64 = 8 << 20;

/// The most federates in one federation.
pub const FEDERATES: usize = u16::MAX as usize;

const _: () = assert!(EAGER_BUFFER > INLINE_LIMIT);
const _: () = assert!(FRAME_LIMIT > EAGER_BUFFER);
