//! Logical traces as files: reading them, comparing two, and making one of the shares of federates.
//!
//! The format, and writing the trace of a process, is in the library.

mod compare;
mod merge;
mod parts;
mod read;
mod say;

pub(crate) use compare::{Comparison, Judge, digest};
pub(crate) use merge::merge;
pub(crate) use parts::Parts;
pub(crate) use read::Reader;
pub(crate) use say::{hint, moment, sentence, share};
