//! How far each federate may advance.
//!
//! The same computation serves both coordinations. Its input are the reports of centralized federates
//! about every tag, or the occasional reports of decentralized federates. From its output the RTI makes
//! a grant, or tells a federate that it need not wait for messages. Downstream next event tags are in
//! `dnet`, and what follows from the graph for them in `waiting`.

mod dnet;
mod holds;
mod waiting;

use std::collections::BTreeSet;

use hprm_core::{FederateId, Table, Tag};

use self::dnet::Dnet;
pub use self::dnet::DnetMode;
use crate::earliest::Earliest;
use crate::{Step, Topology};

/// A message that the RTI has forwarded to a federate, which has not completed its tag.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
struct InTransit {
    /// The step at which the federate reads it.
    step: Step,
    /// Its number among all messages that the RTI has forwarded to the federate.
    number: u64,
}

/// Whether a federate still has something to do.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
struct Activity {
    /// At any tag.
    ever: bool,
    /// At a tag before the program's timeout.
    before_timeout: bool,
}

/// How many federates still have something to do.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
struct ActiveFederates {
    /// At any tag.
    ever: usize,
    /// At a tag before the program's timeout.
    before_timeout: usize,
}

/// What the RTI knows of one federate.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
struct Report {
    /// The next event that the federate has reported since it last completed a tag; else `NEVER`.
    next: Step,
    /// The latest tag that the federate has completed.
    completed: Tag,
    /// Messages that the federate's reports may not know of yet.
    in_transit: BTreeSet<InTransit>,
    /// How many messages the RTI has forwarded to the federate.
    forwarded: u64,
    /// How far the RTI lets the federate advance: its latest grant.
    granted: Step,
    /// Whether the federate goes through tags level by level; otherwise it wants a tag as a whole.
    stepwise: bool,
    /// The latest tag that earlier processes of this federate have completed.
    past: Tag,
    /// The tags between which the federate takes part: it may join late, and leave before the others.
    first: Tag,
    last: Tag,
    /// What [`Advance::active`] counts the federate as.
    active: Activity,
}

/// See the module.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(super) struct Advance {
    earliest: Earliest,
    reports: Table<FederateId, Report>,
    /// The last tag of the program: as the program states it, or as the federates have agreed.
    stop: Tag,
    /// Federates for which something may have changed since the last call of [`Advance::grants`].
    touched: BTreeSet<FederateId>,
    /// The earliest tag that the RTI will grant when it is due.
    due: Option<Tag>,
    dnet: Dnet,
    active: ActiveFederates,
}

impl Report {
    fn new(topology: &Topology, federate: FederateId, first: Tag) -> Self {
        Self {
            next: Step::NEVER,
            completed: Tag::NEVER,
            past: Tag::NEVER,
            in_transit: BTreeSet::new(),
            forwarded: 0,
            granted: Step::NEVER,
            stepwise: topology.is_stepwise(federate),
            first,
            last: Tag::FOREVER,
            active: Activity { ever: true, before_timeout: true },
        }
    }

    /// The federate's last tag. A federate that has passed the tag at which it must leave, leaves at its
    /// next tag; one that has not begun yet leaves at its first tag.
    fn last(&self, stop: Tag) -> Tag {
        self.last.max(self.completed.succ()).max(self.first).min(stop)
    }

    /// The federate does nothing before this step, unless further messages arrive; the program ends at
    /// `stop`.
    fn own(&self, stop: Tag) -> Step {
        let reported = self.next.max(Step::begin(self.completed.succ().max(self.first)));
        // Whatever else the federate does, it processes its last tag, and all levels of it: a reaction
        // to shutdown may come before the level at which a message for that tag is read.
        let last = self.last(stop);
        let reported = if reported.tag > last { Step::begin(last) } else { reported };
        self.in_transit.first().map_or(reported, |message| reported.min(message.step))
    }

    /// What the federate wants to process next, the last tag after all others; `FOREVER` if the RTI does
    /// not know that.
    fn wanted(&self, stop: Tag) -> Step {
        let last = self.last(stop);
        let reported = match self.next {
            Step::NEVER => Step::FOREVER,
            next if next.tag > last => Step::begin(last),
            next => next,
        };
        let next = self.in_transit.first().map_or(reported, |message| reported.min(message.step));
        if self.stepwise { next } else { Step::end(next.tag) }
    }
}

