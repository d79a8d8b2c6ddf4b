//! The logical trace: what every reaction of a run did, in an order that depends on the program
//! alone.
//!
//! The file is JSON Lines; [`mod@line`] is its vocabulary and `docs/reference/logical-trace.md` describes it for
//! people. Here are the digest of a value, the writer that the loops use, the reader, and what makes
//! one trace of the shares of federates. Comparing two traces is for commands.

mod digest;
mod draft;
mod folder;
pub mod line;
mod merge;
mod parts;
mod reader;
mod writer;

pub use digest::{Described, Digest, Digester};
pub use draft::Draft;
pub(crate) use draft::open_there;
pub(crate) use folder::Folder;
pub use folder::remove_abandoned;
pub use parts::Parts;
pub use reader::{Group, Reader};
pub use writer::{Trace, TraceShare, cut_traces, reads};
