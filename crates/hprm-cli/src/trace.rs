//! Logical traces: comparing two, and what to say of the differences.
//!
//! The format, writing and reading a trace, and merging the shares of federates are in the library.

mod compare;
mod say;

use std::ffi::OsString;

pub(crate) use compare::{Comparison, Judge, digest};
use hprm::trace::TraceShare;
pub(crate) use say::{clocks, hint, moment, processes, sentence, share};

/// The options of an interpreter that writes such a share of a trace.
pub(crate) fn share_options(share: &TraceShare) -> Vec<OsString> {
    let mut options = vec!["--logical-trace".into(), share.file.clone().into()];
    if share.trace != share.file {
        options.extend(["--share-of".into(), share.trace.clone().into()]);
    }
    options
}
