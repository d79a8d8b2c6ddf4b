//! For every federate, the earliest tag at which it may still do something.
//!
//! A federate does something at its own next event, or when a message reaches it; a message is
//! sent by a federate that does something. So `earliest(f)` is the least of `own(f)` and, over the
//! federates `u` upstream of `f`, `edge(u, f).shift(earliest(u))`. That is a shortest-path problem
//! whose source values change, one at a time; each change touches only the federates whose value
//! depends on it, and their edges. It does not matter how large the rest of the federation is.
//!
//! Every edge leads to a later step, so no value depends on itself, whatever cycles there are.

use std::collections::BTreeSet;

use hprm_core::{FederateId, Table, Tag};

use crate::{Step, Topology};

#[derive(Clone, PartialEq, Eq, Hash, Debug)]
struct Node {
    /// Before this tag the federate does nothing unless a message arrives.
    own: Step,
    /// `own`, or the first of `arrivals`.
    earliest: Step,
    /// For each upstream federate, the earliest tag of a message from there, unless `FOREVER`.
    arrivals: BTreeSet<(Step, FederateId)>,
    /// The federate has ended: no message makes it do anything.
    ended: bool,
}

/// See the module.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(crate) struct Earliest {
    nodes: Table<FederateId, Node>,
}

impl Earliest {
    /// No federate has done anything, and all may begin at the start.
    pub(crate) fn new(topology: &Topology) -> Self {
        let node = |_| Node {
            own: Step::FOREVER,
            earliest: Step::FOREVER,
            arrivals: BTreeSet::new(),
            ended: false,
        };
        let mut this = Self { nodes: topology.federates().map(node).collect() };
        for federate in topology.federates() {
            this.set(topology, federate, Step::begin(Tag::START));
        }
        this
    }

    /// The earliest tag that a message to the federate may still have.
    pub(crate) fn arrival(&self, federate: FederateId) -> Step {
        self.nodes[federate].arrivals.first().map_or(Step::FOREVER, |(tag, _)| *tag)
    }

    /// The federates from which messages may still come, with the earliest tag of such a message, by
    /// tag.
    pub(crate) fn arrivals(
        &self,
        federate: FederateId,
    ) -> impl Iterator<Item = (Step, FederateId)> {
        self.nodes[federate].arrivals.iter().copied()
    }

    /// The federate on whose own next event it depends how early `federate` may do something: itself, or one from
    /// which a message may lead to it. Every step on the way there is to an earlier tag.
    pub(crate) fn source(&self, federate: FederateId) -> FederateId {
        let mut here = federate;
        loop {
            let Node { own, earliest, arrivals, .. } = &self.nodes[here];
            match arrivals.first() {
                Some((_, from)) if own > earliest => here = *from,
                _ => return here,
            }
        }
    }

    /// Whether the federate does nothing more.
    pub(crate) fn has_ended(&self, federate: FederateId) -> bool {
        self.nodes[federate].ended
    }

    /// Sets the federate's own next event. Returns the federates whose `arrival` may have changed.
    pub(crate) fn set(
        &mut self,
        topology: &Topology,
        federate: FederateId,
        own: Step,
    ) -> BTreeSet<FederateId> {
        let node = &mut self.nodes[federate];
        node.own = if node.ended { Step::FOREVER } else { own };
        self.settle(topology, federate)
    }

    /// The federate, which has ended, may do something again; the caller sets its next event.
    pub(crate) fn revive(&mut self, federate: FederateId) {
        self.nodes[federate].ended = false;
    }

    /// The federate does nothing more, whatever arrives. Returns the federates whose `arrival` may have
    /// changed.
    pub(crate) fn end(
        &mut self,
        topology: &Topology,
        federate: FederateId,
    ) -> BTreeSet<FederateId> {
        let node = &mut self.nodes[federate];
        node.ended = true;
        node.own = Step::FOREVER;
        self.settle(topology, federate)
    }

    /// Finds all values again after that of one federate may have changed.
    fn settle(&mut self, topology: &Topology, changed: FederateId) -> BTreeSet<FederateId> {
        let mut touched = BTreeSet::new();
        let unsettled = self.unsettle(topology, changed, &mut touched);
        let mut queue: BTreeSet<_> =
            unsettled.into_iter().map(|federate| (self.supported(federate), federate)).collect();
        // Smallest first: what is taken from the queue cannot become smaller any more.
        while let Some((tag, federate)) = queue.pop_first() {
            if tag >= self.nodes[federate].earliest {
                continue;
            }
            let was = std::mem::replace(&mut self.nodes[federate].earliest, tag);
            for edge in topology.downstream(federate) {
                let arrival = edge.shift(tag);
                self.replace(edge.federate, federate, edge.shift(was), arrival);
                touched.insert(edge.federate);
                if !self.nodes[edge.federate].ended && arrival < self.nodes[edge.federate].earliest
                {
                    queue.insert((arrival, edge.federate));
                }
            }
        }
        touched
    }

