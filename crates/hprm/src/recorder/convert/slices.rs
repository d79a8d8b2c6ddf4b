//! Which slices are open on each track: so that they nest, also where records are missing.

use std::collections::HashMap;

/// The open slices of all tracks, from the outer to the inner: the numbers of their reactions.
#[derive(Default)]
pub(super) struct Slices {
    open: HashMap<u32, Vec<u32>>,
}

impl Slices {
    /// A slice begins.
    pub(super) fn begin(&mut self, track: u32, reaction: u32) {
        self.open.entry(track).or_default().push(reaction);
    }

    /// A slice ends. Returns how many ends have to be written: none if its beginning is missing, and more than one if
    /// ends of slices inside it are missing.
    pub(super) fn end(&mut self, track: u32, reaction: u32) -> usize {
        let open = self.open.entry(track).or_default();
        let Some(place) = open.iter().rposition(|it| *it == reaction) else { return 0 };
        let ends = open.len() - place;
        open.truncate(place);
        ends
    }

    /// All slices of a track end. Returns how many.
    pub(super) fn end_all(&mut self, track: u32) -> usize {
        self.open.remove(&track).map_or(0, |open| open.len())
    }
}
