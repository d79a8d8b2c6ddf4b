//! How far each federate may advance.
//!
//! The same computation serves both coordinations: what it is fed are the reports of centralized
//! federates about every tag, or the occasional ones of decentralized federates; what comes out
//! becomes a grant, or the news that nothing is to be waited for.

mod needs;

use std::collections::BTreeSet;

use hprm_core::{FederateId, Table, Tag};

use self::needs::Needs;
pub use self::needs::Quieting;
use crate::earliest::Earliest;
use crate::{Step, Topology};

#[derive(Clone, PartialEq, Eq, Hash, Debug)]
struct Report {
    /// The next event that it has reported since it last completed a tag; else `NEVER`.
    next: Step,
    /// The latest tag that it completed.
    completed: Tag,
    /// Messages that were forwarded to it and are not completed, with their numbers: its reports
    /// may not know of them yet.
    in_transit: BTreeSet<(Step, u64)>,
    /// How many messages were forwarded to it.
    forwarded: u64,
    /// How far it has been told that it may advance.
    told: Step,
    /// Whether it goes through tags level by level; otherwise it wants a tag as a whole.
    stepwise: bool,
    /// The latest tag that processes have completed that were this federate before.
    past: Tag,
    /// The tags between which it takes part: it may join late, and leave before the others.
    first: Tag,
    last: Tag,
    /// What [`Advance::restless`] counts it as.
    restless: (bool, bool),
}

/// See the module.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(super) struct Advance {
    earliest: Earliest,
    reports: Table<FederateId, Report>,
    /// The last tag of the program: as it states it, or as it is agreed.
    stop: Tag,
    /// Federates for whom something may have changed since the last news.
    touched: BTreeSet<FederateId>,
    /// The earliest tag that will be granted when it is due.
    due: Option<Tag>,
    needs: Needs,
    /// How many federates will do something, and how many will do something before the program's
    /// timeout.
    restless: (usize, usize),
}

impl Report {
    fn new(topology: &Topology, federate: FederateId, first: Tag) -> Self {
        Self {
            next: Step::NEVER,
            completed: Tag::NEVER,
            past: Tag::NEVER,
            in_transit: BTreeSet::new(),
            forwarded: 0,
            told: Step::NEVER,
            stepwise: topology.is_stepwise(federate),
            first,
            last: Tag::FOREVER,
            restless: (true, true),
        }
    }

    /// Its last tag. Who was told to leave, and had come farther, leaves at its next tag; and who has
    /// not begun yet, at its first.
    fn last(&self, stop: Tag) -> Tag {
        self.last.max(self.completed.succ()).max(self.first).min(stop)
    }

    /// Nothing happens there before this step, unless further messages arrive; the program ends at
    /// `stop`.
    fn own(&self, stop: Tag) -> Step {
        let reported = self.next.max(Step::begin(self.completed.succ().max(self.first)));
        // Whatever else it does, it processes its last tag, and not only from the level on that a
        // message for that tag is read at: what reacts to the end may come before.
        let last = self.last(stop);
        let reported = if reported.tag > last { Step::begin(last) } else { reported };
        self.in_transit.first().map_or(reported, |(first, _)| reported.min(*first))
    }

    /// What it wants to process next, the last tag after all others; `FOREVER` if that is not known.
    fn wanted(&self, stop: Tag) -> Step {
        let last = self.last(stop);
        let reported = match self.next {
            Step::NEVER => Step::FOREVER,
            next if next.tag > last => Step::begin(last),
            next => next,
        };
        let next = self.in_transit.first().map_or(reported, |(first, _)| reported.min(*first));
        if self.stepwise { next } else { Step::end(next.tag) }
    }
}

impl Advance {
    pub(super) fn new(topology: &Topology) -> Self {
        let report = |federate| Report::new(topology, federate, Tag::START);
        Self {
            earliest: Earliest::new(topology),
            reports: topology.federates().map(report).collect(),
            stop: topology.timeout(),
            touched: BTreeSet::new(),
            due: None,
            needs: Needs::new(topology, Quieting::Usual),
            restless: (topology.federates().count(), topology.federates().count()),
        }
    }

