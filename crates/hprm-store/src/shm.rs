//! Shared memory: the one module of this crate that maps memory.
//!
//! What it gives: 50 MB that several processes read where one of them wrote it, without a copy. It owns
//! memfds, mappings, and slices into them. It does not decide which federate may read or write which
//! bytes and when: that is the ledger's task. But within a process it trusts no caller, and checks
//! every borrow against [`Claims`](crate::claims::Claims).
//!
//! The argument for soundness, on which the unsafe blocks of the files below rely:
//!
//! - A [`Mapping`](mapping::Mapping) is a live mapping of `len` bytes from `base` until it is dropped,
//!   and every slice borrows from a value that owns the mapping. The memory behind it exists as long:
//!   the owner has faulted in each page before the segment is used, and a view is made only of a file
//!   that is sealed against shrinking.
//! - Within the owner's process, a slice is only made under a claim, and claims do not overlap unless
//!   all of them are for reading.
//! - Other processes cannot write: the file is sealed against writable mappings other than the one
//!   that the owner made before. That the owner itself does not write what a reader holds is the
//!   protocol of the store (an object is freed only by its releases). This is the one thing for which a
//!   reader has to trust its peer; the bytes are plain `u8`, which are valid whatever they are.
//! - Memory that one process writes while others read it, or that two write, is never seen as bytes:
//!   [`PublishedWords`] and [`SharedWords`] are atomic words.

mod cow;
mod cow_pages;
mod locks;
mod mapping;
mod published;
mod segment;
mod streaming;
mod view;
mod words;

pub(crate) use cow::CowMapping;
pub(crate) use cow_pages::CowPages;
pub(crate) use locks::{FileDescription, ForkLock, is_locked, lock_file};
pub(crate) use published::{PublishedWords, WordsView};
pub(crate) use segment::{ReadBorrow, Segment, WriteBorrow};
pub(crate) use streaming::stream;
pub(crate) use view::SegmentView;
pub(crate) use words::{SharedWords, fetch, fetch_to_store};
