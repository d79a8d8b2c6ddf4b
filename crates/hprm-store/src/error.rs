//! What can go wrong in a store, in words for the user of the program.

use hprm_core::{FederateId, ObjectRef};
use rustix::io::Errno;

use crate::HoldError;

/// Why a segment of shared memory cannot be had.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SegmentError {
    /// The system has no memory for it.
    #[error(
        "cannot create {len} bytes of shared memory ({step}: {cause}); {}", remedy(*cause)
    )]
    Create {
        /// The length in bytes.
        len: u64,
        /// The system call that failed.
        step: &'static str,
        /// The error of the system call.
        cause: Errno,
    },
    /// The system does not map the memory of another federate.
    #[error(
        "cannot map {len} bytes of another federate's shared memory ({step}: {cause}); it must come \
         from an HPRM object store on this host, and this process needs the address space"
    )]
    Map {
        /// The length in bytes.
        len: u64,
        /// The system call that failed.
        step: &'static str,
        /// The error of the system call.
        cause: Errno,
    },
    /// The memory could shrink, or be written by other processes than its owner's.
    #[error(
        "another federate offers shared memory that is not sealed against shrinking and against \
         foreign writes; refused, because reading it could end this process"
    )]
    NotSealed,
    /// The memory is shorter than its owner says.
    #[error("another federate announces {announced} bytes of shared memory and offers {actual}")]
    TooShort {
        /// The length that the owner announced, in bytes.
        announced: u64,
        /// The length of the file, in bytes.
        actual: u64,
    },
}

/// Why a store cannot do what it was asked.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StoreError {
    /// The capacity is reached.
    #[error("{}", full(*asked, *capacity, *in_use))]
    Full {
        /// The federate whose store it is.
        owner: FederateId,
        /// The length that was asked for, in bytes.
        asked: u64,
        /// The most bytes that may be mapped.
        capacity: u64,
        /// Bytes that are loaned or held.
        in_use: u64,
    },
    /// Values need an alignment that no block has.
    #[error("values that start at multiples of {align} bytes cannot lie in an object store")]
    Alignment {
        /// The alignment, in bytes.
        align: usize,
    },
    /// Memory cannot be created or mapped.
    #[error(transparent)]
    Segment(#[from] SegmentError),
    /// A segment was announced twice, or by the store itself.
    #[error("segment {segment} of federate {} was announced already", owner.0)]
    KnownSegment {
        /// The federate that owns the segment.
        owner: FederateId,
        /// The segment.
        segment: u32,
    },
    /// An object lies in a segment that was never announced, or is retired.
    #[error(
        "object {} of federate {} lies in segment {}, which was not announced before it",
        object.serial, object.owner.0, object.segment
    )]
    UnknownSegment {
        /// The object.
        object: ObjectRef,
    },
    /// A reference does not describe an object.
    #[error(
        "object {} of federate {} cannot lie at bytes {} to {} of segment {}",
        object.serial, object.owner.0, object.offset, object.offset.saturating_add(object.len),
        object.segment
    )]
    OutOfBounds {
        /// The reference.
        object: ObjectRef,
    },
    /// A hold does not exist.
    #[error(transparent)]
    Hold(#[from] HoldError),
}

/// How to have a larger store.
const RAISE: &str =
    "raise the limit of the object store (--store-limit; `Federation::store_limit` in Rust)";

/// Why a store has no room, and what to do about it.
fn full(asked: u64, capacity: u64, in_use: u64) -> String {
    if asked > capacity {
        return format!(
            "a value of {asked} bytes is larger than the federate's object store, which takes at most {capacity}; \
             send it in parts or {RAISE}"
        );
    }
    format!(
        "the federate's object store is full: {asked} bytes were asked for and {in_use} bytes of at most {capacity} \
         are in use; receivers hold them until they drop the values, so drop values sooner or {RAISE}"
    )
}

/// What to do if shared memory cannot be created.
fn remedy(cause: Errno) -> &'static str {
    match cause {
        // Shared memory is a file to the system.
        Errno::FBIG => {
            "ulimit -f limits how long a file may be, and shared memory is one: let it be longer, or unlimited"
        }
        _ => {
            "free memory on this host, raise its limits, or lower the limit of the object store \
             (--store-limit; `Federation::store_limit` in Rust)"
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_to_do_follows_from_the_error_of_the_system() {
        let said = |cause| SegmentError::Create { len: 1, step: "ftruncate", cause }.to_string();
        let too_long = said(Errno::FBIG);
        assert!(too_long.contains("; ulimit -f limits"), "{too_long}");
        assert!(!too_long.contains("free memory"), "{too_long}");
        assert!(said(Errno::NOMEM).contains("; free memory on this host"));
    }
}