    /// Tells federates at other times that they may be quiet.
    pub(super) fn set_quieting(&mut self, topology: &Topology, quieting: Quieting) {
        self.needs = Needs::new(topology, quieting);
    }

    /// The earliest last tag of the program, if no federate will do anything more before its
    /// `timeout`: each has reported so, unless it has ended. If they do nothing even then, they can
    /// end at once.
    pub(super) fn rest(&self) -> Option<Tag> {
        match self.restless {
            (0, _) => Some(Tag::START),
            (_, 0) => Some(Tag::FOREVER),
            _ => None,
        }
    }

    /// Counts a federate anew, whose next event, as far as is known, may be another one.
    fn recount(&mut self, topology: &Topology, federate: FederateId) {
        let report = &mut self.reports[federate];
        let next =
            report.in_transit.first().map_or(report.next, |(at, _)| report.next.min(*at)).tag;
        let ended = self.earliest.has_ended(federate);
        let is = (!ended && next < Tag::FOREVER, !ended && next < topology.timeout());
        let was = std::mem::replace(&mut report.restless, is);
        let (any, early) = &mut self.restless;
        *any = *any + usize::from(is.0) - usize::from(was.0);
        *early = *early + usize::from(is.1) - usize::from(was.1);
    }

    /// How far a federate has been told that it may advance.
    pub(super) fn told(&self, federate: FederateId) -> Step {
        self.reports[federate].told
    }

    /// The tag at which a federate starts, or has started.
    pub(super) fn first(&self, federate: FederateId) -> Tag {
        self.reports[federate].first
    }

    /// The least tag from which on a federate may do something unexpected: join, or leave. Nobody
    /// whom that concerns has been told more, and it has not done anything there itself.
    pub(super) fn entry(&self, topology: &Topology, federate: FederateId) -> Tag {
        let told = topology.reachable(federate).into_iter().filter(|other| *other != federate);
        let told = told.map(|other| self.reports[other].told.tag.succ());
        let completed = self.reports[federate].completed;
        let own = match self.earliest.has_ended(federate) {
            // At a later time than its predecessor's: messages of both, with a delay, keep their order.
            true if completed > Tag::NEVER => Tag::new(completed.time.saturating_add(1), 0),
            _ => completed.succ(),
        };
        // Processes that are gone have not known of it, and sent it nothing.
        let upstream = topology.upstream(federate).iter().map(|edge| edge.federate);
        let gone = upstream.map(|sender| {
            let Report { completed, past, .. } = self.reports[sender];
            if self.earliest.has_ended(sender) { past.max(completed).succ() } else { past.succ() }
        });
        told.chain(gone).chain([own, Tag::START]).max().unwrap_or(Tag::START)
    }

    /// A federate joins that has ended, or was not there.
    pub(super) fn join(&mut self, topology: &Topology, federate: FederateId, first: Tag) {
        let Report { forwarded, restless, past, completed, .. } = self.reports[federate];
        let past = past.max(completed);
        self.reports[federate] =
            Report { forwarded, restless, past, ..Report::new(topology, federate, first) };
        self.earliest.revive(federate);
        self.refresh(topology, federate);
    }

    /// A federate ends at `last`, unless it has come farther.
    pub(super) fn depart(&mut self, topology: &Topology, federate: FederateId, last: Tag) {
        self.reports[federate].last = last;
        self.refresh(topology, federate);
    }

    /// A message is on its way to a federate that will have no use for it, or that has not started.
    pub(super) fn count(&mut self, federate: FederateId) {
        self.reports[federate].forwarded += 1;
    }

