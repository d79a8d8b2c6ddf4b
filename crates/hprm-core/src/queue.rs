//! The event queue: what is to happen, by tag.
//!
//! Events of one tag keep the order in which they were inserted, but nothing depends on it: two
//! events of one trigger never share a tag, and reactions run by level.

use std::collections::BTreeMap;
use std::hash::{Hash, Hasher};

use crate::{ActionId, ConnectionId, Tag, TimerId};

/// The most vectors that are kept for later. A program that has more tags waiting than this returns
/// the rest of its memory.
const MOST_SPARE: usize = 64;

/// What makes something present at a tag.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(crate) enum Event<V> {
    Timer(TimerId),
    Action {
        action: ActionId,
        value: Option<V>,
    },
    /// A message at the end of a connection. `intended` is its own tag, if it came too late for it.
    Message {
        connection: ConnectionId,
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
            (Self::Message { connection: a, .. }, Self::Message { connection: b, .. }) => a == b,
            _ => false,
        }
    }
}

#[derive(Clone, Debug)]
pub(crate) struct EventQueue<V> {
    events: BTreeMap<Tag, Vec<Event<V>>>,
    /// Empty vectors of tags that have passed, for tags to come: a periodic program allocates
    /// nothing once it has warmed up, unless so many tags wait that the tree grows and shrinks.
    spare: Vec<Vec<Event<V>>>,
}

// What is spare is no part of the state.
impl<V: PartialEq> PartialEq for EventQueue<V> {
    fn eq(&self, other: &Self) -> bool {
        self.events == other.events
    }
}

impl<V: Eq> Eq for EventQueue<V> {}

impl<V: Hash> Hash for EventQueue<V> {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.events.hash(state);
    }
}

impl<V> EventQueue<V> {
    pub(crate) const fn new() -> Self {
        Self { events: BTreeMap::new(), spare: Vec::new() }
    }

    /// The tag of the earliest event.
    pub(crate) fn first(&self) -> Option<Tag> {
        self.events.keys().next().copied()
    }

    pub(crate) fn insert(&mut self, tag: Tag, event: Event<V>) {
        let spare = &mut self.spare;
        self.events.entry(tag).or_insert_with(|| spare.pop().unwrap_or_default()).push(event);
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
            let empty = self.take(tag);
            self.recycle(empty);
        }
        match event {
            Event::Action { value, .. } => value,
            Event::Timer(_) | Event::Message { .. } => None,
        }
    }

    /// Removes the events of `tag`. The vector may be given back with [`Self::recycle`].
    pub(crate) fn take(&mut self, tag: Tag) -> Vec<Event<V>> {
        self.events.remove(&tag).unwrap_or_default()
    }

    /// Keeps the memory of a vector for tags to come.
    pub(crate) fn recycle(&mut self, mut events: Vec<Event<V>>) {
        events.clear();
        if events.capacity() > 0 && self.spare.len() < MOST_SPARE {
            self.spare.push(events);
        }
    }

    /// Whether an event of the timer waits.
    pub(crate) fn holds_timer(&self, timer: TimerId) -> bool {
        let is_it = |event: &Event<V>| matches!(event, Event::Timer(other) if *other == timer);
        self.events.values().flatten().any(is_it)
    }

    /// Removes all events that satisfy the condition, in their order.
    pub(crate) fn extract(
        &mut self,
        mut condition: impl FnMut(&Event<V>) -> bool,
    ) -> Vec<(Tag, Event<V>)> {
        let mut extracted = Vec::new();
        self.events.retain(|tag, events| {
            extracted
                .extend(events.extract_if(.., |event| condition(event)).map(|event| (*tag, event)));
            !events.is_empty()
        });
        extracted
    }

    /// Forgets everything after `tag`.
    pub(crate) fn truncate(&mut self, tag: Tag) {
        if tag != Tag::FOREVER {
            self.events.split_off(&tag.succ());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spare_memory_is_no_part_of_the_state() {
        let (mut used, fresh) = (EventQueue::<()>::new(), EventQueue::new());
        used.insert(Tag::START, Event::Timer(TimerId(0)));
        assert_ne!(used, fresh);
        let events = used.take(Tag::START);
        used.recycle(events);
        assert_eq!(used.spare.len(), 1);
        assert_eq!(used, fresh);
        used.insert(Tag::START, Event::Timer(TimerId(0)));
        assert!(used.spare.is_empty());
    }

    #[test]
    fn removing_the_only_event_of_a_tag_removes_the_tag() {
        let mut queue = EventQueue::new();
        queue.insert(Tag::START, Event::Action { action: ActionId(1), value: Some('a') });
        assert_eq!(queue.replace(Tag::START, ActionId(1), None), Some('a'));
        assert_eq!(queue.replace(Tag::START, ActionId(2), Some('b')), None);
        assert!(queue.holds(Tag::START, ActionId(1)) && !queue.holds(Tag::START, ActionId(2)));
        assert_eq!(queue.remove(Tag::START, ActionId(1)), None);
        assert_eq!(queue.first(), None);
    }
}
