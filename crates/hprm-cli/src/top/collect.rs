//! Reading boards, and choosing a federation among those that run.

use std::fs;
use std::time::Duration;

use hprm::board::{FederateView, Names, Running, RunningFederation, Shown, federations};
use hprm_core::PhysicalTime;
use rustix::time::{ClockId, clock_gettime};

use super::federation::{
    Board, Federation, Member, Process, ProcessState, RtiMember, RunningReaction,
};
use crate::message::Error;

/// The boards of one federation.
pub(crate) struct Boards(RunningFederation);

impl Boards {
    /// Those of the federation that is meant: by the name of its program, by a process, or the only one.
    ///
    /// # Errors
    ///
    /// If there is no such federation, or several.
    pub(crate) fn find(wanted: Option<&str>) -> Result<Self, Error> {
        let chosen = RunningFederation::choose(wanted);
        let chosen = chosen.map_err(|error| error.report(|pid| format!("hprm top {pid}")))?;
        Ok(Self(chosen))
    }

    /// The boards of the same federation now: processes may have joined or ended.
    pub(crate) fn again(&self) -> Option<Self> {
        federations().ok()?.into_iter().find(|it| it.id() == self.0.id()).map(Self)
    }

    /// What is on the boards now.
    pub(crate) fn read(&self) -> Federation {
        let read_at = clock_gettime(ClockId::Monotonic);
        let loops = self.0.loops();
        let names = loops.iter().filter_map(Running::names).next().unwrap_or_default();
        let rti = self.0.rti().map(rti);
        let boards = self.0.federates();
        let known = rti.as_ref().and_then(|rti| rti.state.as_ref());
        let member = |(number, name): (usize, &String)| {
            let running = boards.get(name.as_str());
            Member {
                name: name.clone(),
                process: running.map(|running| process(running)),
                board: running.and_then(|running| board(running)),
                known: known.and_then(|state| state.members.get(number).cloned()),
                restarts: known.and_then(|it| it.restarts.get(number).copied()).unwrap_or_default(),
            }
        };
        Federation {
            name: self.0.name().to_owned(),
            id: self.0.id().to_owned(),
            centralized: loops[0].identity.centralized,
            members: names.federates.iter().enumerate().map(member).collect(),
            rti,
            has_foreign: loops.iter().any(|it| !it.is_known()),
            read_at: Duration::new(
                read_at.tv_sec.unsigned_abs(),
                u32::try_from(read_at.tv_nsec).unwrap_or(0),
            ),
        }
    }
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
