//! What follows from the boards that a federate has read, found when it is asked for, and kept until a board changes.
//!
//! A federate whose messages tell it all about its inputs asks for nothing of this, and most federates release no other
//! one with most of their postings. What boards mean is in `boards`; here is how often that is computed.

use std::hash::{Hash, Hasher};

use hprm_core::{FederateId, Table, Tag};

use super::{Boards, Line, Tally};
use crate::{Step, Topology};

/// What has been found. It follows from the rest of the boards, so it does not tell two states of them apart.
#[derive(Clone, Debug)]
pub(super) struct Found {
    /// The step of the earliest message to each federate that its sender has counted, and the federate has not.
    unread: Table<FederateId, Option<Step>>,
    /// Through which step this federate knows its inputs.
    known: Option<Step>,
    /// Room for how early messages arrive.
    arrivals: Table<FederateId, Step>,
    /// Room for the tallies of a posting.
    spare: Vec<Tally>,
}

impl PartialEq for Found {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl Eq for Found {}

impl Hash for Found {
    fn hash<H: Hasher>(&self, _: &mut H) {}
}

impl Found {
    pub(super) fn nothing(federates: usize) -> Self {
        Self {
            unread: Table::filled(federates, None),
            known: None,
            arrivals: Table::filled(federates, Step::FOREVER),
            spare: Vec::new(),
        }
    }

    /// What this federate knows of its inputs has to be found again.
    pub(super) fn forget_known(&mut self) {
        self.known = None;
    }

    /// Tallies that were shown are not needed any more.
    pub(super) fn recycle(&mut self, tallies: Vec<Tally>) {
        self.spare = tallies;
    }

    /// A copy of tallies, in the room of those that are not needed any more.
    pub(super) fn copy(&mut self, tallies: &[Tally]) -> Vec<Tally> {
        let mut copy = std::mem::take(&mut self.spare);
        copy.clear();
        copy.extend_from_slice(tallies);
        copy
    }
}

impl Boards {
    /// A federate's board has changed, or what is known of its process, and with it perhaps what its receivers have not
    /// read.
    pub(super) fn refresh(&mut self, federate: FederateId) {
        self.found.known = None;
        self.found.unread[federate] = None;
        for reader in &self.leading_from[federate] {
            self.found.unread[*reader] = None;
        }
        self.bury();
    }

    /// Through which step this federate knows everything that can reach it, as far as the boards tell that have been
    /// read.
    pub(crate) fn known(&mut self, topology: &Topology) -> Step {
        if let Some(known) = self.found.known {
            return known;
        }
        let upstream = std::mem::take(&mut self.upstream);
        let (me, arrivals) = ([self.me], std::mem::take(&mut self.found.arrivals));
        self.find_unread(&upstream, &me);
        let arrivals = self.arrivals(topology, &upstream, arrivals, |from| self.spontaneous(from));
        let known = self.through(self.me, &arrivals);
        (self.upstream, self.found.arrivals, self.found.known) = (upstream, arrivals, Some(known));
        known
    }

    /// The federates that share memory with this one and wait, and need not wait any more because of what this
    /// federate shows; all, if one may join or go on because this federate has read all of one that was killed. What it
    /// knows of boards elsewhere may be old, so it takes those federates for ones that send nothing: one that is woken
    /// up too early waits again.
    pub(crate) fn released(&mut self, topology: &Topology) -> Vec<FederateId> {
        let is_waiting = |other: &FederateId| {
            self.near[*other] && (self.wakes_all > 0 || self.awaited_by(*other).is_some())
        };
        let mut waiting: Vec<_> = self.downstream.iter().copied().filter(is_waiting).collect();
        if !waiting.is_empty() && self.wakes_all == 0 {
            let around = std::mem::take(&mut self.around);
            let arrivals = std::mem::take(&mut self.found.arrivals);
            self.find_unread(&around, &waiting);
            let source =
                |from| if self.near[from] { self.spontaneous(from) } else { Step::FOREVER };
            let arrivals = self.arrivals(topology, &around, arrivals, source);
            waiting.retain(|it| self.postings[*it].waits <= self.through(*it, &arrivals));
            (self.around, self.found.arrivals) = (around, arrivals);
        }
        waiting
    }

