//! The event queue: future events, by tag.
//!
//! Events of one tag keep the order in which they were inserted, but nothing depends on it: two
//! events of one trigger never share a tag, and reactions run by level.

use crate::tag_map::TagMap;
use crate::{ActionId, ConnectionId, Tag, TimerId};
use alloc::vec::Vec;

/// What makes a port, an action or a timer present at a tag.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(crate) enum QueuedEvent<V> {
    Timer(TimerId),
    Action {
        action: ActionId,
        value: Option<V>,
        /// Whether it stems from the physical world, as far as that is recorded.
        physical: bool,
    },
    /// A message at the end of a connection. `intended` is its own tag, if it came too late for it.
    Message {
        connection: ConnectionId,
        /// None once it has been taken.
        value: Option<V>,
        intended: Option<Tag>,
        /// Whether it stems from the physical world, as far as that is recorded.
        physical: bool,
    },
}

impl<V> QueuedEvent<V> {
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

#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(crate) struct EventQueue<V> {
    events: TagMap<QueuedEvent<V>>,
}

impl<V> EventQueue<V> {
    pub(crate) const fn new() -> Self {
        Self { events: TagMap::new() }
    }

    /// The tag of the earliest event.
    pub(crate) fn first(&self) -> Option<Tag> {
        self.events.first()
    }

    /// Inserts an event of a timer.
    #[inline(always)]
    pub(crate) fn insert_timer(&mut self, tag: Tag, timer: TimerId) {
        self.events.push_made(tag, || QueuedEvent::Timer(timer));
    }

    pub(crate) fn insert(&mut self, tag: Tag, event: QueuedEvent<V>) {
        self.events.push(tag, event);
    }

    /// Inserts an event of an action at `tag`, or at the first later microstep at which the action has no event yet:
    /// events are never merged, but follow one another in superdense time. Returns the tag.
    #[inline(always)]
    pub(crate) fn insert_action(
        &mut self,
        tag: Tag,
        action: ActionId,
        value: Option<V>,
        physical: bool,
    ) -> Tag {
        let event = || QueuedEvent::Action { action, value, physical };
        self.events.push_at_free_microstep(tag, |other| other.is_of(action), event)
    }

    /// The same for any event.
    pub(crate) fn insert_at_free_microstep(&mut self, tag: Tag, event: QueuedEvent<V>) -> Tag {
        let tag = self.events.free_microstep(tag, |other| event.is_same_trigger(other));
        self.insert(tag, event);
        tag
    }

    /// Whether an event of the action waits at `tag`.
    pub(crate) fn holds(&self, tag: Tag, action: ActionId) -> bool {
        self.events.at(tag).iter().any(|event| event.is_of(action))
    }

    /// Gives the action's event at `tag` another value. Returns the one that it had.
    pub(crate) fn replace(
        &mut self,
        tag: Tag,
        action: ActionId,
        (new, marked): (Option<V>, bool),
    ) -> Option<V> {
        match self.events.at_mut(tag).iter_mut().find(|event| event.is_of(action))? {
            QueuedEvent::Action { value, physical, .. } => {
                *physical |= marked;
                core::mem::replace(value, new)
            }
            QueuedEvent::Timer(_) | QueuedEvent::Message { .. } => None,
        }
    }

    /// Removes the action's event at `tag`. Returns its value.
    pub(crate) fn remove(&mut self, tag: Tag, action: ActionId) -> Option<V> {
        let mut events = self.events.spare();
        self.take(tag, &mut events);
        let removed = events.iter().position(|event| event.is_of(action)).map(|i| events.remove(i));
        for event in events.drain(..) {
            self.insert(tag, event);
        }
        self.events.recycle(events);
        match removed? {
            QueuedEvent::Action { value, .. } => value,
            QueuedEvent::Timer(_) | QueuedEvent::Message { .. } => None,
        }
    }

    /// Removes the message of the connection at `tag`.
    pub(crate) fn remove_message(&mut self, tag: Tag, of: ConnectionId) {
        let mut events = self.events.spare();
        self.take(tag, &mut events);
        events.retain(
            |event| !matches!(event, QueuedEvent::Message { connection, .. } if *connection == of),
        );
        for event in events.drain(..) {
            self.insert(tag, event);
        }
        self.events.recycle(events);
    }

    /// How many tags have events.
    pub(crate) fn tags(&self) -> usize {
        self.events.tags()
    }

    /// How many messages of the connection wait.
    pub(crate) fn count_messages(&self, of: ConnectionId) -> usize {
        let messages = self.events.entries().filter(
            |event| matches!(event, QueuedEvent::Message { connection, .. } if *connection == of),
        );
        messages.count()
    }

    /// Exchanges the events of `tag` for an empty vector, whose memory is used for future tags.
    #[inline]
    pub(crate) fn take(&mut self, tag: Tag, events: &mut Vec<QueuedEvent<V>>) {
        self.events.take(tag, events);
    }

    /// Whether an event of the timer waits.
    pub(crate) fn holds_timer(&self, timer: TimerId) -> bool {
        self.events
            .entries()
            .any(|event| matches!(event, QueuedEvent::Timer(other) if *other == timer))
    }

    /// Removes all events that satisfy the condition, in their order.
    pub(crate) fn extract(
        &mut self,
        condition: impl FnMut(&QueuedEvent<V>) -> bool,
    ) -> Vec<(Tag, QueuedEvent<V>)> {
        self.events.extract(condition)
    }

    /// Removes all events after `tag`.
    pub(crate) fn truncate(&mut self, tag: Tag) {
        self.events.truncate(tag);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn removing_the_only_event_of_a_tag_removes_the_tag() {
        let mut queue = EventQueue::new();
        let event = QueuedEvent::Action { action: ActionId(1), value: Some('a'), physical: false };
        queue.insert(Tag::START, event);
        assert_eq!(queue.replace(Tag::START, ActionId(1), (None, true)), Some('a'));
        assert_eq!(queue.replace(Tag::START, ActionId(2), (Some('b'), false)), None);
        assert!(queue.holds(Tag::START, ActionId(1)) && !queue.holds(Tag::START, ActionId(2)));
        assert_eq!(queue.remove(Tag::START, ActionId(1)), None);
        assert_eq!(queue.first(), None);
    }
}
