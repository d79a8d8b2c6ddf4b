//! How a federation forms: which federates may join, and when tag zero is.

use hprm_core::{FederateId, Nanos, PhysicalTime, Tag};

use super::{LinkId, Phase, Rti, RtiOutput};
use crate::boards::Reading;
use crate::frame::{addresses_in, is_reached_through_agent};
use crate::{Fault, Frame, HostId, Missing, PROTOCOL, Peer, Refusal, boards};

/// How many federates with other programs are compared at a time. The RTI refuses further ones without
/// details.
const MOST_CANDIDATES: usize = 64;

/// A federate whose program is to be compared.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(super) struct Candidate {
    peer: Peer,
    launched: bool,
    /// Whether the federate has loaded its program meanwhile.
    loaded: bool,
}

/// What the RTI knows of a federate.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(super) enum Member {
    /// The federate has not joined yet.
    Absent,
    /// The federate has a link, and `ready` is the time at which it became ready, if it is.
    Live {
        link: LinkId,
        life: u32,
        host: HostId,
        listen: Option<String>,
        launched: bool,
        ready: Option<PhysicalTime>,
    },
    /// The federate has ended.
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
    /// The first frame on a link. A process that is no member learns nothing about the program.
    pub(super) fn hello(&mut self, link: LinkId, frame: Frame) -> Result<(), Fault> {
        let Frame::Hello {
            protocol,
            federation,
            fingerprint,
            federate,
            host,
            listen,
            attempt,
            launched,
        } = frame
        else {
            return Err(Fault::UnknownLink);
        };
        let name = self.topology.name(federate);
        if protocol != PROTOCOL {
            self.refuse(link, name, Refusal::WrongProtocol);
        } else if federation != self.federation {
            self.refuse(link, name, Refusal::WrongFederation);
        } else if self.is_latest_attempt(link, attempt) {
            self.attempts.add(link, attempt);
            let peer = Peer { federate, incarnation: link.0, life: 0, host, listen };
            match fingerprint == self.fingerprint.digest() {
                true => self.admit(link, peer, launched),
                false => self.compare(link, peer, launched),
            }
        }
        Ok(())
    }

    /// A federate with the same program.
    fn admit(&mut self, link: LinkId, peer: Peer, launched: bool) {
        let federate = peer.federate;
        if let Some(reason) = self.refusal(federate, launched) {
            self.refuse(link, self.topology.name(federate), reason);
            return;
        }
        self.links.insert(link, federate);
        self.lives[federate] = self.lives[federate].saturating_add(1);
        let peer = Peer { life: self.lives[federate], ..peer };
        self.outputs.push_back(RtiOutput::Joined { federate, link, launched });
        if self.phase == Phase::Joining {
            let Peer { life, host, listen, .. } = peer;
            self.members[federate] =
                Member::Live { link, life, host, listen, launched, ready: None };
            self.left_early.remove(&federate);
            self.load_together();
        } else {
            self.arrivals.add(link, peer, launched);
        }
    }

    /// Asks a federate with another program for its facts, to compare them.
    fn compare(&mut self, link: LinkId, peer: Peer, launched: bool) {
        if self.candidates.len() >= MOST_CANDIDATES {
            let reason = Refusal::WrongProgram { differences: Vec::new() };
            self.refuse(link, self.topology.name(peer.federate), reason);
            return;
        }
        self.candidates.insert(link, Candidate { peer, launched, loaded: false });
        self.outputs.push_back(RtiOutput::ProgramRequested { link });
        self.outputs.push_back(RtiOutput::Send { link, frame: Frame::ProgramRequest });
    }

    /// A frame from a federate that has been asked for its program.
    pub(super) fn candidate_frame(&mut self, link: LinkId, frame: Frame) -> Result<(), Fault> {
        let Some(candidate) = self.candidates.get_mut(&link) else {
            return Err(Fault::UnknownLink);
        };
        match frame {
            Frame::Loaded => candidate.loaded = true,
            // The process is no member yet, and leaves by itself.
            Frame::Failed { .. } | Frame::Leave { .. } => drop(self.candidates.remove(&link)),
            Frame::ProgramReply { name, facts } => {
                let other = format!("federate {name}");
                let differences = self.fingerprint.differences("the RTI", &facts, &other);
                let Some(Candidate { peer, launched, loaded }) = self.candidates.remove(&link)
                else {
                    return Err(Fault::UnknownLink);
                };
                if !differences.is_empty() {
                    self.refuse(link, name, Refusal::WrongProgram { differences });
                    return Ok(());
                }
                let federate = peer.federate;
                self.admit(link, peer, launched);
                if loaded && self.arrivals.is_link_of(federate, link) {
                    return self.arrival_frame(federate, Frame::Loaded);
                }
            }
            _ => return Err(Fault::Unexpected { frame: frame.name() }),
        }
        Ok(())
    }

    pub(super) fn refuse(&mut self, link: LinkId, name: String, reason: Refusal) {
        self.send_refusal(link, reason.clone());
        self.outputs.push_back(RtiOutput::Refused { name, reason });
    }

    /// Tells a process why it does not belong to the federation, and closes its link.
    pub(super) fn send_refusal(&mut self, link: LinkId, reason: Refusal) {
        self.links.remove(&link);
        self.attempts.remove(link);
        self.refused.insert(link);
        self.outputs.push_back(RtiOutput::Send { link, frame: Frame::Refused { reason } });
        self.outputs.push_back(RtiOutput::Close { link });
    }

    /// Makes the RTI refuse all federates if some have not joined `limit` after `now`.
    #[must_use]
    pub fn with_join_limit(mut self, now: PhysicalTime, limit: Nanos) -> Self {
        self.join_limit = Some((now.plus(limit), limit));
        self
    }

    /// Whether federates are still to join, so that the federation can start.
    pub(super) fn is_joining(&self) -> bool {
        self.phase == Phase::Joining && !self.failed
    }

    /// Refuses all federates if some have not joined in time.
    pub(super) fn apply_join_limit(&mut self, now: PhysicalTime) {
        let Some((until, limit)) = self.join_limit else { return };
        if now < until || !self.is_joining() {
            return;
        }
        let names = |has_left| -> Vec<String> {
            let members = self.members.iter();
            let missing = members.filter(|(federate, member)| {
                !member.is_live()
                    && !self.topology.is_transient(*federate)
                    && self.left_early.contains(federate) == has_left
            });
            missing.map(|(federate, _)| self.topology.name(federate)).collect()
        };
        let missing = Missing { never: names(false), left: names(true), limit };
        self.outputs.push_back(RtiOutput::Missing(missing.clone()));
        self.refuse_all(&Refusal::Missing(missing));
    }

    /// Once all federates but transient ones have joined: sends each the list of its peers. They load their
    /// programs then.
    pub(super) fn load_together(&mut self) {
        if self.phase == Phase::Joining && self.all_have_joined() {
            self.phase = Phase::Loading;
            let peers = self.peers();
            self.boards = self.may_use_boards(&peers);
            self.send_all(&Frame::Peers { peers, boards: self.boards });
        }
    }

    /// Whether the federates coordinate themselves by boards: all reach one another directly, and some share memory, so
    /// that not all that they show has to travel. A federate that joins late could not know what the others have found
    /// on boards.
    fn may_use_boards(&self, peers: &[Peer]) -> bool {
        let one_host = peers.windows(2).all(|pair| pair[0].host == pair[1].host);
        let host = |federate| peers.iter().find(|it| it.federate == federate).map(|it| it.host);
        let share = |it: &Reading| host(it.owner) == host(it.reader);
        let pays = || one_host || boards::readings(&self.topology).iter().any(share);
        let accepts = |listen: &String| match one_host {
            true => addresses_in(listen).next().is_some(),
            false => is_reached_through_agent(listen),
        };
        let all_listen = peers.iter().all(|peer| peer.listen.as_ref().is_some_and(accepts));
        self.allows_boards && self.has_use_for_boards() && all_listen && pays()
    }

    /// Whether boards are of use to the program.
    pub(super) fn has_use_for_boards(&self) -> bool {
        let few = self.topology.federates().count() <= boards::FEDERATES;
        few && self.topology.coordination() == hprm_core::Coordination::Centralized
    }

    fn all_have_joined(&self) -> bool {
        let mut members = self.members.iter();
        members.all(|(federate, member)| member.is_live() || self.topology.is_transient(federate))
    }

    /// Why a federate with the same program may not join.
    fn refusal(&self, federate: FederateId, launched: bool) -> Option<Refusal> {
        if !self.topology.has(federate) {
            return Some(Refusal::UnknownFederate);
        }
        if self.topology.is_transient(federate) && self.phase != Phase::Joining {
            return self.late_refusal(federate, launched);
        }
        if self.failed || self.phase == Phase::Running {
            return Some(Refusal::TooLate);
        }
        (self.members[federate] != Member::Absent).then_some(Refusal::Duplicate)
    }

    pub(super) fn peers(&self) -> Vec<Peer> {
        let members = self.members.iter();
        members
            .filter_map(|(federate, member)| match member {
                Member::Live { link, life, host, listen, .. } => {
                    let (incarnation, host, listen) = (link.0, *host, listen.clone());
                    Some(Peer { federate, incarnation, life: *life, host, listen })
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
        self.outputs.push_back(RtiOutput::Loaded { federate: from });
        self.start_together();
        Ok(())
    }

    /// Starts the program, once all federates that have joined are ready.
    pub(super) fn start_together(&mut self) {
        if self.phase != Phase::Loading || !self.all_have_joined() {
            return;
        }
        let readings = self.members.values().filter_map(|member| match member {
            Member::Live { ready, .. } => Some(*ready),
            Member::Absent | Member::Gone => None,
        });
        // None, if a federate is not ready.
        let Some(readings) = readings.collect::<Option<Vec<_>>>() else {
            return;
        };
        let Some(latest) = readings.into_iter().max() else { return };
        let at = self.topology.start_time(latest.plus(self.start_delay));
        self.phase = Phase::Running;
        self.restart_silence(at);
        if self.topology.has_transients() {
            self.start = at;
        }
        self.send_all(&Frame::Start { at, first: Tag::START });
        self.outputs.push_back(RtiOutput::Started { at });
        let absent = self.members.iter().filter(|(_, member)| !member.is_live());
        for (federate, _) in absent {
            self.advance.end(&self.topology, federate);
            self.traffic.end(&self.topology, federate, true);
        }
        self.admit_arrivals();
    }
}