    /// Sets to `FOREVER` the values that have lost what they depended on: that of `changed`, and those
    /// that depended only on it. Returns the federates that have these values.
    ///
    /// A value depends on smaller values only, so none depends on itself.
    fn unsettle(
        &mut self,
        topology: &Topology,
        changed: FederateId,
        touched: &mut BTreeSet<FederateId>,
    ) -> Vec<FederateId> {
        let mut unsettled = Vec::new();
        if self.supported(changed) == self.nodes[changed].earliest {
            return unsettled;
        }
        let mut pending = vec![changed];
        while let Some(federate) = pending.pop() {
            unsettled.push(federate);
            let was = std::mem::replace(&mut self.nodes[federate].earliest, Step::FOREVER);
            for edge in topology.downstream(federate) {
                let arrival = edge.shift(was);
                self.replace(edge.federate, federate, arrival, Step::FOREVER);
                touched.insert(edge.federate);
                let earliest = self.nodes[edge.federate].earliest;
                let depended = arrival == earliest && earliest < Step::FOREVER;
                if depended && self.supported(edge.federate) > earliest {
                    pending.push(edge.federate);
                }
            }
        }
        unsettled
    }

    /// The least of what the federate's value can depend on.
    fn supported(&self, federate: FederateId) -> Step {
        let node = &self.nodes[federate];
        if node.ended { Step::FOREVER } else { node.own.min(self.arrival(federate)) }
    }

    fn replace(&mut self, at: FederateId, from: FederateId, was: Step, is: Step) {
        let arrivals = &mut self.nodes[at].arrivals;
        if was < Step::FOREVER {
            arrivals.remove(&(was, from));
        }
        if is < Step::FOREVER {
            arrivals.insert((is, from));
        }
    }
}

#[cfg(test)]
mod tests {
    use hprm_core::{FederateId, Table, Tag};
    use proptest::prelude::*;

    use super::Earliest;
    use crate::fixture::program;
    use crate::{Step, Topology};

    /// The definition, iterated until nothing changes.
    fn by_definition(topology: &Topology, own: &Table<FederateId, Option<Step>>) -> Vec<Step> {
        let all: Vec<_> = topology.federates().collect();
        let mut earliest: Table<FederateId, Step> = Table::filled(all.len(), Step::FOREVER);
        let arrival = |earliest: &Table<FederateId, Step>, federate| {
            let edges = topology.upstream(federate).iter();
            edges.map(|edge| edge.shift(earliest[edge.federate])).min()
        };
        for _ in 0..=all.len() {
            for federate in &all {
                if let Some(own) = own[*federate] {
                    let arrival = arrival(&earliest, *federate).unwrap_or(Step::FOREVER);
                    earliest[*federate] = own.min(arrival);
                }
            }
        }
        let arrivals = all.iter().map(|federate| arrival(&earliest, *federate));
        arrivals.map(|arrival| arrival.unwrap_or(Step::FOREVER)).collect()
    }

    fn topology() -> impl Strategy<Value = Topology> {
        // No cycle without a delay: only connections to a higher number may lack one.
        let edge = (0_usize..6, 0_usize..6, 0_i64..4);
        prop::collection::vec(edge, 1..14).prop_map(|edges| {
            let mut text = "f0 -> f1 after 9\nf2 -> f3 after 9\nf4 -> f5 after 9\n".to_owned();
            for (from, to, after) in edges.into_iter().filter(|(from, to, _)| from != to) {
                let after = match after {
                    3 if from < to => String::new(),
                    after => format!("after {}", after % 3 * 10),
                };
                text.push_str(&format!("f{from} -> f{to} {after}\n"));
            }
            Topology::new(&program(&text))
        })
    }

    proptest! {
        #[test]
        fn changes_lead_to_what_the_definition_says(
            topology in topology(),
            changes in prop::collection::vec((0_u16..6, 0_i64..50, 0_u32..3, 0_u32..9), 1..40),
        ) {
            let mut earliest = Earliest::new(&topology);
            let mut own = Table::filled(6, Some(Step::begin(Tag::START)));
            for (federate, time, microstep, level) in changes {
                let federate = FederateId(federate);
                let before: Vec<_> = topology.federates().map(|f| earliest.arrival(f)).collect();
                let touched = if (time, microstep) == (0, 1) {
                    own[federate] = None;
                    earliest.end(&topology, federate)
                } else {
                    let tag = match time {
                        46.. => Step::FOREVER,
                        _ => Step { tag: Tag::new(time, microstep), level },
                    };
                    own[federate] = own[federate].map(|_| tag);
                    earliest.set(&topology, federate, tag)
                };
                let after: Vec<_> = topology.federates().map(|f| earliest.arrival(f)).collect();
                prop_assert_eq!(&after, &by_definition(&topology, &own));
                for federate in topology.federates() {
                    let changed = before[federate.index()] != after[federate.index()];
                    prop_assert!(!changed || touched.contains(&federate));
                }
            }
        }
    }
}
