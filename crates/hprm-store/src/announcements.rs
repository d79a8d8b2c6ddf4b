//! Which segments were announced to which reader.
//!
//! Plain data. A reader must map a segment before it opens an object in it, so the owner announces
//! each segment once to each reader that gets an object from it. The store and the links send
//! the descriptors.

#![forbid(unsafe_code)]

use std::collections::{BTreeMap, BTreeSet};

use hprm_core::FederateId;

/// The segments that one reader knows, and those that it has to be announcements of.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Default)]
struct ReaderSegments {
    announced: BTreeSet<u32>,
    due: BTreeSet<u32>,
    retired: Vec<u32>,
}

/// The segments of one owner that each reader knows.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Default)]
pub(crate) struct Announcements(BTreeMap<FederateId, ReaderSegments>);

impl Announcements {
    /// `reader` gets an object in `segment`.
    pub(crate) fn need(&mut self, reader: FederateId, segment: u32) {
        let segments = self.0.entry(reader).or_default();
        if !segments.announced.contains(&segment) {
            segments.due.insert(segment);
        }
    }

    /// The segments to announce to `reader`; from now on they count as announced.
    pub(crate) fn take_due(&mut self, reader: FederateId) -> BTreeSet<u32> {
        let Some(segments) = self.0.get_mut(&reader) else { return BTreeSet::new() };
        let due = std::mem::take(&mut segments.due);
        segments.announced.extend(&due);
        due
    }

    /// `segment` does not exist any more.
    pub(crate) fn retire(&mut self, segment: u32) {
        for segments in self.0.values_mut() {
            segments.due.remove(&segment);
            if segments.announced.remove(&segment) {
                segments.retired.push(segment);
            }
        }
    }

    /// The retired segments that `reader` may still have mapped; each is returned once.
    pub(crate) fn take_retired(&mut self, reader: FederateId) -> Vec<u32> {
        self.0.get_mut(&reader).map(|known| std::mem::take(&mut known.retired)).unwrap_or_default()
    }

    /// Forgets a reader whose link has closed.
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
    fn a_segment_is_announced_to_a_reader_once() {
        let mut announcements = Announcements::default();
        announcements.need(B, 3);
        announcements.need(B, 3);
        assert_eq!(announcements.take_due(B), [3].into());
        announcements.need(B, 3);
        assert!(announcements.take_due(B).is_empty());
        assert!(announcements.take_due(C).is_empty());
    }

    #[test]
    fn only_readers_that_know_a_segment_are_told_that_it_is_retired() {
        let mut announcements = Announcements::default();
        announcements.need(B, 3);
        announcements.take_due(B);
        announcements.need(C, 3);
        announcements.retire(3);
        assert_eq!(announcements.take_retired(B), [3]);
        assert_eq!(announcements.take_retired(B), []);
        assert_eq!(announcements.take_retired(C), []);
        assert!(announcements.take_due(C).is_empty());
    }

    #[test]
    fn a_segment_is_announced_again_to_a_reader_that_joins_again() {
        let mut announcements = Announcements::default();
        announcements.need(B, 3);
        announcements.take_due(B);
        announcements.forget(B);
        announcements.need(B, 3);
        assert_eq!(announcements.take_due(B), [3].into());
    }
}
