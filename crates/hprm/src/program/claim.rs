//! Which of the federations that a `main` assembles a process belongs to.
//!
//! A federate runs the `main` of its launcher, in which other federations may come before its own: the launcher has
//! already run those. Of federations of one name, one is told from the others by its place in the source, by the name of
//! its thread, because the tests of a harness are threads that run in any order, and by how many there were before it.

use std::collections::BTreeMap;
use std::panic::Location;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::thread::{self, ThreadId};

use crate::handover::{Handover, Which};
use crate::{Failure, Kind, Report};

/// What a process is to a federation that it assembles.
pub(super) enum Role {
    /// It may launch the federation, which is this one of those of its name.
    Launcher(Which),
    /// It is a federate of it.
    Federate(Arc<Handover>),
    /// It is a federate of another one, and launches none.
    Other,
}

/// The federation of this process, if it is a federate. The launcher hands it over once.
static HANDED: OnceLock<Result<Option<Arc<Handover>>, Box<Report>>> = OnceLock::new();

/// What this process has assembled, by name.
static ASSEMBLED: Mutex<BTreeMap<String, Assembled>> = Mutex::new(BTreeMap::new());

/// Federations of one name.
#[derive(Default)]
struct Assembled {
    /// How many.
    all: usize,
    /// How many of each place and name of thread, and the thread of the first.
    each: BTreeMap<(String, Option<String>), (usize, Option<ThreadId>)>,
}

/// What this process is to the federation of that name which it begins to assemble there.
///
/// # Errors
///
/// If what the launcher has handed over cannot be read, or no federate could tell which federation is its own.
pub(super) fn role(name: &str, at: &Location<'_>) -> Result<Role, Box<Report>> {
    let (all_before, which) = count(name, at)?;
    let handed = HANDED.get_or_init(|| {
        let handed = Handover::of_this_process();
        handed
            .map(|handed| handed.map(Arc::new))
            .map_err(|failure: Failure| Box::new(failure.report()))
    });
    Ok(match handed.as_ref().map_err(Clone::clone)? {
        None => Role::Launcher(which),
        Some(handover) if handover.program.name == name && is_it(handover, all_before, &which) => {
            Role::Federate(Arc::clone(handover))
        }
        Some(_) => Role::Other,
    })
}

fn is_it(handover: &Handover, all_before: usize, which: &Which) -> bool {
    handover.which.as_ref().map_or(all_before == 0, |handed| handed == which)
}

/// Counts one more of that name. Returns how many there were before, and which one it is.
fn count(name: &str, at: &Location<'_>) -> Result<(usize, Which), Box<Report>> {
    let (site, current) = (at.to_string(), thread::current());
    let thread = current.name().map(str::to_owned);
    let mut assembled = ASSEMBLED.lock().unwrap_or_else(PoisonError::into_inner);
    let assembled = assembled.entry(name.to_owned()).or_default();
    let (before, first) = assembled.each.entry((site.clone(), thread.clone())).or_default();
    if *first.get_or_insert(current.id()) != current.id() {
        return Err(Box::new(ambiguous(name, &site)));
    }
    let which = Which { site, thread, before: *before };
    *before += 1;
    assembled.all += 1;
    Ok((assembled.all - 1, which))
}

fn ambiguous(name: &str, site: &str) -> Report {
    let what = format!(
        "two threads assemble a federation with the name {name} at {site}, so a federate cannot tell which of them it \
         belongs to"
    );
    Report::new(Kind::Program, what).hint(
        "give each federation a name of its own, or each thread (`std::thread::Builder::name`)",
    )
}
