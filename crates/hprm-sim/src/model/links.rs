//! The events in transit on each link, oldest first. States share a link until they differ in it.

use std::collections::{BTreeMap, VecDeque};
use std::hash::{Hash, Hasher};

use super::digest::Shared;
use crate::network::{Event, Place};

/// From where to where a link leads.
pub(super) type Ends = (Place, Place);

/// All links that something is in transit on.
#[derive(Clone, Default)]
pub(super) struct Links(BTreeMap<Ends, Shared<VecDeque<Event>>>);

impl Links {
    /// The links, in order.
    pub(super) fn ends(&self) -> impl Iterator<Item = Ends> {
        self.0.keys().copied()
    }

    /// The links, each with what is in transit on it.
    pub(super) fn all(&self) -> impl Iterator<Item = (Ends, &VecDeque<Event>)> {
        self.0.iter().map(|(ends, events)| (*ends, events.get()))
    }

    /// What is in transit on one link.
    pub(super) fn on(&self, ends: Ends) -> impl Iterator<Item = &Event> {
        self.0.get(&ends).into_iter().flat_map(Shared::get)
    }

    /// Sends an event.
    pub(super) fn push(&mut self, ends: Ends, event: Event) {
        match self.0.get_mut(&ends) {
            Some(events) => events.change(|events| events.push_back(event)),
            None => self.replace(ends, event),
        }
    }

    /// The oldest event arrives.
    pub(super) fn pop(&mut self, ends: Ends) -> Option<Event> {
        let link = self.0.get_mut(&ends)?;
        if link.get().len() > 1 {
            return link.change(VecDeque::pop_front);
        }
        self.cut(ends).pop()
    }

    /// Nothing but this event is in transit any more.
    pub(super) fn replace(&mut self, ends: Ends, event: Event) {
        self.0.insert(ends, Shared::new(VecDeque::from([event])));
    }

    /// Nothing is in transit any more; returns what was.
    pub(super) fn cut(&mut self, ends: Ends) -> Vec<Event> {
        self.0.remove(&ends).map(Shared::into_inner).into_iter().flatten().collect()
    }

    /// Nothing is in transit to that place any more.
    pub(super) fn cut_all_to(&mut self, place: Place) {
        self.0.retain(|(_, to), _| *to != place);
    }
}

impl Hash for Links {
    fn hash<H: Hasher>(&self, state: &mut H) {
        for (ends, events) in &self.0 {
            (ends, events.digest()).hash(state);
        }
        self.0.len().hash(state);
    }
}