impl Advance {
    pub(super) fn new(topology: &Topology) -> Self {
        let report = |federate| Report::new(topology, federate, Tag::START);
        let all = topology.federates().count();
        Self {
            earliest: Earliest::new(topology),
            reports: topology.federates().map(report).collect(),
            stop: topology.timeout(),
            touched: BTreeSet::new(),
            due: None,
            dnet: Dnet::new(topology, DnetMode::Usual),
            active: ActiveFederates { ever: all, before_timeout: all },
        }
    }

    /// Sends downstream next event tags at other times.
    pub(super) fn set_dnet_mode(&mut self, topology: &Topology, mode: DnetMode) {
        self.dnet = Dnet::new(topology, mode);
    }

    /// The earliest last tag of the program, if all federates are idle until its `timeout`: each has
    /// reported so, or has ended. If they do nothing even at the timeout, they can end at once.
    pub(super) fn idle_stop(&self) -> Option<Tag> {
        match self.active {
            ActiveFederates { ever: 0, .. } => Some(Tag::START),
            ActiveFederates { before_timeout: 0, .. } => Some(Tag::FOREVER),
            _ => None,
        }
    }

    /// Counts a federate again: its next event, as far as the RTI knows, may be another one.
    fn recount(&mut self, topology: &Topology, federate: FederateId) {
        let report = &mut self.reports[federate];
        let next =
            report.in_transit.first().map_or(report.next, |first| report.next.min(first.step)).tag;
        let ended = self.earliest.has_ended(federate);
        let is = Activity {
            ever: !ended && next < Tag::FOREVER,
            before_timeout: !ended && next < topology.timeout(),
        };
        let was = std::mem::replace(&mut report.active, is);
        let ActiveFederates { ever, before_timeout } = &mut self.active;
        *ever = *ever + usize::from(is.ever) - usize::from(was.ever);
        *before_timeout =
            *before_timeout + usize::from(is.before_timeout) - usize::from(was.before_timeout);
    }

    /// How far the RTI lets a federate advance: its latest grant.
    pub(super) fn granted(&self, federate: FederateId) -> Step {
        self.reports[federate].granted
    }

    /// The tag at which a federate starts, or has started.
    pub(super) fn first(&self, federate: FederateId) -> Tag {
        self.reports[federate].first
    }

    /// The least tag from which on a federate may do something unexpected: join, or leave. No federate
    /// that this concerns has a grant beyond that tag, and the federate itself has done nothing there.
    pub(super) fn entry(&self, topology: &Topology, federate: FederateId) -> Tag {
        let granted = topology.reachable(federate).into_iter().filter(|other| *other != federate);
        // One that has joined again has no grant yet, but its predecessor has processed tags. One that has read boards
        // never had a grant, and what it has completed is known once it has left.
        let granted = granted.map(|other| {
            let Report { granted, past, completed, .. } = self.reports[other];
            granted.tag.max(past).max(completed).succ()
        });
        let completed = self.reports[federate].completed;
        let own = match self.earliest.has_ended(federate) {
            // At a later time than its predecessor: delayed messages of both keep their order.
            true if completed > Tag::NEVER => Tag::new(completed.time.saturating_add(1), 0),
            _ => completed.succ(),
        };
        // Processes that have ended did not know of the federate, and have sent it nothing.
        let upstream = topology.upstream(federate).iter().map(|edge| edge.federate);
        let gone = upstream.map(|sender| {
            let Report { completed, past, .. } = self.reports[sender];
            if self.earliest.has_ended(sender) { past.max(completed).succ() } else { past.succ() }
        });
        granted.chain(gone).chain([own, Tag::START]).max().unwrap_or(Tag::START)
    }

    /// A federate joins that has ended, or that had not joined before.
    pub(super) fn join(&mut self, topology: &Topology, federate: FederateId, first: Tag) {
        let Report { forwarded, active, past, completed, .. } = self.reports[federate];
        let past = past.max(completed);
        self.reports[federate] =
            Report { forwarded, active, past, ..Report::new(topology, federate, first) };
        self.earliest.revive(federate);
        self.refresh(topology, federate);
    }

    /// At which tag a federate has been told to leave, if it has.
    pub(super) fn told_to_leave(&self, federate: FederateId) -> Option<Tag> {
        Some(self.reports[federate].last).filter(|last| *last < Tag::FOREVER)
    }

