//! Federates that come and go, as boards tell it: transient ones.
//!
//! Where there are transient federates, each process has a number, its life, and the other end of a channel counts from zero for
//! each. What was counted for a former process does not count for its successor, whichever of the two boards is read later.
//! A posting tells which process shows it, because the last one of a process may be read when its successor is known already.
//!
//! One that joins does nothing before a tag that all others have agreed to: each answers from which tag on it takes that
//! federate into account, and relies on nothing from then on that it has found without it (`federate/meeting.rs`).
//!
//! One that leaves shows that it has ended, with all that it has sent. One that is killed shows nothing more, and may have sent
//! what it has not counted. So its last posting counts until all that could get something of it have read its link to
//! the end, and show that. In between, it has not ended, as far as boards tell. One of those receivers may itself have
//! joined when the killed one had ended already: its tallies show whether it got to know that one, and takes something of it.

use std::collections::BTreeSet;

use hprm_core::{ChannelId, FederateId, Table, Tag};

use super::{Boards, Line, Posting, Tally};
use crate::{Step, Topology};

/// What the tally of a channel says whose sender has died, when all has been read that came.
const ALL: u64 = u64::MAX;

/// See the module.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(super) struct Lives {
    /// The number of the process that is each federate; zero for none yet, and without transient federates.
    current: Table<FederateId, u32>,
    /// Before which tag a process does nothing, because it has joined late.
    pub(super) first: Table<FederateId, Tag>,
    /// Federates that no process is, or none that has started.
    absent: BTreeSet<FederateId>,
    /// Federates whose processes have been killed, and of which something may still be read.
    dying: BTreeSet<FederateId>,
    /// Federates that are about to join, or have, and have shown nothing yet.
    pub(super) silent: BTreeSet<FederateId>,
}

impl Lives {
    pub(super) fn new(federates: usize) -> Self {
        Self {
            current: Table::filled(federates, 0),
            first: Table::filled(federates, Tag::NEVER),
            absent: BTreeSet::new(),
            dying: BTreeSet::new(),
            silent: BTreeSet::new(),
        }
    }
}

impl Boards {
    /// A process is that federate, perhaps this one: both ends of a channel to it count from zero.
    pub(crate) fn meet(&mut self, topology: &Topology, federate: FederateId, life: u32) {
        self.lives.current[federate] = life;
        self.lives.dying.remove(&federate);
        if federate != self.me {
            let tallies = self.postings[federate].tallies.len();
            self.postings[federate] = Posting::new(tallies);
        }
        self.postings[federate].life = life;
        for at in 0..self.own.len() {
            let (channel, tally) = self.own[at];
            if self.other_end(topology, channel) == federate {
                self.postings[self.me].tallies[tally] = Tally { life, ..Tally::NONE };
                self.is_news_to_all();
            }
        }
        self.refresh(federate);
        self.refresh(self.me);
    }

    /// No process is that federate now, or none that has started.
    pub(crate) fn is_without(&mut self, federate: FederateId) {
        self.lives.absent.insert(federate);
        self.refresh(federate);
    }

    /// A process is about to join as that federate, and does nothing before.
    pub(crate) fn awaits(&mut self, federate: FederateId) {
        self.lives.silent.insert(federate);
        self.is_without(federate);
    }

    /// A process that is about to join does nothing at tags that its predecessor may have begun, of which `last` is the last one.
    pub(crate) fn follows(&mut self, federate: FederateId, last: Tag) {
        if last > Tag::NEVER {
            let first = &mut self.lives.first[federate];
            *first = last.succ().max(*first);
            self.refresh(federate);
        }
    }

    /// A federate starts late, at `first` or later.
    pub(crate) fn joins(&mut self, federate: FederateId, first: Tag) {
        self.lives.absent.remove(&federate);
        self.lives.first[federate] = first;
        // When the RTI has offered it an earlier tag before, it may have shown something already.
        let posting = &mut self.postings[federate];
        posting.next = posting.next.max(Step::begin(first));
        for at in 0..self.lines.len() {
            let Line { from, to, late, .. } = self.lines[at];
            let is_over = self.has_ended(from) || self.lives.dying.contains(&from);
            self.lines[at].late = from != federate && (late || to == federate && is_over);
        }
        self.refresh(federate);
    }

    /// This federate starts late.
    pub(crate) fn starts_at(&mut self, first: Tag) {
        self.lives.first[self.me] = first;
        self.refresh(self.me);
    }

