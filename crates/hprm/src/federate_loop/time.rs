//! Keeps the clock of a federate at the time of the RTI, as far as the program wants that.
//!
//! `hprm_federated::ClockSync` decides what to ask and what answers mean; here are the link and the clock.

use hprm_core::{ClockSyncMode, PhysicalTime, Program};
use hprm_federated::{ClockSync, Correction, Estimate, Frame};

use super::links::FederateLinks;
use crate::Clock;

/// Compares clocks, if there is a reason to.
pub(super) struct Time {
    sync: ClockSync,
}

impl Time {
    /// Prepares the comparison. A federate on the host of the RTI has the same clock.
    pub(super) fn new(program: &Program, links: &FederateLinks) -> Self {
        let mut options = program.properties.clock_sync;
        if links.is_on_host_of_rti() && !options.local_federates {
            options.mode = ClockSyncMode::Off;
        }
        if options.mode != ClockSyncMode::Off && options.test_offset != 0 {
            Clock::disturb(options.test_offset);
        }
        Self { sync: ClockSync::new(options, Clock::local()) }
    }

    /// Whether the program may start.
    pub(super) fn is_settled(&self) -> bool {
        self.sync.is_settled()
    }

    /// Asks for the time if it is time for that.
    pub(super) fn ask(&mut self, links: &mut FederateLinks) {
        if self.sync.next_wakeup().is_some()
            && let Some(question) = self.sync.ask(Clock::local())
        {
            links.send_to_rti(question, None);
        }
    }

    /// Takes an answer. Returns whether it has set the clock to another time, and if so how: earlier readings of the clock
    /// must not be used then.
    pub(super) fn answered(&mut self, answer: &Frame) -> Option<Estimate> {
        let Frame::ClockReply { asked, received, sent } = *answer else { return None };
        let local = Clock::local();
        let correction = self.sync.answered(local, asked, received, sent)?;
        Clock::correct(correction);
        let is_step = matches!(correction, Correction::Step { .. });
        self.sync.estimate(local).filter(|_| is_step)
    }

    /// Whether the clock follows the RTI's after it was set.
    pub(super) fn is_kept(&self) -> bool {
        self.sync.next_wakeup().is_some()
    }

    /// When to ask next.
    pub(super) fn next_wakeup(&self) -> Option<PhysicalTime> {
        self.sync.next_wakeup().map(Clock::at)
    }
}