    /// A federate ends at `last`, unless it has passed that tag.
    pub(super) fn depart(&mut self, topology: &Topology, federate: FederateId, last: Tag) {
        self.reports[federate].last = last;
        self.refresh(topology, federate);
    }

    /// The RTI has forwarded a message to a federate that will discard it, or that has not started.
    pub(super) fn forwarded(&mut self, federate: FederateId) {
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
            report.in_transit.retain(|message| message.number > received);
        }
        self.refresh(topology, federate);
    }

    /// A federate has ended after `tag`.
    pub(super) fn left(&mut self, federate: FederateId, tag: Tag) {
        let report = &mut self.reports[federate];
        report.completed = report.completed.max(tag);
    }

    /// What a federate has reported counts no more: it reports again.
    pub(super) fn forget_report(&mut self, topology: &Topology, federate: FederateId) {
        self.reports[federate].next = Step::NEVER;
        self.refresh(topology, federate);
    }

    /// A federate has completed the last tag of the program.
    pub(super) fn completed_all(&mut self, federate: FederateId) {
        self.left(federate, self.stop);
    }

    /// A federate has completed `tag`.
    pub(super) fn complete(&mut self, topology: &Topology, federate: FederateId, tag: Tag) {
        let report = &mut self.reports[federate];
        report.completed = report.completed.max(tag);
        // A message may have made the federate do something earlier than it had reported, and the RTI
        // does not know yet what that has led to.
        report.next = Step::NEVER;
        while report.in_transit.first().is_some_and(|message| message.step.tag <= tag) {
            report.in_transit.pop_first();
        }
        self.refresh(topology, federate);
    }

    /// The RTI has forwarded a message to a federate, which reads it at `step`.
    pub(super) fn forwarded_at(&mut self, topology: &Topology, federate: FederateId, step: Step) {
        let report = &mut self.reports[federate];
        report.forwarded += 1;
        report.in_transit.insert(InTransit { step, number: report.forwarded });
        self.refresh(topology, federate);
    }

    /// A federate has ended: it sends nothing more.
    pub(super) fn end(&mut self, topology: &Topology, federate: FederateId) {
        let report = &mut self.reports[federate];
        report.in_transit.clear();
        report.forwarded = 0;
        let touched = self.earliest.end(topology, federate);
        self.touched.extend(touched);
        self.recount(topology, federate);
    }

    /// The program ends at `tag`. A federate that had nothing to do until later does something at that
    /// tag, so a grant beyond it was too large.
    pub(super) fn stop_at(&mut self, topology: &Topology, tag: Tag) {
        self.stop = self.stop.min(tag);
        self.dnet.cancel_all(topology);
        for federate in topology.federates() {
            let granted = &mut self.reports[federate].granted;
            *granted = (*granted).min(Step::end(self.stop.pred()));
            self.refresh(topology, federate);
        }
    }

    /// Which federates may advance how far, where that is new and lets a federate process the tag that
    /// it wants.
    ///
    /// A transient federate joins as soon as the federates downstream of it have used up their grants.
    /// So these get grants for the tag that they want and no more, and not before it is due: `elapsed`
    /// is the last tag that is due.
    pub(super) fn grants(&mut self, topology: &Topology, elapsed: Tag) -> Vec<(FederateId, Step)> {
        let mut grants = Vec::new();
        self.due = None;
        for federate in std::mem::take(&mut self.touched) {
            let through = self.earliest.arrival(federate).pred();
            let report = &mut self.reports[federate];
            let wanted = report.wanted(self.stop);
            let depends = !topology.upstream(federate).is_empty();
            if !depends || wanted.tag == Tag::FOREVER || wanted <= report.granted {
                continue;
            }
            if wanted > through {
                self.dnet.block(federate, wanted.tag);
                continue;
            }
            let after_transient = topology.is_after_transient(federate);
            if after_transient && wanted.tag > elapsed {
                self.due = Some(self.due.map_or(wanted.tag, |due| due.min(wanted.tag)));
                self.touched.insert(federate);
                continue;
            }
            report.granted = if after_transient { wanted } else { through };
            self.dnet.granted(federate);
            grants.push((federate, report.granted));
        }
        grants
    }

    /// The tag at which [`Self::grants`] has more grants, when it is due.
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
