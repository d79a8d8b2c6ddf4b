//! The limits that every part of the system agrees on, in one place.
//!
//! A limit that only one module knows lives in that module; these are the ones that two sides of a
//! link, or two crates, must share.

/// The most bytes of a payload that travel inside a message, in bytes. A larger buffer goes to the
/// object store. The paper (section III-C) has 64 KB there, for TCP; through shared memory, an object is cheaper from
/// between 8 and 16 KiB on.
pub const INLINE_LIMIT: usize = 12 * 1024;

/// The most bytes of an array for which memory of the heap is taken while it is computed. A larger one begins in the
/// object store, from where it is published without a copy. To copy a smaller one takes less time than its memory
/// in the store would take, which most arrays have for nothing: they are never sent.
pub const HEAP_ARRAY_LIMIT: usize = 64 * 1024;

/// Size of the read buffer that every link preallocates, in bytes: an eager message (paper, section III-C, eager
/// protocol), or many short ones.
pub const EAGER_BUFFER: usize = 68 * 1024;

/// The largest frame that a link accepts, in bytes. A message may be longer: its payload travels in
/// parts then, and only what describes it has to be one frame.
pub const FRAME_LIMIT: usize = 16 << 20;

/// How many bytes of messages to one receiver may be unprocessed when a federate begins a tag.
pub const FLOW_LIMIT: u64 = 8 << 20;

/// The most federates in one federation.
pub const FEDERATES: usize = u16::MAX as usize;

const _: () = assert!(EAGER_BUFFER > INLINE_LIMIT);
const _: () = assert!(FRAME_LIMIT > EAGER_BUFFER);
