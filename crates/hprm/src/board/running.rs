//! The boards of the processes of this user on this machine.

use std::fs::{self, File};
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

use hprm_core::{PhysicalTime, ReactionId, Tag};
use hprm_store::{BOARD_NAME, BoardView};
use rustix::process::geteuid;

use super::{Cell, FORMAT, FederateState, Identity, Names, Role, RtiState};

/// A loop of a federation that runs on this machine, and its board.
#[derive(Debug)]
pub struct Running {
    /// Which one it is.
    pub identity: Identity,
    /// Its process, by the number that it has here.
    pub pid: u32,
    view: BoardView,
}

/// What a loop shows at a moment.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Shown {
    /// Of a federate.
    Federate(Box<FederateView>),
    /// Of an RTI.
    Rti(Box<RtiState>),
}

/// What a federate shows at a moment.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct FederateView {
    /// Its state, as it was shown last.
    pub state: FederateState,
    /// The tag that it has begun since, if it has, and when.
    pub begun: Option<(Tag, PhysicalTime)>,
    /// The reactions that have begun last in its threads, with the number of the run.
    pub reactions: Vec<(ReactionId, u32)>,
}

impl Running {
    /// Whether its board has the form that this library understands.
    #[must_use]
    pub fn is_known(&self) -> bool {
        self.identity.format == FORMAT
    }

    /// What the numbers on the board mean; none, if that is not understood.
    #[must_use]
    pub fn names(&self) -> Option<Names> {
        serde_json::from_slice(&self.view.read(Cell::Names.number())?).ok()
    }

    /// What is on the board now; none, if the loop has not shown anything yet, or it is not understood.
    #[must_use]
    pub fn shown(&self) -> Option<Shown> {
        let bytes = self.view.read(Cell::State.number()).filter(|_| self.is_known())?;
        if self.identity.role == Role::Rti {
            return Some(Shown::Rti(Box::new(postcard::from_bytes(&bytes).ok()?)));
        }
        let state: FederateState = postcard::from_bytes(&bytes).ok()?;
        let later = self.view.note().filter(|(count, _)| *count > state.notes);
        let begun = later.map(|(_, [_, time, microstep, at])| {
            let tag = Tag::new(time.cast_signed(), u32::try_from(microstep).unwrap_or(u32::MAX));
            (tag, PhysicalTime(at.cast_signed()))
        });
        let lanes = (0..self.view.lanes()).filter_map(|lane| self.view.lane(lane));
        let reactions = lanes.filter_map(|word| {
            let (run, reaction) = ((word >> 32) as u32, word as u32);
            reaction.checked_sub(1).map(|reaction| (ReactionId(reaction), run))
        });
        Some(Shown::Federate(Box::new(FederateView {
            state,
            begun,
            reactions: reactions.collect(),
        })))
    }
}

/// The federates and RTIs of this user that run on this machine, those of one federation together, its RTI first.
///
/// Programs in one process are no federations, and are not found. What ends meanwhile may be found or not; of what has
/// been found, the board can still be read when its process has ended.
///
/// # Errors
///
/// If this process cannot see others: there is no `/proc`.
pub fn running() -> io::Result<Vec<Running>> {
    let mut found = Vec::new();
    for entry in fs::read_dir("/proc")?.flatten() {
        let pid = entry.file_name().to_str().and_then(|name| name.parse().ok());
        if let Some(pid) = pid {
            found.extend(boards_of(&entry.path(), pid));
        }
    }
    found.sort_by(|one: &Running, other| {
        let key = |it: &Running| {
            let Identity { federation, id, role, since, .. } = it.identity.clone();
            (federation, id, role, since)
        };
        key(one).cmp(&key(other))
    });
    Ok(found)
}

/// The boards of a process, if it is one of this user. It may end at any moment.
fn boards_of(process: &Path, pid: u32) -> Vec<Running> {
    let is_own = fs::metadata(process).is_ok_and(|it| it.uid() == geteuid().as_raw());
    let descriptors = if is_own { fs::read_dir(process.join("fd")).ok() } else { None };
    let name = format!("/memfd:{BOARD_NAME}");
    let mut found: Vec<Running> = Vec::new();
    for descriptor in descriptors.into_iter().flatten().flatten() {
        let path = descriptor.path();
        let is_board = fs::read_link(&path)
            .is_ok_and(|target| target.to_str().is_some_and(|target| target.starts_with(&name)));
        if is_board && let Some((identity, view)) = read(&path) {
            // A forked process has the descriptors of its parent, and another watcher may have this one open.
            let is_owner = own_number(process).is_none_or(|number| number == identity.pid);
            let is_new = found.iter().all(|other| other.identity != identity);
            if is_owner && is_new {
                found.push(Running { identity, pid, view });
            }
        }
    }
    found
}

fn read(path: &Path) -> Option<(Identity, BoardView)> {
    let view = BoardView::map(&File::open(path).ok()?.into()).ok()??;
    let identity = serde_json::from_slice(&view.read(Cell::Identity.number())?).ok()?;
    Some((identity, view))
}

/// The number that a process has for itself; none, if the system does not tell.
fn own_number(process: &Path) -> Option<u32> {
    let status = fs::read_to_string(process.join("status")).ok()?;
    let numbers = status.lines().find_map(|line| line.strip_prefix("NSpid:"))?;
    numbers.split_whitespace().last()?.parse().ok()
}
