//! Which reader has been told of which segment.
//!
//! Plain data. A reader must map a segment before it opens an object in it, so the owner announces
//! each segment once to each reader that gets an object from it. Descriptors and links are not its
//! business.

#![forbid(unsafe_code)]

use std::collections::{BTreeMap, BTreeSet};

use hprm_core::FederateId;

/// What one reader knows, and has to be told.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Default)]
struct Knowledge {
    told: BTreeSet<u32>,
    due: BTreeSet<u32>,
    retired: Vec<u32>,
}

/// What every reader knows of an owner's segments.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Default)]
pub(crate) struct Announcements(BTreeMap<FederateId, Knowledge>);

impl Announcements {
    /// `reader` gets an object in `segment`.
    pub(crate) fn need(&mut self, reader: FederateId, segment: u32) {
        let knowledge = self.0.entry(reader).or_default();
        if !knowledge.told.contains(&segment) {
            knowledge.due.insert(segment);
        }
    }

    /// The segments to tell `reader` of; from now on it knows them.
    pub(crate) fn take_due(&mut self, reader: FederateId) -> BTreeSet<u32> {
        let Some(knowledge) = self.0.get_mut(&reader) else { return BTreeSet::new() };
        let due = std::mem::take(&mut knowledge.due);
        knowledge.told.extend(&due);
        due
    }

    /// `segment` does not exist any more.
    pub(crate) fn retire(&mut self, segment: u32) {
        for knowledge in self.0.values_mut() {
            knowledge.due.remove(&segment);
            if knowledge.told.remove(&segment) {
                knowledge.retired.push(segment);
            }
        }
    }

    /// The retired segments that `reader` may still have mapped; from now on it knows.
    pub(crate) fn take_retired(&mut self, reader: FederateId) -> Vec<u32> {
        self.0.get_mut(&reader).map(|known| std::mem::take(&mut known.retired)).unwrap_or_default()
    }

    /// `reader` is gone, and what it knew with it.
    pub(crate) fn forget(&mut self, reader: FederateId) {
        self.0.remove(&reader);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const B: FederateId = FederateId(1);
    const C: FederateId = FederateId(2);

    #[test]
    fn a_reader_is_told_of_a_segment_once() {
        let mut told = Announcements::default();
        told.need(B, 3);
        told.need(B, 3);
        assert_eq!(told.take_due(B), [3].into());
        told.need(B, 3);
        assert!(told.take_due(B).is_empty());
        assert!(told.take_due(C).is_empty());
    }

    #[test]
    fn only_who_was_told_hears_that_a_segment_is_gone() {
        let mut told = Announcements::default();
        told.need(B, 3);
        told.take_due(B);
        told.need(C, 3);
        told.retire(3);
        assert_eq!(told.take_retired(B), [3]);
        assert_eq!(told.take_retired(B), []);
        assert_eq!(told.take_retired(C), []);
        assert!(told.take_due(C).is_empty());
    }

    #[test]
    fn a_reader_that_comes_back_is_told_again() {
        let mut told = Announcements::default();
        told.need(B, 3);
        told.take_due(B);
        told.forget(B);
        told.need(B, 3);
        assert_eq!(told.take_due(B), [3].into());
    }
}
