//! Processes that ask to join more than once: the RTI tells their links apart.
//!
//! A process whose link breaks before it knows the others opens another one. The RTI may learn of that in any
//! order: that the former link has ended, what came over the former link, and what comes over the new one. The
//! latest attempt of a process counts, and its former links are over. A federate that another process wants to
//! be as well is a duplicate; that is decided in `join`.

use std::collections::BTreeMap;

use super::{LinkId, Phase, Rti, RtiOutput};
use crate::Attempt;

/// The attempts of processes that want to join or have joined, by link.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Default)]
pub(super) struct Attempts(BTreeMap<LinkId, Attempt>);

impl Attempts {
    pub(super) fn add(&mut self, link: LinkId, attempt: Attempt) {
        self.0.insert(link, attempt);
    }

    pub(super) fn remove(&mut self, link: LinkId) {
        self.0.remove(&link);
    }

    /// The link over which the same process has asked to join, and its attempt.
    fn of_same_process(&self, attempt: Attempt) -> Option<(LinkId, Attempt)> {
        let mut known = self.0.iter().map(|(link, known)| (*link, *known));
        known.find(|(_, known)| known.process == attempt.process)
    }
}

impl Rti {
    /// Whether an attempt to join is the latest one of its process. If so, a former link of that process is over.
    /// If not, the process has given up the link over which the attempt has come.
    pub(super) fn is_latest_attempt(&mut self, link: LinkId, attempt: Attempt) -> bool {
        let given_up = match self.attempts.of_same_process(attempt) {
            Some((_, known)) if known.number >= attempt.number => link,
            Some((former, _)) => {
                self.end_former_link(former);
                former
            }
            None => return true,
        };
        self.refused.insert(given_up);
        self.outputs.push_back(RtiOutput::Close { link: given_up });
        given_up != link
    }

    /// The process at the other end of a link has opened another one.
    fn end_former_link(&mut self, former: LinkId) {
        match self.links.get(&former).copied() {
            // The process lives, so nothing has failed.
            Some(federate) if self.arrivals.is_link_of(federate, former) => {
                self.links.remove(&former);
                self.withdraw(federate, None);
            }
            Some(federate) if self.phase == Phase::Joining => {
                self.links.remove(&former);
                self.leaves_before_start(federate);
            }
            _ => self.closed(former, None),
        }
        self.attempts.remove(former);
        self.candidates.remove(&former);
    }
}
