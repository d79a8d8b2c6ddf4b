//! Which federates wait for which others: the tags of DNETs, and the federates to recall.
//!
//! When the RTI sends a DNET is in `dnet`; how far a federate may advance is in `advance`.

use std::collections::BTreeSet;

use hprm_core::{Delay, FederateId, Tag};

use super::Advance;
use super::dnet::Blocked;
use crate::{Frame, Step, Topology};

impl Advance {
    /// A federate has sent a message.
    pub(in crate::rti) fn sent(&mut self, federate: FederateId) {
        self.dnet.sent(federate);
    }

    /// A federate has reported its next event, and all that may advance now have their grants. Returns
    /// a DNET for the federate, if it may skip reports for a while.
    pub(in crate::rti) fn dnet(
        &mut self,
        topology: &Topology,
        federate: FederateId,
    ) -> Option<Frame> {
        let next = self.reports[federate].next.tag;
        let least = self.dnet.reported(federate, next)?;
        let Some(limit) = self.limit(topology, federate, least) else {
            self.dnet.back_off(federate);
            return None;
        };
        Some(self.dnet.skip(federate, limit))
    }

    /// The federates that must report again, because another federate waits for them, each with its
    /// DNET.
    pub(in crate::rti) fn recall(&mut self, topology: &Topology) -> Vec<(FederateId, Frame)> {
        let mut recalled = Vec::new();
        for blocked in self.dnet.take_blocked() {
            for federate in self.in_the_way(topology, blocked) {
                recalled.push((federate, self.dnet.recall(federate)));
            }
        }
        recalled
    }

    /// The latest tag such that no federate waits for what another one does until then; none, if that
    /// is before `least`.
    fn limit(&self, topology: &Topology, from: FederateId, least: Tag) -> Option<Tag> {
        let mut limit = Tag::FOREVER;
        let mut seen = BTreeSet::from([from]);
        let mut queue = BTreeSet::from([(Step::begin(Tag::START), from)]);
        // The nearest federate first: this is Dijkstra's algorithm, with delays as distances.
        while let Some((distance, here)) = queue.pop_first() {
            if here != from {
                if !seen.insert(here) || self.earliest.has_ended(here) {
                    continue;
                }
                limit = limit.min(before(self.demand(here), distance.tag));
                if limit < least {
                    return None;
                }
            }
            for edge in topology.downstream(here) {
                let distance = edge.shift(distance);
                if distance < Step::FOREVER && !seen.contains(&edge.federate) {
                    queue.insert((distance, edge.federate));
                }
            }
        }
        Some(limit)
    }

    /// Before this tag a federate waits for no other federate, unless it gets a message.
    fn demand(&self, federate: FederateId) -> Tag {
        let report = &self.reports[federate];
        report.own(self.stop).tag.max(report.granted.whole().succ())
    }

    /// The federates that skip their reports, and have to report before a blocked federate may process
    /// the tag that it wants.
    fn in_the_way(&self, topology: &Topology, blocked: Blocked) -> Vec<FederateId> {
        let mut found = Vec::new();
        let mut seen = BTreeSet::new();
        let mut queue = BTreeSet::from([(blocked.wanted, blocked.federate)]);
        // The highest bound first: a federate that is beyond that bound is beyond the others.
        while let Some((bound, here)) = queue.pop_last() {
            if topology.is_stepwise(here) || !seen.insert(here) {
                continue;
            }
            for (arrival, from) in self.earliest.arrivals(here) {
                if arrival.tag > bound {
                    break;
                }
                let delay = topology.delay(from, here).unwrap_or(Delay::None);
                let bound = before(bound, delay.shift(Tag::START));
                let own = self.reports[from].own(self.stop).tag;
                if own <= bound && self.dnet.skips_beyond(from, bound) && !seen.contains(&from) {
                    found.push(from);
                }
                if self.earliest.arrival(from).tag <= bound {
                    queue.insert((bound, from));
                }
            }
        }
        found.sort_unstable();
        found.dedup();
        found
    }
}

/// The latest tag from which the delays of a path lead to `tag` or an earlier one. `distance` is where
/// the path leads from the start.
fn before(tag: Tag, distance: Tag) -> Tag {
    if tag == Tag::FOREVER || tag == Tag::NEVER {
        return tag;
    }
    let time = tag.time.saturating_sub(distance.time);
    match (tag.microstep.checked_sub(distance.microstep), distance.time) {
        (Some(microstep), 0) => Tag { time, microstep },
        (Some(_), _) => Tag { time, microstep: u32::MAX },
        (None, _) => Tag { time: time.saturating_sub(1), microstep: u32::MAX },
    }
}

#[cfg(test)]
mod tests {
    use hprm_core::{Delay, Tag};
    use proptest::prelude::*;

    use super::before;

    proptest! {
        #[test]
        fn before_is_the_latest_tag_that_a_path_leads_from(
            path in prop::collection::vec((0_i64..3).prop_map(|nanos| match nanos {
                0 => Delay::None,
                nanos => Delay::after(nanos - 1),
            }), 0..5),
            (time, microstep) in (0_i64..9, 0_u32..4),
            from in (-9_i64..9, 0_u32..9),
        ) {
            let (tag, from) = (Tag::new(time, microstep), Tag::new(from.0, from.1));
            let go = |from: Tag| path.iter().fold(from, |tag, delay| delay.shift(tag));
            let latest = before(tag, go(Tag::START));
            prop_assert_eq!(go(from) <= tag, from <= latest);
        }
    }
}
