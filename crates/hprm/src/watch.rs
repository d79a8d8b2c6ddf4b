//! Watching a connection of a running federation, from a process that is no part of it (`hprm echo`, `hprm rate`).
//!
//! Each federate listens at a Unix socket for processes of the same user. One that connects is a *watcher*: it says
//! which channels it wants to see, and gets what the federate sends on them from then on: for each message its tag,
//! its size, and its value as receivers get it, with large parts as references to objects in the federate's store. So
//! a watcher is one more reader, for which the end of its socket releases everything. It takes part in nothing else:
//! no frame of the protocol, no tag and no wait of the federate depends on it.
//!
//! The federate never waits for a watcher. What does not fit into the socket at once is dropped and counted, and
//! so is what a watcher could only get while it holds more than a few objects.
//!
//! Under this module: `tap.rs` decides which message goes to which watcher, and counts; it is a machine. `tally.rs` is
//! what is counted for a channel. `records.rs` is what the two ends say to one another. `server.rs` is the federate's end. Of the other end, `watcher.rs` sees what a federate sends;
//! `search.rs` finds what a user wants to watch, `target.rs` says which channels a port has, and `connecting.rs` connects to
//! federates, which are found by their boards. `sights.rs` waits for all of them.

mod connecting;
mod records;
mod search;
mod server;
mod sights;
mod tally;
mod tap;
mod target;
mod watcher;

pub use records::Wish;
pub use search::{Opened, Search, Watched, Words};
pub use sights::{Next, Shown, Sights};
pub use tally::Tally;
pub use target::ends;
pub use watcher::{Arrived, ArrivedPart, Counts, Held, Sight, Unseen, WatchError, Watching};

pub(crate) use server::WatchServer;
pub(crate) use tap::Sample;

use hprm_core::FederateId;
use sha2::{Digest, Sha256};

/// The most watchers of one federate at a time.
const WATCHERS: u16 = 16;

/// The name of the abstract socket at which a federate listens for watchers. `federation` is the name of the federation
/// in frames, `pid` what its process calls itself; both are on its board. All users see the names of sockets, and names
/// have little room, so it tells nothing.
fn socket_name(federation: &str, federate: &str, pid: u32) -> String {
    let digest = Sha256::digest(format!("{federation}\0{federate}\0{pid}"));
    let digits = digest.iter().take(16).map(|byte| format!("{byte:02x}"));
    format!("hprm-watch-{}", digits.collect::<String>())
}

/// By which number a watcher is a reader in the store of the federate: one that no federate has, unless there are
/// almost as many federates as there may be.
fn reader(watcher: u16) -> FederateId {
    FederateId(u16::MAX - watcher)
}

#[cfg(test)]
mod tests;