    /// The process that is that federate has been killed.
    pub(crate) fn dies(&mut self, federate: FederateId) {
        self.lives.silent.remove(&federate);
        if !self.lives.absent.contains(&federate) {
            self.lives.dying.insert(federate);
        }
        self.refresh(federate);
    }

    /// All has been read that a federate has sent to this one before it was killed.
    pub(crate) fn has_read_all_of(&mut self, topology: &Topology, federate: FederateId) {
        for at in 0..self.own.len() {
            let (channel, tally) = self.own[at];
            let from = topology.channels().get(channel).map(|channel| channel.from);
            let own = &mut self.postings[self.me].tallies[tally];
            if from == Some(federate) && federate != self.me && own.life > 0 {
                own.messages = ALL;
                self.is_news_to_all();
            }
        }
        self.refresh(self.me);
    }

    /// What this federate shows next matters to all downstream, whether they wait for it or not.
    fn is_news_to_all(&mut self) {
        (self.unshown, self.wakes_all) = (2, 2);
    }

    /// Whether something of the last process of a federate may still be read.
    pub(crate) fn may_receive_from(&self, federate: FederateId) -> bool {
        let has_started = !self.lives.absent.contains(&federate);
        self.lives.current[federate] > 0 && has_started && self.may_read_of(federate)
    }

    /// The latest tag that the last process of a federate may have begun, as far as this federate knows, if that was killed.
    pub(crate) fn last_of(&self, federate: FederateId) -> Option<Tag> {
        let Posting { next, ended, ref tallies, .. } = self.postings[federate];
        let latest = tallies.iter().map(|tally| tally.latest).max().unwrap_or(Tag::NEVER);
        let last = if next.tag < Tag::FOREVER { next.tag.max(latest) } else { latest };
        (!ended && self.lives.current[federate] > 0).then_some(last)
    }

    /// Before which tag the process that is a federate does nothing.
    pub(crate) fn first_of(&self, federate: FederateId) -> Tag {
        self.lives.first[federate]
    }

    /// Whether a federate does nothing more, and all that it has done has been counted.
    pub(super) fn has_ended(&self, federate: FederateId) -> bool {
        self.postings[federate].ended || self.lives.absent.contains(&federate)
    }

    /// What one end of a channel has counted of the process that is at the other one now.
    pub(super) fn counted_by(&self, end: FederateId, at: usize, other: FederateId) -> Tally {
        let tally = self.postings[end].tallies[at];
        if tally.life == self.lives.current[other] { tally } else { Tally::NONE }
    }

    /// Takes those for absent that have been killed, and of which nothing more can be read.
    pub(super) fn bury(&mut self) {
        let over = self.lives.dying.iter().copied();
        let over: Vec<_> = over.filter(|it| !self.may_read_of(*it)).collect();
        for federate in over {
            self.lives.dying.remove(&federate);
            self.is_without(federate);
        }
    }

    /// Whether a receiver may not have read all that a federate has sent.
    fn may_read_of(&self, federate: FederateId) -> bool {
        let life = self.lives.current[federate];
        // What others read does not matter here; those that are woken up too early because of that wait again.
        let matters = |to| to == self.me || self.upstream.contains(&to);
        let lines = self.lines.iter().filter(|line| line.from == federate);
        let mut lines = lines.filter(|line| matters(line.to) && !self.have_not_met(**line));
        lines.any(|line| {
            let counted = self.postings[line.to].tallies[line.received];
            let has_read = counted.life == life && counted.messages == ALL;
            let is_over = self.has_ended(line.to) && !self.lives.silent.contains(&line.to)
                || self.lives.dying.contains(&line.to);
            !has_read && !is_over && !self.has_met_a_successor(*line)
        })
    }

    /// Whether the receiver of a channel has read all of the sender's process, because it has met a later one.
    pub(super) fn has_met_a_successor(&self, line: Line) -> bool {
        self.postings[line.to].tallies[line.received].life > self.lives.current[line.from]
    }

    /// Whether the receiver of a channel has joined after its sender had ended, and gets nothing of it, as its board shows.
    pub(super) fn have_not_met(&self, Line { from, to, received, late, .. }: Line) -> bool {
        let is_shown = late && !self.lives.silent.contains(&to);
        is_shown && self.postings[to].tallies[received].life < self.lives.current[from]
    }

    /// The federate at the other end of one of this federate's channels.
    fn other_end(&self, topology: &Topology, channel: ChannelId) -> FederateId {
        let Some(channel) = topology.channels().get(channel) else { return self.me };
        if channel.from == self.me { channel.to } else { channel.from }
    }
}

#[cfg(test)]
mod tests;
