//! Many short lists in one piece of memory, by id: a scheduler reads them at every tag.

use alloc::vec;
use alloc::vec::Vec;
use core::fmt;
use core::marker::PhantomData;
use core::ops::{Index, Range};

use crate::id::Id;

/// A list of entries for every id.
#[derive(Clone, PartialEq, Eq, Hash)]
pub(crate) struct Lists<I, T> {
    entries: Vec<T>,
    ranges: Vec<Range<u32>>,
    ids: PhantomData<fn() -> I>,
}

impl<I: Id, T: Copy> Lists<I, T> {
    /// Empty lists for the first `len` ids, with the entries appended to them in order.
    pub(crate) fn new(len: usize, entries: impl IntoIterator<Item = (I, T)>) -> Self {
        let mut lists = vec![Vec::new(); len];
        for (id, entry) in entries {
            lists[id.index()].push(entry);
        }
        let mut flat = Self { entries: Vec::new(), ranges: Vec::new(), ids: PhantomData };
        for list in lists {
            let start = flat.end();
            flat.entries.extend(list);
            let end = flat.end();
            flat.ranges.push(start..end);
        }
        flat
    }

    fn end(&self) -> u32 {
        u32::try_from(self.entries.len()).expect("ids count what is listed in u32")
    }
}

impl<I: Id, T> Index<I> for Lists<I, T> {
    type Output = [T];
    fn index(&self, id: I) -> &[T] {
        let Range { start, end } = self.ranges[id.index()];
        &self.entries[start as usize..end as usize]
    }
}

impl<I: Id, T: fmt::Debug> fmt::Debug for Lists<I, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let lists = (0..self.ranges.len()).map(|index| &self[I::from_index(index)]);
        f.debug_list().entries(lists).finish()
    }
}

#[cfg(test)]
mod tests {
    use alloc::format;

    use super::*;
    use crate::PortId;

    #[test]
    fn entries_are_listed_by_id_in_their_order() {
        let entries = [(2, 'a'), (0, 'b'), (2, 'c')].map(|(id, entry)| (PortId(id), entry));
        let lists = Lists::new(3, entries);
        assert_eq!(lists[PortId(0)], ['b']);
        assert_eq!(lists[PortId(1)], []);
        assert_eq!(lists[PortId(2)], ['a', 'c']);
        assert_eq!(format!("{lists:?}"), "[['b'], [], ['a', 'c']]");
    }
}
