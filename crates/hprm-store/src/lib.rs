//! The object store: large values written once and read in place by every process of a host.
//!
//! Each federate owns its store. It [`loan`](Store::loan)s memory, writes it, and
//! [`seal`](Store::seal)s it for its readers; what travels is an [`ObjectRef`](hprm_core::ObjectRef)
//! of some 40 bytes, and each reader [`open`](Store::open)s it as an [`Object`]. There is no daemon, no
//! name in the file system and no shared counter: the owner's [`Ledger`] alone knows who holds what,
//! and readers give back by message. Memory is recycled with its pages present, because faults, not
//! copies, are what large messages cost.
//!
//! [`Arena`] and [`Ledger`] are plain data and can be simulated; the mapping of memory, and all unsafe
//! code but the call that has the process hear of forks, is one private file. Linux only: it stands on sealed memfds.

#![deny(clippy::disallowed_methods, clippy::disallowed_types)]

mod announce;
mod arena;
mod at_fork;
mod claims;
mod error;
mod forks;
mod ledger;
mod loan;
mod object;
mod own;
mod passing;
mod returns;
mod ring;
mod shm;
mod store;
mod yard;

pub use arena::{Arena, Block};
pub use at_fork::{at_fork, is_forked, let_go, watch_forks};
pub use error::{SegmentError, StoreError};
pub use ledger::{HoldError, Ledger, Loan, LoanError, StoreLimits, StoreStats};
pub use loan::{LoanOf, WritableLoan};
pub use object::Object;
pub use own::OwnObject;
pub use returns::Wake;
pub use ring::{RING_CAPACITY, RingError, RingReader, RingWriter, map_ring_pair, ring_pair};
pub use store::{Announcement, Store};
pub use yard::Yard;
