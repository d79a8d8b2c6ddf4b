//! Which of the federations that a `main` assembles a process belongs to.
//!
//! A federate runs the `main` of its launcher, in which other federations may come before its own: the launcher has
//! already run those. A federation is told by its name, and by how many of that name were assembled before it.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use crate::handover::Handover;
use crate::{Failure, Report};

/// What a process is to a federation that it assembles.
pub(super) enum Role {
    /// It may launch the federation, which is the one after so many others of the same name.
    Launcher(usize),
    /// It is a federate of it.
    Federate(Arc<Handover>),
    /// It is a federate of another one, and launches none.
    Other,
}

/// The federation of this process, if it is a federate. The launcher hands it over once.
static HANDED: OnceLock<Result<Option<Arc<Handover>>, Box<Report>>> = OnceLock::new();

/// How many federations of each name this process has assembled.
static ASSEMBLED: Mutex<BTreeMap<String, usize>> = Mutex::new(BTreeMap::new());

/// What this process is to the federation of that name which it begins to assemble.
///
/// # Errors
///
/// If what the launcher has handed over cannot be read.
pub(super) fn role(name: &str) -> Result<Role, Box<Report>> {
    let before = count(name);
    let handed = HANDED.get_or_init(|| {
        let handed = Handover::of_this_process();
        handed
            .map(|handed| handed.map(Arc::new))
            .map_err(|failure: Failure| Box::new(failure.report()))
    });
    Ok(match handed.as_ref().map_err(Clone::clone)? {
        None => Role::Launcher(before),
        Some(handover) if handover.program.name == name && handover.before == before => {
            Role::Federate(Arc::clone(handover))
        }
        Some(_) => Role::Other,
    })
}

/// Counts one more of that name, and says how many there were before.
fn count(name: &str) -> usize {
    let mut assembled = ASSEMBLED.lock().unwrap_or_else(PoisonError::into_inner);
    let count = assembled.entry(name.to_owned()).or_default();
    *count += 1;
    *count - 1
}
