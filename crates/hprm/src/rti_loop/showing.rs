//! What the RTI shows of itself on its board. Nothing here decides anything.

use std::sync::atomic::{AtomicU32, Ordering};

use hprm_core::{FederateId, PhysicalTime, Program, Table};
use hprm_federated::Rti;

use crate::Clock;
use crate::board::{BoardWriter, Identity, Moment, Names, RtiState};

/// The board of the RTI.
#[derive(Debug)]
pub(super) struct RtiShowing {
    board: BoardWriter,
    start: Option<PhysicalTime>,
}

impl RtiShowing {
    pub(super) fn new(identity: &Identity, program: &Program) -> Self {
        let size = RtiState::size(program.federates.len());
        Self { board: BoardWriter::new(identity, &Names::of_rti(program), 0, size), start: None }
    }

    /// Tag zero is at this time.
    pub(super) fn started(&mut self, at: PhysicalTime) {
        self.start = Some(at);
    }

    /// Shows what the RTI knows, as it is about to wait. If it has shown that a short time ago, it wakes up once to
    /// show it again: returns until when it may wait.
    pub(super) fn show(
        &mut self,
        machine: &Rti,
        restarts: &Table<FederateId, AtomicU32>,
        until: Option<PhysicalTime>,
    ) -> Option<PhysicalTime> {
        let Some(due) = self.board.due() else { return until };
        let now = Clock::now();
        if now < due {
            return Some(until.map_or(due, |until| until.min(due)));
        }
        let members = machine.members(now).collect();
        let (moment, phase) = (Moment::now(), machine.phase());
        let restarts = restarts.values().map(|count| count.load(Ordering::Relaxed)).collect();
        self.board.show(&RtiState { moment, phase, start: self.start, members, restarts });
        until
    }
}