    /// A federate's next event, unless a further message arrives than the first `received`, is at
    /// `step`.
    pub(super) fn next(
        &mut self,
        topology: &Topology,
        federate: FederateId,
        step: Step,
        received: u64,
    ) {
        let report = &mut self.reports[federate];
        report.next = step;
        if report.stepwise {
            report.in_transit.retain(|(_, number)| *number > received);
        }
        self.refresh(topology, federate);
    }

    /// A federate has ended after `tag`.
    pub(super) fn left(&mut self, federate: FederateId, tag: Tag) {
        let report = &mut self.reports[federate];
        report.completed = report.completed.max(tag);
    }

    /// A federate has completed `tag`.
    pub(super) fn complete(&mut self, topology: &Topology, federate: FederateId, tag: Tag) {
        let report = &mut self.reports[federate];
        report.completed = report.completed.max(tag);
        // A message may have made it do something earlier than it had reported, and what that has
        // led to is not known yet.
        report.next = Step::NEVER;
        while report.in_transit.first().is_some_and(|(message, _)| message.tag <= tag) {
            report.in_transit.pop_first();
        }
        self.refresh(topology, federate);
    }

    /// A message is on its way to a federate, to be read at `step`.
    pub(super) fn in_transit(&mut self, topology: &Topology, federate: FederateId, step: Step) {
        let report = &mut self.reports[federate];
        report.forwarded += 1;
        report.in_transit.insert((step, report.forwarded));
        self.refresh(topology, federate);
    }

    /// A federate has ended: nothing more comes from there.
    pub(super) fn end(&mut self, topology: &Topology, federate: FederateId) {
        let report = &mut self.reports[federate];
        report.in_transit.clear();
        report.forwarded = 0;
        let touched = self.earliest.end(topology, federate);
        self.touched.extend(touched);
        self.recount(topology, federate);
    }

    /// The program ends at `tag`. Who counted on doing nothing for longer will do something then,
    /// so whoever was told more than that was told too much.
    pub(super) fn stop_at(&mut self, topology: &Topology, tag: Tag) {
        self.stop = self.stop.min(tag);
        self.hear_all(topology);
        for federate in topology.federates() {
            let told = &mut self.reports[federate].told;
            *told = (*told).min(Step::end(self.stop.pred()));
            self.refresh(topology, federate);
        }
    }

    /// Who may advance how far, where that is new and lets somebody process the tag that it wants.
    ///
    /// A transient federate joins as soon as those whom it may send something have done what they
    /// may. So they are told no more than they want, and not before it is due: `elapsed` is the
    /// last tag that is.
    pub(super) fn news(&mut self, topology: &Topology, elapsed: Tag) -> Vec<(FederateId, Step)> {
        let mut news = Vec::new();
        self.due = None;
        for federate in std::mem::take(&mut self.touched) {
            let through = self.earliest.arrival(federate).pred();
            let report = &mut self.reports[federate];
            let wanted = report.wanted(self.stop);
            let depends = !topology.upstream(federate).is_empty();
            if !depends || wanted.tag == Tag::FOREVER || wanted <= report.told {
                continue;
            }
            if wanted > through {
                self.needs.lacks(federate, wanted.tag);
                continue;
            }
            let expects = topology.is_after_transient(federate);
            if expects && wanted.tag > elapsed {
                self.due = Some(self.due.map_or(wanted.tag, |due| due.min(wanted.tag)));
                self.touched.insert(federate);
                continue;
            }
            report.told = if expects { wanted } else { through };
            self.needs.granted(federate);
            news.push((federate, report.told));
        }
        news
    }

    /// When [`Self::news`] has more to tell.
    pub(super) fn next_due(&self) -> Option<Tag> {
        self.due
    }

    fn refresh(&mut self, topology: &Topology, federate: FederateId) {
        let own = self.reports[federate].own(self.stop);
        self.touched.insert(federate);
        let touched = self.earliest.set(topology, federate, own);
        self.touched.extend(touched);
        self.recount(topology, federate);
    }
}
