//! Reading boards, and choosing a federation among those that run.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::time::Duration;

use hprm::board::{FederateView, Names, Role, Running, Shown, running};
use hprm_core::PhysicalTime;
use rustix::process::geteuid;
use rustix::time::{ClockId, clock_gettime};

use super::federation::{
    Board, Federation, Member, Process, ProcessState, RtiMember, RunningReaction,
};
use super::words::clock;
use crate::message::Error;

/// The boards of one federation.
pub(crate) struct Boards(Vec<Running>);

impl Boards {
    /// Those of the federation that is meant: by the name of its program, by a process, or the only one.
    ///
    /// # Errors
    ///
    /// If there is no such federation, or several.
    pub(crate) fn find(wanted: Option<&str>) -> Result<Self, Error> {
        let mut groups = groups()?;
        let Some(wanted) = wanted else {
            return match groups.len() {
                0 => Err(none()),
                1 => Ok(groups.remove(0)),
                _ => Err(several(&groups, "several federations run")),
            };
        };
        let all = groups.len();
        groups.retain(|group| group.is_meant(wanted));
        match groups.len() {
            1 => Ok(groups.remove(0)),
            0 if all == 0 && wanted.parse::<u32>().is_err() => Err(none()),
            0 => Err(unknown(wanted)),
            _ => Err(several(&groups, &format!("several federations of {wanted} run"))),
        }
    }

    /// The boards of the same federation now: processes may have joined or ended.
    pub(crate) fn again(&self) -> Option<Self> {
        let id = self.id();
        groups().ok()?.into_iter().find(|group| group.id() == id)
    }

    fn id(&self) -> &str {
        &self.0[0].identity.id
    }

    fn name(&self) -> &str {
        &self.0[0].identity.federation
    }

    fn is_meant(&self, wanted: &str) -> bool {
        let pid = wanted.parse().ok();
        self.name() == wanted || self.0.iter().any(|it| Some(it.pid) == pid)
    }

    /// A line for users that have to choose.
    fn line(&self) -> String {
        let loops = &self.0;
        let rti = loops.iter().find(|it| it.identity.role == Role::Rti);
        let first = rti.unwrap_or(&loops[0]);
        let federates = loops.len() - usize::from(rti.is_some());
        let since = clock(PhysicalTime(first.identity.since));
        let name = self.name();
        format!("{name}, process {}: {federates} federates, since {since}", first.pid)
    }

    /// What is on the boards now.
    pub(crate) fn read(&self) -> Federation {
        let read_at = clock_gettime(ClockId::Monotonic);
        let names = self.0.iter().filter_map(Running::names).next().unwrap_or_default();
        let rti = self.0.iter().find(|it| it.identity.role == Role::Rti).map(rti);
        let mut boards = BTreeMap::new();
        // Of two processes of one transient federate, the one that was started last.
        for running in &self.0 {
            if let Role::Federate(name) = &running.identity.role {
                boards.insert(name.clone(), running);
            }
        }
        let known = rti.as_ref().and_then(|rti| rti.state.as_ref());
        let member = |(number, name): (usize, &String)| {
            let running = boards.get(name);
            Member {
                name: name.clone(),
                process: running.map(|running| process(running)),
                board: running.and_then(|running| board(running)),
                known: known.and_then(|state| state.members.get(number).cloned()),
            }
        };
        Federation {
            name: self.name().to_owned(),
            id: self.id().to_owned(),
            centralized: self.0[0].identity.centralized,
            members: names.federates.iter().enumerate().map(member).collect(),
            rti,
            has_foreign: self.0.iter().any(|it| !it.is_known()),
            read_at: Duration::new(
                read_at.tv_sec.unsigned_abs(),
                u32::try_from(read_at.tv_nsec).unwrap_or(0),
            ),
        }
    }
}

/// All federations of this user.
fn groups() -> Result<Vec<Boards>, Error> {
    let found = running().map_err(|error| Error::new(format!("cannot see processes: {error}")))?;
    let mut groups: Vec<Boards> = Vec::new();
    for running in found {
        match groups.iter_mut().find(|group| group.id() == running.identity.id) {
            Some(group) => group.0.push(running),
            None => groups.push(Boards(vec![running])),
        }
    }
    Ok(groups)
}

fn rti(running: &Running) -> RtiMember {
    let state = running.shown().and_then(|shown| match shown {
        Shown::Rti(state) => Some(*state),
        Shown::Federate(_) => None,
    });
    let now = state.as_ref().map_or(PhysicalTime(0), |state| state.moment.clock());
    RtiMember { process: process(running), state, now }
}

fn board(running: &Running) -> Option<Board> {
    let Some(Shown::Federate(view)) = running.shown() else { return None };
    let FederateView { state, begun, reactions } = *view;
    let names: Names = running.names().unwrap_or_default();
    let reactions = reactions.iter().filter_map(|(reaction, _)| {
        let name = names.reactions.get(&reaction.0)?;
        Some(RunningReaction { label: name.label.clone(), place: name.place.clone() })
    });
    let reactions = reactions.collect();
    Some(Board { now: state.moment.clock(), state, begun, reactions, names })
}

fn process(running: &Running) -> Process {
    let stat = fs::read_to_string(format!("/proc/{}/stat", running.pid)).unwrap_or_default();
    // The name of the program, in parentheses, may have any characters.
    let letter = stat.rsplit(')').next().and_then(|rest| rest.trim_start().chars().next());
    let state = match letter {
        Some('T' | 't') => ProcessState::Stopped,
        Some('Z' | 'X') | None => ProcessState::Ended,
        Some(_) => ProcessState::Alive,
    };
    Process { pid: running.pid, state, host: running.identity.host.clone() }
}

fn none() -> Error {
    Error::new("no federation of this user runs on this machine")
        .hint("hprm run starts one; programs in one process, and federations of other users, are not shown")
}

fn unknown(wanted: &str) -> Error {
    let owner = fs::metadata(format!("/proc/{wanted}")).map(|it| it.uid());
    match (wanted.parse::<u32>(), owner) {
        (Ok(pid), Ok(owner)) if owner != geteuid().as_raw() => {
            Error::new(format!("process {pid} belongs to another user"))
                .hint("only that user can watch its federation")
        }
        (Ok(pid), Ok(_)) => Error::new(format!("process {pid} belongs to no federation"))
            .hint("hprm top without a name shows the federation that runs"),
        (Ok(pid), Err(_)) => Error::new(format!("there is no process {pid}"))
            .hint("hprm top without a name shows the federation that runs"),
        _ => Error::new(format!("no federation {wanted} of this user runs on this machine"))
            .hint("the name is that of the program; hprm top without a name shows what runs"),
    }
}

fn several(groups: &[Boards], message: &str) -> Error {
    let lines: Vec<_> = groups.iter().map(|group| format!("\n  {}", group.line())).collect();
    let rti = groups[0].0[0].pid;
    Error::new(format!("{message}:{}", lines.concat()))
        .hint(format!("name one, or one of its processes: hprm top {rti}"))
}
