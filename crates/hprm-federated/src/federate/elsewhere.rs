//! Federates that need what this one shows, or show what this one needs, and share no memory with it.
//!
//! A board is memory of one machine, so between machines postings are frames. Contents may be old, each board
//! on its own (`boards`), so it does not matter that frames take their time, or that most postings are never sent. What
//! matters is that no federate waits for ever:
//!
//! - A federate tells those elsewhere upstream of it for which step it waits, and sends that again when it changes.
//! - A federate sends what it shows to one downstream that waits, as soon as messages that it causes could only
//!   arrive after that step. Until then the receiver cannot go on, whatever else it knows.
//!
//! It does not ask what others have shown, as it does before it wakes up a federate that shares memory: its view of
//! boards elsewhere may be old, and then each of two federates would leave it to the other one.
//!
//! To one to which it has sent a message, it sends its posting without being asked, once it is beyond that message: what waits for
//! the message waits for this. And a federate that gets postings for which it does not wait says so, once.

use std::cell::OnceCell;

use hprm_core::{FederateId, Tag};

use crate::boards::Boards;
use crate::{Posting, Step, Topology};

/// See the module.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(super) struct Elsewhere {
    others: Vec<Other>,
    /// What this federate shows.
    shown: Option<Posting>,
    /// Through which step it must know its inputs; `NEVER` if it knows enough.
    waits: Step,
}

/// A federate elsewhere.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
struct Other {
    federate: FederateId,
    /// Whether something leads from this federate to it.
    follows: bool,
    /// Whether something leads from it to this federate.
    leads: bool,
    /// Whether it has been sent what is shown now.
    told: bool,
    /// The tag of the latest message to it, unless a posting has been sent since that is beyond that tag.
    owed: Tag,
    /// For which step this federate waits, as it has been told.
    asked: Step,
    /// Whether it has sent a posting for which this federate did not wait.
    unasked: bool,
    /// Whether it needs what is shown next, although it does not wait.
    is_urgent: bool,
}

impl Elsewhere {
    /// A federate that knows of no other one.
    pub(super) fn new() -> Self {
        Self { others: Vec::new(), shown: None, waits: Step::NEVER }
    }

    /// A process is that federate now, shares no memory with `me`, and knows nothing. It counts if one of the two matters to the
    /// other.
    pub(super) fn meet(&mut self, topology: &Topology, me: FederateId, federate: FederateId) {
        self.forget(federate);
        let leads_to = |from, to: FederateId| topology.reachable(from).contains(&to);
        let other = Other {
            federate,
            follows: leads_to(me, federate),
            leads: leads_to(federate, me),
            told: false,
            owed: Tag::NEVER,
            asked: Step::NEVER,
            unasked: false,
            is_urgent: false,
        };
        if other.follows || other.leads {
            self.others.push(other);
        }
    }

    /// No process elsewhere is that federate.
    pub(super) fn forget(&mut self, federate: FederateId) {
        self.others.retain(|other| other.federate != federate);
    }

    /// Whether all that matter share memory with this federate.
    pub(super) fn is_empty(&self) -> bool {
        self.others.is_empty()
    }

    /// Whether this federate may wait for what federates elsewhere show.
    pub(super) fn may_ask(&self) -> bool {
        self.others.iter().any(|other| other.leads)
    }

    /// A message leaves for a federate.
    pub(super) fn sent(&mut self, to: FederateId, tag: Tag) {
        for other in self.others.iter_mut().filter(|other| other.federate == to) {
            other.owed = other.owed.max(tag);
        }
    }

    /// This federate shows something new.
    pub(super) fn show(&mut self, posting: &Posting) {
        if !self.others.is_empty() {
            self.shown = Some(posting.clone());
            self.others.iter_mut().for_each(|other| other.told = false);
        }
    }

    /// All need what this federate shows next: it has read all of one that was killed.
    pub(super) fn tell_all(&mut self) {
        self.others.iter_mut().for_each(|other| other.is_urgent = true);
    }

    /// Through which step this federate must know its inputs; `NEVER` if it knows enough.
    pub(super) fn wait_for(&mut self, step: Step) {
        self.waits = step;
    }

    /// A posting has come. Returns whether it is of a federate elsewhere.
    pub(super) fn came(&mut self, from: FederateId) -> bool {
        let Some(other) = self.others.iter_mut().find(|other| other.federate == from) else {
            return false;
        };
        other.unasked = self.waits == Step::NEVER;
        true
    }

    /// What is to be sent now, and to which federates.
    pub(super) fn due(
        &mut self,
        boards: &Boards,
        topology: &Topology,
    ) -> Vec<(FederateId, Posting)> {
        let Self { others, shown, waits } = self;
        let Some(shown) = shown else { return Vec::new() };
        let arrivals = OnceCell::new();
        let mut postings = Vec::new();
        for other in others {
            let is_beyond = |step: Step| {
                let arrivals = arrivals.get_or_init(|| boards.caused_from(shown.next, topology));
                arrivals[other.federate] > step
            };
            let is_of_use = || shown.departs || other.wanted(boards).is_some_and(is_beyond);
            let is_due = other.is_urgent || other.follows && !other.told && is_of_use();
            other.is_urgent = false;
            if is_due || other.is_misinformed(*waits) {
                if other.owed > Tag::NEVER && is_beyond(Step::end(other.owed)) {
                    other.owed = Tag::NEVER;
                }
                (other.told, other.asked) = (true, *waits);
                postings.push((other.federate, Posting { waits: *waits, ..shown.clone() }));
            }
        }
        postings
    }

    /// The last posting, for all.
    pub(super) fn last(&self, posting: &Posting) -> Vec<(FederateId, Posting)> {
        self.others.iter().map(|other| (other.federate, posting.clone())).collect()
    }
}

impl Other {
    /// Beyond which step this federate has to be before its posting is of use, if it can be.
    fn wanted(&self, boards: &Boards) -> Option<Step> {
        let owed = (self.owed > Tag::NEVER).then(|| Step::end(self.owed));
        boards.awaited_by(self.federate).into_iter().chain(owed).min()
    }

    /// Whether it takes this federate for one that waits for another step, or for one that waits.
    fn is_misinformed(&self, waits: Step) -> bool {
        let is_wrong = self.asked != waits && (waits > Step::NEVER || self.unasked);
        self.leads && is_wrong
    }
}
