//! How a federation comes together: who may join, and when tag zero is.

use hprm_core::{FederateId, PhysicalTime};

use super::{LinkId, Phase, Rti, RtiOutput};
use crate::{Fault, Frame, HostId, PROTOCOL, Peer, Refusal};

/// What the RTI knows of a federate.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(super) enum Member {
    /// It has not joined yet.
    Absent,
    /// It has a link, and if it is ready, that was at this time.
    Live { link: LinkId, host: HostId, listen: Option<String>, ready: Option<PhysicalTime> },
    /// It has ended.
    Gone,
}

impl Member {
    pub(super) fn link(&self) -> Option<LinkId> {
        match self {
            Self::Live { link, .. } => Some(*link),
            Self::Absent | Self::Gone => None,
        }
    }

    pub(super) fn is_live(&self) -> bool {
        self.link().is_some()
    }
}

impl Rti {
    /// The first frame on a link.
    pub(super) fn hello(&mut self, link: LinkId, frame: Frame) -> Result<(), Fault> {
        let refusal = self.refusal(&frame);
        let Frame::Hello { federate, host, listen, .. } = frame else {
            return Err(Fault::UnknownLink);
        };
        if let Some(reason) = refusal {
            let frame = Frame::Refused { reason };
            self.outputs.push_back(RtiOutput::Send { link, frame });
            self.outputs.push_back(RtiOutput::Close { link });
            return Ok(());
        }
        self.links.insert(link, federate);
        self.members[federate] = Member::Live { link, host, listen, ready: None };
        self.outputs.push_back(RtiOutput::Joined { federate, link });
        if self.members.values().all(Member::is_live) {
            self.phase = Phase::Loading;
            let peers = self.peers();
            self.send_all(&Frame::Peers { peers });
        }
        Ok(())
    }

    /// Why the sender of a `Hello` may not join. A stranger learns nothing about the program.
    fn refusal(&self, frame: &Frame) -> Option<Refusal> {
        let Frame::Hello { protocol, federation, fingerprint, federate, .. } = *frame else {
            return None;
        };
        if protocol != PROTOCOL {
            return Some(Refusal::WrongProtocol);
        }
        if federation != self.federation {
            return Some(Refusal::WrongFederation);
        }
        if fingerprint != self.fingerprint {
            return Some(Refusal::WrongProgram);
        }
        if !self.topology.has(federate) {
            return Some(Refusal::UnknownFederate);
        }
        if self.failed || self.phase == Phase::Running {
            return Some(Refusal::TooLate);
        }
        (self.members[federate] != Member::Absent).then_some(Refusal::Duplicate)
    }

    fn peers(&self) -> Vec<Peer> {
        let members = self.members.iter();
        members
            .filter_map(|(federate, member)| match member {
                Member::Live { host, listen, .. } => {
                    Some(Peer { federate, host: *host, listen: listen.clone() })
                }
                Member::Absent | Member::Gone => None,
            })
            .collect()
    }

    /// A federate is ready. Once all are, they start together.
    pub(super) fn ready(&mut self, from: FederateId, now: PhysicalTime) -> Result<(), Fault> {
        match &mut self.members[from] {
            Member::Live { ready: ready @ None, .. } => *ready = Some(now),
            _ => return Err(Fault::Unexpected { frame: "Ready" }),
        }
        let readings = self.members.values().map(|member| match member {
            Member::Live { ready, .. } => *ready,
            Member::Absent | Member::Gone => None,
        });
        // None, if anybody is not ready or has gone.
        let Some(readings) = readings.collect::<Option<Vec<_>>>() else {
            return Ok(());
        };
        let latest = readings.into_iter().max().unwrap_or(now);
        let at = latest.plus(self.start_delay);
        self.phase = Phase::Running;
        self.send_all(&Frame::Start { at });
        self.outputs.push_back(RtiOutput::Started { at });
        Ok(())
    }
}
