//! Bounds of physical connections: how many messages may wait for their receiver, and what happens to one
//! that is too many.
//!
//! A message waits from its arrival until its tag is processed. The scheduler applies the policies that drop
//! messages, so they are the same within a process, between processes and between threads. That a sender
//! waits is up to the coordination; [`blocking`] says where it may.

pub(crate) mod blocking;

use alloc::collections::VecDeque;

use serde::{Deserialize, Serialize};

use crate::{ConnectionId, Tag};

/// How many messages of a physical connection may wait.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub struct Bound {
    /// The largest number; at least one.
    pub messages: u32,
    /// What happens to a message that is too many.
    pub overflow: Overflow,
}

/// What happens when a message arrives and as many as may wait are waiting.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Default, Serialize, Deserialize)]
pub enum Overflow {
    /// The message that arrives is dropped.
    #[default]
    Drop,
    /// The message that has waited longest is dropped.
    Replace,
    /// No such message arrives: the sender waits until there is room.
    Block,
}

/// The messages of one bounded connection that wait.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Default)]
pub(crate) struct Waiting {
    /// Their tags, which increase.
    tags: VecDeque<Tag>,
    dropped: u64,
}

/// What to do with a message that has arrived.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Admission {
    /// There is room.
    Insert,
    /// The message is dropped.
    Drop,
    /// The waiting message of that tag is dropped, and there is room.
    Displace(Tag),
}

impl Waiting {
    /// Counts a message that has arrived, and decides what to do with it.
    pub(crate) fn admit(&mut self, bound: Bound) -> Admission {
        if bound.overflow == Overflow::Block || self.tags.len() < bound.messages.max(1) as usize {
            return Admission::Insert;
        }
        self.dropped += 1;
        match (bound.overflow, self.tags.pop_front()) {
            (Overflow::Replace, Some(oldest)) => Admission::Displace(oldest),
            (_, oldest) => {
                self.tags.extend(oldest);
                self.tags.rotate_right(usize::from(oldest.is_some()));
                Admission::Drop
            }
        }
    }

    /// A message waits at `tag`, which is after those of all others.
    pub(crate) fn inserted(&mut self, tag: Tag) {
        self.tags.push_back(tag);
    }

    /// The message at `tag` is suspended with the mode of its connection, and does not wait for its receiver.
    pub(crate) fn suspended(&mut self, tag: Tag) {
        self.tags.retain(|waiting| *waiting != tag);
    }

    /// A message that was suspended waits again, at `tag`.
    pub(crate) fn resumed(&mut self, tag: Tag) {
        let at = self.tags.partition_point(|waiting| *waiting < tag);
        self.tags.insert(at, tag);
    }

    /// The messages through `tag` have been processed.
    pub(crate) fn processed(&mut self, tag: Tag) {
        while self.tags.front().is_some_and(|first| *first <= tag) {
            self.tags.pop_front();
        }
    }

    /// How many messages have been dropped.
    pub(crate) fn dropped(&self) -> u64 {
        self.dropped
    }
}

/// So many messages of a physical connection without a bound wait when its receiver counts as too slow.
pub const LARGE_BACKLOG: usize = 1_000;

/// Looks for a physical connection without a bound for which many messages wait. To count them takes a
/// pass over the event queue, so that is done only when the queue has grown.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(crate) struct BacklogWatch {
    /// How many tags the queue has when the messages are counted.
    count_at: usize,
    found: Option<ConnectionId>,
}

impl BacklogWatch {
    pub(crate) const fn new() -> Self {
        Self { count_at: LARGE_BACKLOG, found: None }
    }

    /// The first such connection that was found.
    pub(crate) fn found(&self) -> Option<ConnectionId> {
        self.found
    }

    /// A message of `connection` was added to a queue that has so many `tags` now. `count` counts the
    /// messages of the connection that wait.
    pub(crate) fn added(
        &mut self,
        connection: ConnectionId,
        tags: usize,
        count: impl FnOnce() -> usize,
    ) {
        if tags < self.count_at {
            return;
        }
        let messages = count();
        if messages >= LARGE_BACKLOG {
            (self.found, self.count_at) = (Some(connection), usize::MAX);
        } else {
            self.count_at = tags + (LARGE_BACKLOG - messages).max(tags / 16);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filled(overflow: Overflow) -> (Waiting, Bound) {
        let (mut waiting, bound) = (Waiting::default(), Bound { messages: 2, overflow });
        for time in [1, 2] {
            assert_eq!(waiting.admit(bound), Admission::Insert);
            waiting.inserted(Tag::new(time, 0));
        }
        (waiting, bound)
    }

    #[test]
    fn a_message_that_is_too_many_is_dropped_until_one_is_processed() {
        let (mut waiting, bound) = filled(Overflow::Drop);
        assert_eq!(waiting.admit(bound), Admission::Drop);
        assert_eq!(waiting.admit(bound), Admission::Drop);
        assert_eq!(waiting.dropped(), 2);
        waiting.processed(Tag::new(1, 0));
        assert_eq!(waiting.admit(bound), Admission::Insert);
        waiting.inserted(Tag::new(3, 0));
        assert_eq!(waiting.admit(bound), Admission::Drop);
        waiting.processed(Tag::new(3, 0));
        assert_eq!(waiting, Waiting { tags: VecDeque::new(), dropped: 3 });
    }

    #[test]
    fn the_oldest_message_makes_room_for_a_new_one() {
        let (mut waiting, bound) = filled(Overflow::Replace);
        for time in 3..9 {
            assert_eq!(waiting.admit(bound), Admission::Displace(Tag::new(time - 2, 0)));
            waiting.inserted(Tag::new(time, 0));
        }
        assert_eq!((waiting.tags.len(), waiting.dropped()), (2, 6));
    }

    #[test]
    fn a_backlog_is_found_once_and_counted_rarely() {
        let [slow, other] = [ConnectionId(3), ConnectionId(4)];
        let (mut watch, mut counts) = (BacklogWatch::new(), 0);
        for tags in 1..LARGE_BACKLOG {
            watch.added(slow, tags, || unreachable!("there are too few tags"));
        }
        // Many tags, but of other events.
        for tags in LARGE_BACKLOG..4 * LARGE_BACKLOG {
            watch.added(other, tags, || {
                counts += 1;
                5
            });
        }
        assert_eq!((counts, watch.found()), (4, None));
        watch.added(slow, 8 * LARGE_BACKLOG, || LARGE_BACKLOG);
        assert_eq!(watch.found(), Some(slow));
        watch.added(other, usize::MAX - 1, || unreachable!("it is found already"));
    }
}
