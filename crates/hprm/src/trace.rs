//! The logical trace: what every reaction of a run did, in an order that depends on the program
//! alone.
//!
//! The file is JSON Lines; [`line`] is its vocabulary and `docs/logical-trace.md` describes it for
//! people. Here are the digest of a value, and the writer that the loops use. Comparing two traces,
//! and merging those of federates, is for commands.

mod digest;
mod draft;
pub mod line;
mod writer;

pub use digest::{Described, Digest, Digester};
pub use draft::Draft;
pub use writer::{Trace, TraceShare, cut_traces, reads};
