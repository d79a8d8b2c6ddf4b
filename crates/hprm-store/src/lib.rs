//! The object store: large values written once and read in place by every process of a host.
//!
//! Each federate owns its store. It [`loan`](Store::loan)s memory, writes it, and
//! [`seal`](Store::seal)s it for its readers; what travels is an [`ObjectRef`](hprm_core::ObjectRef)
//! of some 40 bytes, and each reader [`open`](Store::open)s it as an [`Object`]. There is no daemon, no
//! name in the file system and no shared counter: the owner's [`Ledger`] alone records which
//! reader holds which object, and readers send their releases as messages. Blocks are used again with
//! their pages present, because page faults cost more than copies.
//!
//! [`Arena`] and [`Ledger`] are plain data and can be simulated. The module `shm` maps memory, and has all
//! unsafe code apart from `at_fork`, which registers functions for forks. Linux only: it needs sealed
//! memfds.

#![deny(clippy::disallowed_methods, clippy::disallowed_types)]

mod allocator;
mod announcements;
mod arena;
mod at_fork;
mod board;
mod claims;
mod cow_object;
mod drop_queue;
mod error;
mod forks;
mod forwarding;
mod ledger;
mod loan;
mod object;
mod ring;
mod shm;
mod store;
mod ways;
#[cfg(test)]
mod weak_memory;
mod word;

pub use allocator::StoreAllocator;
pub use arena::{Arena, Block};
pub use at_fork::{at_fork, is_forked, replace_with_null, watch_forks};
pub use board::{BOARD_NAME, Board, BoardLayout, BoardView, NOTE};
pub use cow_object::CowObject;
pub use drop_queue::Wake;
pub use error::{SegmentError, StoreError};
pub use ledger::{HoldError, Ledger, Loan, LoanError, StoreLimits, StoreStats};
pub use loan::{LoanOf, WritableLoan};
pub use object::Object;
pub use ring::{RING_CAPACITY, RingError, RingReader, RingWriter, map_ring_pair, ring_pair};
pub use store::{Announcement, Store};
pub use ways::{STREAMED, Way, Ways, copy};
