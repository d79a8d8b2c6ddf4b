//! How far each federate may advance.
//!
//! The same computation serves both coordinations: what it is fed are the reports of centralized
//! federates about every tag, or the occasional ones of decentralized federates; what comes out
//! becomes a grant, or the news that nothing is to be waited for.

use std::collections::BTreeSet;

use hprm_core::{FederateId, Table, Tag};

use crate::Topology;
use crate::earliest::Earliest;

#[derive(Clone, PartialEq, Eq, Hash, Debug)]
struct Report {
    /// The next event that it has reported since it last completed a tag; else `NEVER`.
    next: Tag,
    /// The latest tag that it completed.
    completed: Tag,
    /// Tags of messages that were forwarded to it and are not completed: its reports may not
    /// know of them yet.
    in_transit: BTreeSet<Tag>,
    /// How far it has been told that it may advance.
    told: Tag,
}

/// See the module.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(super) struct Advance {
    earliest: Earliest,
    reports: Table<FederateId, Report>,
    /// The last tag of the program, once it is agreed.
    stop: Tag,
    /// Federates for whom something may have changed since the last news.
    touched: BTreeSet<FederateId>,
}

impl Report {
    /// Nothing happens there before this tag, unless further messages arrive.
    fn own(&self) -> Tag {
        let reported = self.next.max(self.completed.succ()).max(Tag::START);
        self.in_transit.first().map_or(reported, |first| reported.min(*first))
    }

    /// The tag that it wants to process next; `FOREVER` if that is not known.
    fn wanted(&self) -> Tag {
        let reported = if self.next > Tag::NEVER { self.next } else { Tag::FOREVER };
        self.in_transit.first().map_or(reported, |first| reported.min(*first))
    }
}

impl Advance {
    pub(super) fn new(topology: &Topology) -> Self {
        let report = Report {
            next: Tag::NEVER,
            completed: Tag::NEVER,
            in_transit: BTreeSet::new(),
            told: Tag::NEVER,
        };
        Self {
            earliest: Earliest::new(topology),
            reports: topology.federates().map(|_| report.clone()).collect(),
            stop: Tag::FOREVER,
            touched: BTreeSet::new(),
        }
    }

    /// How far a federate has been told that it may advance.
    pub(super) fn told(&self, federate: FederateId) -> Tag {
        self.reports[federate].told
    }

    /// A federate's next event, unless a message arrives, is at `tag`.
    pub(super) fn next(&mut self, topology: &Topology, federate: FederateId, tag: Tag) {
        self.reports[federate].next = tag;
        self.refresh(topology, federate);
    }

    /// A federate has completed `tag`.
    pub(super) fn complete(&mut self, topology: &Topology, federate: FederateId, tag: Tag) {
        let report = &mut self.reports[federate];
        report.completed = report.completed.max(tag);
        // A message may have made it do something earlier than it had reported, and what that has
        // led to is not known yet.
        report.next = Tag::NEVER;
        while report.in_transit.first().is_some_and(|message| *message <= tag) {
            report.in_transit.pop_first();
        }
        self.refresh(topology, federate);
    }

    /// A message for `tag` is on its way to a federate.
    pub(super) fn in_transit(&mut self, topology: &Topology, federate: FederateId, tag: Tag) {
        self.reports[federate].in_transit.insert(tag);
        self.refresh(topology, federate);
    }

    /// A federate has ended: nothing more comes from there.
    pub(super) fn end(&mut self, topology: &Topology, federate: FederateId) {
        let touched = self.earliest.end(topology, federate);
        self.touched.extend(touched);
    }

    /// The program ends at `tag`. Who counted on doing nothing for longer will do something then,
    /// so whoever was told more than that was told too much.
    pub(super) fn stop_at(&mut self, topology: &Topology, tag: Tag) {
        self.stop = self.stop.min(tag);
        for federate in topology.federates() {
            let told = &mut self.reports[federate].told;
            *told = (*told).min(self.stop.pred());
            self.refresh(topology, federate);
        }
    }

    /// Who may advance how far, where that is new and lets somebody process the tag that it wants.
    pub(super) fn news(&mut self, topology: &Topology) -> Vec<(FederateId, Tag)> {
        let mut news = Vec::new();
        for federate in std::mem::take(&mut self.touched) {
            let through = self.earliest.arrival(federate).pred();
            let report = &mut self.reports[federate];
            let wanted = report.wanted();
            let depends = !topology.upstream(federate).is_empty();
            if depends && wanted < Tag::FOREVER && wanted > report.told && wanted <= through {
                report.told = through;
                news.push((federate, through));
            }
        }
        news
    }

    fn refresh(&mut self, topology: &Topology, federate: FederateId) {
        let own = self.reports[federate].own().min(self.stop);
        self.touched.insert(federate);
        let touched = self.earliest.set(topology, federate, own);
        self.touched.extend(touched);
    }
}
