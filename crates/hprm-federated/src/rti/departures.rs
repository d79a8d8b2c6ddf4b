//! Federates that ask to leave before the others, where federates read boards.
//!
//! Others may have relied on what the board of such a federate said about its next event. It takes that back on its
//! board, and asks the RTI, which asks all federates downstream of it. Each of them answers once it has read that, with
//! the latest tag that it has begun; the federate leaves after all of these, and after the last tags of those that have
//! left. Where the RTI makes the grants itself, it knows all that (`arriving`).

use std::collections::{BTreeMap, BTreeSet};

use hprm_core::{FederateId, Tag};

use super::{Rti, RtiOutput};
use crate::Frame;

/// What the RTI knows of one departure.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
struct Departure {
    /// The federate leaves at this tag, or later.
    least: Tag,
    /// The federates that have not answered.
    unanswered: BTreeSet<FederateId>,
}

/// See the module.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Default)]
pub(super) struct Departures(BTreeMap<FederateId, Departure>);

impl Departures {
    /// Whether that federate has asked to leave.
    pub(super) fn is_asked_by(&self, federate: FederateId) -> bool {
        self.0.contains_key(&federate)
    }
}

impl Rti {
    /// A federate asks to leave, at `least` at the earliest.
    pub(super) fn ask_before_departure(&mut self, federate: FederateId, least: Tag) {
        let Some(incarnation) = self.members[federate].link().map(|link| link.0) else { return };
        let readers = self.topology.reachable(federate).into_iter();
        // One that is about to join may have read the board already.
        let link_of =
            |other| self.members[other].link().or_else(|| self.arrivals.link_of_linking(other));
        let links =
            readers.filter(|other| *other != federate).filter_map(|it| Some((it, link_of(it)?)));
        let links: Vec<_> = links.collect();
        let unanswered = links.iter().map(|(reader, _)| *reader).collect();
        for (_, link) in links {
            let frame = Frame::Departing { federate, incarnation };
            self.outputs.push_back(RtiOutput::Send { link, frame });
        }
        self.departures.0.insert(federate, Departure { least, unanswered });
        self.end_departures();
    }

    /// A federate has read that another one asks to leave. The latest tag that it has begun is `after`.
    pub(super) fn departure_answered(
        &mut self,
        reader: FederateId,
        federate: FederateId,
        incarnation: u32,
        after: Tag,
    ) {
        let is_meant = self.members[federate].link().is_some_and(|link| link.0 == incarnation);
        let Some(departure) = self.departures.0.get_mut(&federate).filter(|_| is_meant) else {
            return;
        };
        if departure.unanswered.remove(&reader) {
            departure.least = departure.least.max(after.succ());
            self.end_departures();
        }
    }

    /// A federate has ended: it does not ask any more, and answers nothing.
    pub(super) fn forget_departure(&mut self, federate: FederateId) {
        self.departures.0.remove(&federate);
        for departure in self.departures.0.values_mut() {
            departure.unanswered.remove(&federate);
        }
        self.end_departures();
    }

    /// Tells the federates about which all others have answered when they must leave.
    fn end_departures(&mut self) {
        let answered = self.departures.0.iter().filter(|(_, it)| it.unanswered.is_empty());
        let answered: Vec<_> = answered.map(|(federate, it)| (*federate, it.least)).collect();
        for (federate, least) in answered {
            self.departures.0.remove(&federate);
            let tag = self.advance.entry(&self.topology, federate).max(least);
            self.send(federate, Frame::Depart { tag });
        }
    }
}
