//! A sorted map from tags to lists of entries, from which the earliest list is taken again and again.
//!
//! The earliest list is kept outside the tree, because most programs have events at one or two future
//! tags. The event queue knows what the entries are.

use alloc::collections::BTreeMap;
use alloc::vec::Vec;
use core::hash::{Hash, Hasher};
use core::iter;
use core::mem;

use crate::Tag;

/// The most empty lists that are kept. A program that has had more future tags than this frees the
/// memory of the rest.
const MAX_SPARE: usize = 64;

/// Lists of entries by tag. No list is empty.
#[derive(Clone, Debug)]
pub(crate) struct TagMap<T> {
    /// The earliest tag, if there is any.
    first: Option<Tag>,
    /// The list of that tag; empty if there is none. Not in an option, so that an event is written
    /// directly to its place.
    entries: Vec<T>,
    /// The lists of all other tags.
    later: BTreeMap<Tag, Vec<T>>,
    /// Empty lists of past tags, for future tags: a periodic program allocates nothing once it has warmed
    /// up, unless there are so many future tags that the tree grows and shrinks.
    spare: Vec<Vec<T>>,
}

// Spare lists are not part of the state.
impl<T: PartialEq> PartialEq for TagMap<T> {
    fn eq(&self, other: &Self) -> bool {
        self.first == other.first && self.entries == other.entries && self.later == other.later
    }
}

impl<T: Eq> Eq for TagMap<T> {}

impl<T: Hash> Hash for TagMap<T> {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.first.hash(state);
        self.entries.hash(state);
        self.later.hash(state);
    }
}

impl<T> TagMap<T> {
    pub(crate) const fn new() -> Self {
        Self { first: None, entries: Vec::new(), later: BTreeMap::new(), spare: Vec::new() }
    }

    /// The earliest tag with entries.
    pub(crate) fn first(&self) -> Option<Tag> {
        self.first
    }

    /// How many tags have entries.
    pub(crate) fn tags(&self) -> usize {
        usize::from(self.first.is_some()) + self.later.len()
    }

    /// The entries at `tag`.
    pub(crate) fn at(&self, tag: Tag) -> &[T] {
        match self.first {
            Some(first) if first == tag => &self.entries,
            Some(first) if first < tag => self.later.get(&tag).map_or(&[], Vec::as_slice),
            _ => &[],
        }
    }

    /// The entries at `tag`.
    pub(crate) fn at_mut(&mut self, tag: Tag) -> &mut [T] {
        match self.first {
            Some(first) if first == tag => &mut self.entries,
            _ => self.later.get_mut(&tag).map_or(&mut [], Vec::as_mut_slice),
        }
    }

    /// Appends an entry at `tag`.
    #[inline]
    pub(crate) fn push(&mut self, tag: Tag, entry: T) {
        self.list(tag).push(entry);
    }

    /// The same for an entry that is made in its place, and not copied: a processor waits before it copies in large
    /// pieces what it has just written in small ones.
    #[inline(always)]
    pub(crate) fn push_made(&mut self, tag: Tag, entry: impl FnOnce() -> T) {
        self.list(tag).extend(iter::once_with(entry));
    }

    /// Appends an entry at `tag`, or at the first later microstep where no other clashes. Returns the tag.
    /// The entry is made in its place, as in [`Self::push_made`].
    #[inline(always)]
    pub(crate) fn push_at_free_microstep(
        &mut self,
        mut tag: Tag,
        clashes: impl Fn(&T) -> bool,
        entry: impl FnOnce() -> T,
    ) -> Tag {
        loop {
            let list = self.list(tag);
            // A new list is empty, so it gets the entry, and no list stays empty.
            if !list.iter().any(&clashes) {
                list.extend(iter::once_with(entry));
                return tag;
            }
            tag = tag.succ();
        }
    }

    /// `tag`, or the first later microstep where no entry clashes.
    pub(crate) fn free_microstep(&self, mut tag: Tag, clashes: impl Fn(&T) -> bool) -> Tag {
        while self.at(tag).iter().any(&clashes) {
            tag = tag.succ();
        }
        tag
    }

    /// The list of `tag`, to which an entry is to be added.
    #[inline]
    fn list(&mut self, tag: Tag) -> &mut Vec<T> {
        match self.first {
            Some(first) if first == tag => {}
            None => self.first = Some(tag),
            Some(first) if first < tag => return self.later_list(tag),
            Some(first) => self.postpone_first(first, tag),
        }
        &mut self.entries
    }

    /// Makes room for the list of `tag`, which comes before `first`.
    #[inline(never)]
    fn postpone_first(&mut self, first: Tag, tag: Tag) {
        let entries = self.spare();
        self.later.insert(first, mem::replace(&mut self.entries, entries));
        self.first = Some(tag);
    }

    /// The list of a tag after the first.
    #[inline(never)]
    fn later_list(&mut self, tag: Tag) -> &mut Vec<T> {
        let spare = &mut self.spare;
        self.later.entry(tag).or_insert_with(|| spare.pop().unwrap_or_default())
    }

