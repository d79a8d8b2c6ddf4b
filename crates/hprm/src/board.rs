//! Boards: what the loops of a federation show of themselves, for tools that watch it from outside.
//!
//! Each loop of a federation, of a federate or of the RTI, has a board (`hprm_store::Board`): memory that it alone
//! writes, without ever waiting, and that other processes of the same user read without its knowledge. So to watch a
//! federation needs no preparation, and disturbs nothing, even if the watcher is killed. [`running`] finds the boards of
//! this machine by what `/proc` tells of the descriptors of processes; there is no file that could be left behind.
//! [`RunningFederation`] is what runs of one federation, and finds the one that a user means; all commands find it so.
//!
//! What is on a board: of which loop it is ([`Identity`]), what the numbers of its program mean ([`Names`]), and the state of its
//! loop ([`FederateState`], [`RtiState`]). A program in one process has no board.

mod federations;
mod identity;
mod running;
mod state;
mod writer;

pub use federations::{NotChosen, RunningFederation, federations};
pub use hprm_federated::{Blocker, FederationPhase, Hold, MemberView, Standing};
pub use identity::{ChannelName, FORMAT, Identity, Names, ReactionName, Role};
pub use running::{FederateView, Running, Shown, running};
pub use state::{ChannelCount, FederateState, Moment, RtiState, Stage, StoreState};
pub(crate) use writer::{BoardLanes, BoardWriter};

/// The cells of a board, by their numbers.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Cell {
    Identity,
    Names,
    State,
}

impl Cell {
    const fn number(self) -> usize {
        self as usize
    }
}
