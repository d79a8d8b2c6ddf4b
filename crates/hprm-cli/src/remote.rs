//! Federates that `hprm run` starts on other machines, through agents.
//!
//! ```text
//! hprm run ── stand-in ── agent ══ agent ── starter ── federate
//! ```
//!
//! For each federate of another machine, the launcher starts a stand-in, a process of its own that looks like the
//! federate: what it prints, the signals that it takes and how it ends are those of the federate. The stand-in asks the
//! agent of this machine for a link to the listener [`hprm::agent::STARTERS`] of the other one, at which no process listens: for each
//! such link the agent there starts a starter, which is this command again. The link ends with either of them, and the
//! starter then ends the federate. So no process is left, whichever of them is killed.
//!
//! `places` says which federate belongs where, `program` which files it needs, `protocol` what both say to one another,
//! `clocks` whether federates wait long enough for the clocks of their machines, `key` how each proves that it may, `cache`
//! keeps files, `limits` bounds what a federate uses, `notes` says why one was ended, `recording` brings what it records for a trace.

mod cache;
mod clocks;
mod key;
mod limits;
mod notes;
mod places;
mod program;
mod protocol;
mod recording;
mod stand_in;
mod starter;

pub(crate) use self::places::{Places, check_key, places};
pub(crate) use self::stand_in::{Errands, stand_in};
pub(crate) use self::starter::starter;
