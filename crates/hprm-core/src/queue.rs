//! The event queue: what is to happen, by tag.
//!
//! Events of one tag keep the order in which they were inserted, but nothing depends on it: two
//! events of one trigger never share a tag, and reactions run by level.

use std::collections::BTreeMap;

use crate::{ActionId, PortId, Tag, TimerId};

/// What makes something present at a tag.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(crate) enum Event<V> {
    Timer(TimerId),
    Action {
        action: ActionId,
        value: Option<V>,
    },
    /// A message at a network input or at the end of a delayed connection. `intended` is its own
    /// tag, if it came too late for it.
    Message {
        port: PortId,
        value: V,
        intended: Option<Tag>,
    },
}

impl<V> Event<V> {
    fn is_of(&self, trigger: ActionId) -> bool {
        matches!(self, Self::Action { action, .. } if *action == trigger)
    }

    fn is_same_trigger(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Timer(a), Self::Timer(b)) => a == b,
            (Self::Action { action: a, .. }, Self::Action { action: b, .. }) => a == b,
            (Self::Message { port: a, .. }, Self::Message { port: b, .. }) => a == b,
            _ => false,
        }
    }
}

#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(crate) struct EventQueue<V> {
    events: BTreeMap<Tag, Vec<Event<V>>>,
}

impl<V> EventQueue<V> {
    pub(crate) const fn new() -> Self {
        Self { events: BTreeMap::new() }
    }

    /// The tag of the earliest event.
    pub(crate) fn first(&self) -> Option<Tag> {
        self.events.keys().next().copied()
    }

    pub(crate) fn insert(&mut self, tag: Tag, event: Event<V>) {
        self.events.entry(tag).or_default().push(event);
    }

    /// Inserts at `tag`, or at the next microstep at which the same trigger has no event yet:
    /// events pile up in superdense time and never merge. Returns where it ended.
    pub(crate) fn pile(&mut self, mut tag: Tag, event: Event<V>) -> Tag {
        while self.events.get(&tag).is_some_and(|at| at.iter().any(|e| e.is_same_trigger(&event))) {
            tag = tag.succ();
        }
        self.insert(tag, event);
        tag
    }

    /// Whether an event of the action waits at `tag`.
    pub(crate) fn holds(&self, tag: Tag, action: ActionId) -> bool {
        self.events.get(&tag).is_some_and(|at| at.iter().any(|event| event.is_of(action)))
    }

    /// Gives the action's event at `tag` another value. Returns the one that it had.
    pub(crate) fn replace(&mut self, tag: Tag, action: ActionId, new: Option<V>) -> Option<V> {
        let event = self.events.get_mut(&tag)?.iter_mut().find(|event| event.is_of(action))?;
        match event {
            Event::Action { value, .. } => std::mem::replace(value, new),
            Event::Timer(_) | Event::Message { .. } => None,
        }
    }

    /// Removes the action's event at `tag`. Returns its value.
    pub(crate) fn remove(&mut self, tag: Tag, action: ActionId) -> Option<V> {
        let at = self.events.get_mut(&tag)?;
        let event = at.remove(at.iter().position(|event| event.is_of(action))?);
        if at.is_empty() {
            self.events.remove(&tag);
        }
        match event {
            Event::Action { value, .. } => value,
            Event::Timer(_) | Event::Message { .. } => None,
        }
    }

    /// Removes the events of `tag`.
    pub(crate) fn take(&mut self, tag: Tag) -> Vec<Event<V>> {
        self.events.remove(&tag).unwrap_or_default()
    }

    /// Forgets everything after `tag`.
    pub(crate) fn truncate(&mut self, tag: Tag) {
        if tag != Tag::FOREVER {
            self.events.split_off(&tag.succ());
        }
    }
}
