//! Why a federate does not advance, from what its machine knows.
//!
//! This says for each condition of `Federate::permission` whether it fails, and of which federate it depends.

use std::collections::BTreeSet;

use hprm_core::{FederateId, PhysicalTime, Tag};

use super::{Coordinator, Federate};
use crate::{Blocker, Step};

impl Federate {
    /// What keeps this federate from beginning `tag`, its next one. Nothing, if it may begin: then the tag is
    /// due and [`Self::permission`] has been granted.
    #[must_use]
    pub fn blockers(&self, tag: Tag, now: PhysicalTime) -> Vec<Blocker> {
        let Some(start) = self.startup.start() else { return self.start_blockers() };
        if tag == Tag::FOREVER {
            return vec![Blocker::Events { from: self.senders() }];
        }
        let mut found = self.broken();
        let due = tag.due(start);
        if due > now {
            found.push(Blocker::Time { until: due });
        }
        match self.stop.held() {
            Some(held) if tag >= held => found.push(Blocker::Stop { tag: held }),
            _ if self.may_starve() => found.push(Blocker::Starvation),
            _ => {}
        }
        found.extend(self.flow.blockers(tag));
        match &self.coordinator {
            Coordinator::Centralized(machine) if machine.is_stepwise() => {
                found.extend(machine.blocker(Step::begin(tag)));
            }
            Coordinator::Centralized(machine) => found.extend(machine.blocker(Step::end(tag))),
            Coordinator::Decentralized(machine) => {
                // Waits that are over when the tag is due make no difference.
                found.extend(machine.begin_blockers(tag, now.max(due), start));
            }
        }
        found
    }

    /// What keeps this federate from running the reactions of a level of the current tag; without a level, from
    /// completing the tag. Nothing, if [`Self::level_permission`] has been granted.
    #[must_use]
    pub fn level_blockers(&self, level: Option<u32>, now: PhysicalTime) -> Vec<Blocker> {
        let Some(start) = self.startup.start() else { return self.start_blockers() };
        let mut found = self.broken();
        let step = self.step(level);
        match &self.coordinator {
            Coordinator::Centralized(machine) => found.extend(machine.blocker(step)),
            Coordinator::Decentralized(machine) => found.extend(machine.blockers(step, now, start)),
        }
        found
    }

    /// What is missing before the start.
    fn start_blockers(&self) -> Vec<Blocker> {
        if self.rti_link_lost {
            return vec![Blocker::RtiLink];
        }
        let mut found = Vec::new();
        if self.startup.awaits_peers() {
            found.push(Blocker::Joining);
        } else {
            found.extend(self.startup.missing_links().map(|peer| Blocker::Link { peer }));
        }
        if !self.startup.is_loaded() {
            found.push(Blocker::Loading);
        }
        if found.is_empty() {
            found.push(Blocker::Start);
        }
        found
    }

    fn broken(&self) -> Vec<Blocker> {
        self.broken_links.keys().map(|peer| Blocker::BrokenLink { peer: *peer }).collect()
    }

    /// The federates that may still send messages to this one.
    fn senders(&self) -> Vec<FederateId> {
        let channels = self.topology.channels().values();
        let senders: BTreeSet<_> =
            channels.filter(|it| it.to == self.me).map(|it| it.from).collect();
        senders.into_iter().filter(|from| *from != self.me && self.is_live(*from)).collect()
    }
}
