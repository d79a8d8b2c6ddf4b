//! The federation that a user means, of those that run on this machine, and the connections to its federates.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use hprm::watch::{WatchError, Watcher, Watching, Wish, running};
use hprm_core::Program;

use super::target::Target;
use crate::args::Of;
use crate::message::Error;

/// How often to look whether a federation runs.
const LOOKING: Duration = Duration::from_millis(50);

/// A federate that is watched, and its name.
pub(super) type Watched = (String, Watching);

/// What a user wants to watch.
pub(super) struct Opened {
    pub(super) program: Arc<Program>,
    pub(super) target: Target,
    /// The federates that send there.
    pub(super) watched: Vec<Watched>,
}

impl Opened {
    /// Watches a port, or all connections, of the federation that is meant.
    ///
    /// # Errors
    ///
    /// If there is no such port; or if no such federation, or none of the federates that send there, can be watched
    /// in time.
    pub(super) fn new(of: &Of, port: Option<&str>, wish: Wish) -> Result<Self, Error> {
        let until = Instant::now() + of.wait.unwrap_or_default();
        loop {
            let is_late = Instant::now() >= until;
            match attempt(of, port, wish)? {
                Ok((opened, None)) => return Ok(opened),
                Ok((opened, Some(_))) if is_late && !opened.watched.is_empty() => {
                    return Ok(opened);
                }
                Ok((_, Some(missing))) | Err(missing) if is_late => return Err(missing),
                _ => thread::sleep(LOOKING),
            }
        }
    }
}

/// What has been opened, and what is missing of it; what may be there later is an error inside of the result.
type Attempt = Result<(Opened, Option<Error>), Error>;

fn attempt(of: &Of, port: Option<&str>, wish: Wish) -> Result<Attempt, Error> {
    let found =
        running().map_err(|error| Error::new(format!("cannot look into /proc: {error}")))?;
    let federates = match choose(found, of.federation.as_deref())? {
        Ok(federates) => federates,
        Err(missing) => return Ok(Err(missing)),
    };
    let program = Arc::clone(federates[0].program());
    let target = match port {
        Some(port) => Target::of(&program, port)?,
        None => Target::all(&program)?,
    };
    let (mut watched, mut failed) = (Vec::new(), None);
    // Of a transient federate that joins again, there may be two processes.
    let mut by_id: BTreeMap<_, _> = federates.into_iter().map(|it| (it.federate(), it)).collect();
    for (federate, channels) in &target.channels {
        let name = &program.federates[*federate].name;
        let watcher = by_id.remove(federate).ok_or(WatchError::NotListening);
        match watcher.and_then(|it| it.watch(channels.clone(), wish)) {
            Ok(watching) => watched.push((name.clone(), watching)),
            Err(error) => failed = Some(unwatched(&format!("federate {name}"), &error)),
        }
    }
    Ok(Ok((Opened { program, target, watched }, failed)))
}

/// The federates of the federation that is meant; or else an error, inside of the result if there may be such a
/// federation later.
fn choose(
    found: Vec<Result<Watcher, WatchError>>,
    meant: Option<&str>,
) -> Result<Result<Vec<Watcher>, Error>, Error> {
    let mut federations: BTreeMap<String, Vec<Watcher>> = BTreeMap::new();
    let mut refused = None;
    for watcher in found {
        match watcher {
            Ok(watcher) => {
                let federates = federations.entry(watcher.federation().to_owned()).or_default();
                federates.push(watcher);
            }
            Err(WatchError::Ended) => {}
            Err(error) => refused = Some(error),
        }
    }
    let is_meant = |federates: &Vec<Watcher>| match meant {
        None => true,
        Some(name) => federates.iter().any(|it| is_called(it, name)),
    };
    let mut federations: Vec<_> = federations.into_values().filter(is_meant).collect();
    match federations.len() {
        0 => Ok(Err(match refused {
            Some(error) => unwatched("a federate of this machine", &error),
            None => none(meant),
        })),
        1 => Ok(Ok(federations.swap_remove(0))),
        count => {
            let each = federations
                .iter()
                .map(|it| format!("{} ({})", it[0].program().name, it[0].processes()[0]));
            let each: Vec<_> = each.collect();
            let hint = "say which, by its name or the number of one of its processes: --of, one of";
            Err(Error::option(format!("{count} federations run on this machine"))
                .hint(format!("{hint} {}", each.join(", "))))
        }
    }
}

/// Whether a federation is called that: by its name, or by the number of a process.
fn is_called(federate: &Watcher, name: &str) -> bool {
    let is_process = |number| federate.is_process(number);
    federate.program().name == name || name.parse().is_ok_and(is_process)
}

fn none(meant: Option<&str>) -> Error {
    let said = match meant {
        None => "no federation of this user runs on this machine".to_owned(),
        Some(name) => format!("no federation {name} of this user runs on this machine"),
    };
    Error::new(said).hint("only federations have connections to watch: not programs in one process")
}

fn unwatched(what: &str, error: &WatchError) -> Error {
    let said = Error::new(format!("{what} cannot be watched: {error}"));
    match error {
        WatchError::NotListening => said.hint(
            "has it ended, or does it run on another machine? Federates are watched on the machine on which they run",
        ),
        WatchError::Silent => said.hint("wait longer for it: --wait SECONDS"),
        WatchError::OtherUser => said.hint("only its own user can watch it"),
        WatchError::Full => said.hint("end one of the processes that watch it"),
        WatchError::OtherVersion => {
            said.hint("watch it with the command of its own version of hprm")
        }
        _ => said,
    }
}