    /// Before which step a federate does nothing, unless a message reaches it that has not been sent yet.
    fn spontaneous(&self, federate: FederateId) -> Step {
        // It may not know the last tag yet.
        let next = self.until_stop(self.postings[federate].next);
        self.unread(federate).min(next)
    }

    /// Through which step a federate knows everything, if messages that are still to be sent arrive as given.
    fn through(&self, federate: FederateId, arrivals: &Table<FederateId, Step>) -> Step {
        self.unread(federate).min(arrivals[federate]).pred()
    }

    fn find_unread(&mut self, some: &[FederateId], others: &[FederateId]) {
        for federate in some.iter().chain(others) {
            if self.found.unread[*federate].is_none() {
                self.found.unread[*federate] = Some(self.count_unread(*federate));
            }
        }
    }

    fn unread(&self, federate: FederateId) -> Step {
        self.found.unread[federate].unwrap_or_else(|| self.count_unread(federate))
    }

    /// What a federate that has ended has not read, it never will.
    fn count_unread(&self, federate: FederateId) -> Step {
        let lines = self.leading_to[federate].iter().map(|at| self.lines[*at]);
        let unread = match self.has_ended(federate) {
            true => None,
            false => lines.filter_map(|line| self.unread_on(line)).min(),
        };
        let first = Step::begin(self.lives.first[federate]);
        unread.map_or(Step::FOREVER, |unread| unread.max(first))
    }

    fn unread_on(&self, line: Line) -> Option<Step> {
        let sent = self.counted_by(line.from, line.sent, line.to);
        let received = self.counted_by(line.to, line.received, line.from);
        if sent.messages <= received.messages
            || self.has_met_a_successor(line)
            || self.have_not_met(line)
        {
            return None;
        }
        // Tags on a channel increase. Of several unread messages only the tag of the last one is known.
        let tag = match sent.messages - received.messages {
            1 => sent.latest,
            _ => received.latest.succ().max(Tag::START),
        };
        Some(Step { tag, level: line.level })
    }
}

#[cfg(test)]
mod tests {
    use hprm_core::ChannelId;
    use proptest::prelude::*;

    use super::super::Posting;
    use super::super::tests::{View, at, showing, tally, view};
    use super::*;

    /// What happens to the boards: what it is, to which federate, and a time or a number.
    type Event = (u8, u16, i64);

    fn happens(View { topology, boards }: &mut View, (kind, federate, value): Event) {
        let id = FederateId(federate);
        match kind {
            0 => boards.post(Step::begin(at(value)), false),
            1 => boards.sent(ChannelId(federate.into()), at(value)),
            2 => boards.received(ChannelId(federate.into()), at(value)),
            3 => boards.meet(topology, id, 1 + u32::from(value > 4)),
            4 => boards.is_without(id),
            5 => boards.awaits(id),
            6 => boards.joins(id, at(value)),
            7 => boards.dies(id),
            8 => boards.has_read_all_of(topology, id),
            9 => boards.starts_at(at(value)),
            10 => boards.stop_at(at(50 + value)),
            11 => drop(boards.show(Step::NEVER)),
            _ => {
                let tallies = boards.postings[id].tallies.len();
                let life = u32::from(kind % 3);
                let tallies: Vec<_> = (0..tallies)
                    .map(|at| Tally { life, ..tally(u64::from(kind / 4), value + at as i64) })
                    .collect();
                let waits = Step::end(at(value * i64::from(kind % 2)));
                let life = boards.postings[id].life;
                boards.read(id, Posting { waits, life, ..showing(value, &tallies) });
            }
        }
    }

    proptest! {
        #[test]
        fn what_has_been_kept_is_what_would_be_found_anew(
            events in prop::collection::vec((0_u8..24, 0_u16..4, 0_i64..9), 1..40),
        ) {
            let mut b = view("a -> b\nb -> c after 5\nc -> b\nb -> d\nd -> c\na -> d", "b");
            for event in events {
                happens(&mut b, event);
                let mut anew = b.boards.clone();
                anew.found = Found::nothing(4);
                prop_assert_eq!(b.boards.known(&b.topology), anew.known(&b.topology));
                prop_assert_eq!(b.boards.released(&b.topology), anew.released(&b.topology));
            }
        }
    }
}
