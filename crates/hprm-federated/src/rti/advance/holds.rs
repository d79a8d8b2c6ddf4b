//! What a federate without a grant waits for, as far as the RTI knows: for watchers.

use hprm_core::{FederateId, Tag};

use super::Advance;
use crate::{Hold, Step};

/// How many federates upstream are named, those first from which the earliest messages may come.
const NAMED: usize = 8;

impl Advance {
    /// The next event that a federate has reported since it last completed a tag.
    pub(in crate::rti) fn reported(&self, federate: FederateId) -> Option<Tag> {
        Some(self.reports[federate].next.tag).filter(|next| *next > Tag::NEVER)
    }

    /// The latest tag that a federate has reported as completed.
    pub(in crate::rti) fn completed(&self, federate: FederateId) -> Tag {
        self.reports[federate].completed
    }

    /// What a federate wants to process next, if the RTI knows that and has not granted it.
    pub(in crate::rti) fn ungranted(&self, federate: FederateId) -> Option<Step> {
        let report = &self.reports[federate];
        let wanted = report.wanted(self.stop);
        (wanted.tag < Tag::FOREVER && wanted > report.granted).then_some(wanted)
    }

    /// The federates upstream from which a message for `wanted` may still come, or for an earlier step.
    pub(in crate::rti) fn arrivals_before(
        &self,
        federate: FederateId,
        wanted: Step,
    ) -> impl Iterator<Item = Hold> {
        let arrivals = self.earliest.arrivals(federate);
        let early = arrivals.take_while(move |(arrival, _)| *arrival <= wanted).take(NAMED);
        early.map(|(arrival, upstream)| Hold::Upstream {
            federate: upstream,
            source: self.earliest.source(upstream),
            arrival: arrival.tag,
        })
    }
}
