//! What the RTI writes to the frame log: its frames, by federate.

use std::collections::BTreeMap;
use std::sync::Arc;

use hprm_core::{FederateId, Program};
use hprm_federated::{Frame, LinkId};

use crate::Failure;
use crate::frame_log::{FrameLog, Party};
use crate::link::Network;

/// The frame log of the RTI, if there is one.
#[derive(Debug)]
pub(super) struct RtiLog {
    log: FrameLog,
    /// Which federate each link is said to be of.
    federates: BTreeMap<LinkId, FederateId>,
}

impl RtiLog {
    /// The log that the environment asks for.
    pub(super) fn open(program: &Arc<Program>, network: &Network) -> Result<Self, Failure> {
        let in_process = matches!(network, Network::Process(_));
        let log = FrameLog::of_this_process(program, Party::Rti, in_process)?;
        Ok(Self { log, federates: BTreeMap::new() })
    }

    #[inline]
    pub(super) fn received(&mut self, link: LinkId, frame: &Frame) {
        if !self.log.is_on() {
            return;
        }
        if let Frame::Hello { federate, .. } = frame {
            self.federates.insert(link, *federate);
        }
        self.log.received(self.party(link), frame);
    }

    #[inline]
    pub(super) fn sent(&mut self, link: LinkId, frame: &Frame) {
        if self.log.is_on() {
            self.log.sent(self.party(link), frame);
        }
    }

    fn party(&self, link: LinkId) -> Party {
        self.federates.get(&link).map_or(Party::Unknown, |federate| Party::Federate(*federate))
    }
}