    /// Exchanges the entries at `tag` for an empty list, whose memory is used for future tags.
    #[inline]
    pub(crate) fn take(&mut self, tag: Tag, list: &mut Vec<T>) {
        debug_assert!(list.is_empty(), "entries of the list would move to another tag");
        if self.first != Some(tag) {
            return self.take_later(tag, list);
        }
        mem::swap(&mut self.entries, list);
        self.first = None;
        if !self.later.is_empty() {
            self.advance_first();
        }
    }

    /// The same for a tag that is not the earliest one.
    #[cold]
    fn take_later(&mut self, tag: Tag, list: &mut Vec<T>) {
        if let Some(entries) = self.later.remove(&tag) {
            self.recycle(mem::replace(list, entries));
        }
    }

    /// Makes the earliest of the other tags the first, whose list has been taken.
    #[inline(never)]
    fn advance_first(&mut self) {
        if let Some((next, entries)) = self.later.pop_first() {
            self.first = Some(next);
            let empty = mem::replace(&mut self.entries, entries);
            self.recycle(empty);
        }
    }

    /// An empty list, for [`Self::take`].
    pub(crate) fn spare(&mut self) -> Vec<T> {
        self.spare.pop().unwrap_or_default()
    }

    /// Keeps the memory of a list for future tags.
    pub(crate) fn recycle(&mut self, mut entries: Vec<T>) {
        entries.clear();
        if entries.capacity() > 0 && self.spare.len() < MAX_SPARE {
            self.spare.push(entries);
        }
    }

    /// All entries, in order.
    pub(crate) fn entries(&self) -> impl Iterator<Item = &T> {
        self.entries.iter().chain(self.later.values().flatten())
    }

    /// Removes all entries that satisfy the condition, in their order.
    pub(crate) fn extract(&mut self, mut condition: impl FnMut(&T) -> bool) -> Vec<(Tag, T)> {
        let mut extracted = Vec::new();
        let mut keeps_some = |tag: &Tag, entries: &mut Vec<T>| {
            let out = entries.extract_if(.., |entry| condition(entry));
            extracted.extend(out.map(|entry| (*tag, entry)));
            !entries.is_empty()
        };
        if let Some(first) = self.first
            && !keeps_some(&first, &mut self.entries)
        {
            self.first = None;
        }
        self.later.retain(keeps_some);
        if self.first.is_none()
            && let Some((first, entries)) = self.later.pop_first()
        {
            (self.first, self.entries) = (Some(first), entries);
        }
        extracted
    }

    /// Forgets everything after `tag`.
    pub(crate) fn truncate(&mut self, tag: Tag) {
        if self.first.is_some_and(|first| first > tag) {
            self.first = None;
            self.entries.clear();
            self.later.clear();
        } else if self.later.last_key_value().is_some_and(|(last, _)| *last > tag) {
            self.later.split_off(&tag.succ());
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use proptest::prelude::*;

    use super::*;

    fn at(time: i64) -> Tag {
        Tag::new(time, 0)
    }

    #[test]
    fn spare_memory_is_no_part_of_the_state() {
        let (mut used, fresh) = (TagMap::new(), TagMap::new());
        used.push(Tag::START, 'a');
        assert_ne!(used, fresh);
        let mut entries = used.spare();
        used.take(Tag::START, &mut entries);
        used.recycle(entries);
        assert_eq!(used.spare.len(), 1);
        assert_eq!(used, fresh);
        used.push(at(1), 'b');
        used.push(at(2), 'c');
        assert!(used.spare.is_empty());
    }

    proptest! {
        #[test]
        fn it_is_a_sorted_map(steps in prop::collection::vec((0_u8..5, 0_i64..6), 0..60)) {
            let (mut agenda, mut model) = (TagMap::new(), BTreeMap::<Tag, Vec<usize>>::new());
            for (index, (step, time)) in steps.into_iter().enumerate() {
                let tag = at(time);
                match step {
                    0 | 1 => {
                        agenda.push(tag, index);
                        model.entry(tag).or_default().push(index);
                    }
                    2 => {
                        let mut taken = agenda.spare();
                        agenda.take(tag, &mut taken);
                        prop_assert_eq!(&taken, &model.remove(&tag).unwrap_or_default());
                        agenda.recycle(taken);
                    }
                    3 => {
                        agenda.truncate(tag);
                        model.retain(|other, _| *other <= tag);
                    }
                    _ => {
                        let out: Vec<_> = model
                            .iter_mut()
                            .flat_map(|(tag, entries)| {
                                entries.extract_if(.., |e| *e % 2 == 0).map(|e| (*tag, e))
                            })
                            .collect();
                        model.retain(|_, entries| !entries.is_empty());
                        prop_assert_eq!(agenda.extract(|e| *e % 2 == 0), out);
                    }
                }
                prop_assert_eq!(agenda.first(), model.keys().next().copied());
                for time in 0..6 {
                    let expected = model.get(&at(time)).cloned().unwrap_or_default();
                    prop_assert_eq!(agenda.at(at(time)), expected.as_slice());
                    prop_assert_eq!(agenda.at_mut(at(time)), expected.as_slice());
                }
                let all: Vec<_> = model.values().flatten().copied().collect();
                prop_assert_eq!(agenda.entries().copied().collect::<Vec<_>>(), all);
            }
        }
    }
}
