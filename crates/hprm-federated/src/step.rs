//! A point within a tag: how far a federate has got with the levels of its reactions.
//!
//! Federates that send to one another on a cycle without a delay cannot wait for all messages of a
//! tag before they begin it. But the reactions of the whole program have levels, and a message leads
//! from a level to a higher one; so such federates take turns by level, as reactions in one process
//! do. For all others a step is as good as its tag.

use hprm_core::{Channel, Delay, FederateId, Tag};
use serde::{Deserialize, Serialize};

/// A level of a tag.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug, Serialize, Deserialize)]
pub struct Step {
    /// The tag.
    pub tag: Tag,
    /// The level; [`u32::MAX`] comes after all reactions.
    pub level: u32,
}

impl Step {
    /// Before everything.
    pub const NEVER: Self = Self { tag: Tag::NEVER, level: 0 };

    /// After everything.
    pub const FOREVER: Self = Self { tag: Tag::FOREVER, level: u32::MAX };

    /// The first step of a tag.
    #[must_use]
    pub const fn begin(tag: Tag) -> Self {
        match tag {
            Tag::FOREVER => Self::FOREVER,
            tag => Self { tag, level: 0 },
        }
    }

    /// The last step of a tag: all of it.
    #[must_use]
    pub const fn end(tag: Tag) -> Self {
        Self { tag, level: u32::MAX }
    }

    /// The step before this one.
    #[must_use]
    pub fn pred(self) -> Self {
        match self {
            Self::NEVER | Self::FOREVER => self,
            Self { tag, level: 0 } => Self::end(tag.pred()),
            Self { tag, level } => Self { tag, level: level - 1 },
        }
    }

    /// The latest tag of which all steps are at or before this one.
    #[must_use]
    pub fn whole(self) -> Tag {
        if self.level == u32::MAX { self.tag } else { self.tag.pred() }
    }
}

/// A neighbour of a federate, and what messages have to go through to get there.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub struct Edge {
    /// The federate at the other end.
    pub federate: FederateId,
    /// The least delay of the logical channels between the two, in this direction.
    pub delay: Delay,
    /// The least delay of those that have one.
    delayed: Option<Delay>,
    /// The levels of the last writer and the first reader of those that have none.
    direct: Vec<(u32, u32)>,
}

impl Edge {
    /// An edge to `federate` that takes no channel yet.
    pub(crate) fn new(federate: FederateId, channel: &Channel) -> Self {
        let mut edge = Self { federate, delay: channel.delay, delayed: None, direct: Vec::new() };
        edge.add(channel);
        edge
    }

    /// Adds a channel.
    pub(crate) fn add(&mut self, channel: &Channel) {
        self.delay = self.delay.min(channel.delay);
        if channel.is_direct() {
            self.direct.push((channel.last_writer, channel.first_reader));
        } else {
            let least = self.delayed.map_or(channel.delay, |delay| delay.min(channel.delay));
            self.delayed = Some(least);
        }
    }

    /// The earliest step that a message can have at the receiver, if the sender does nothing before
    /// `from`. It is after `from`.
    #[must_use]
    pub fn shift(&self, from: Step) -> Step {
        if from.tag == Tag::FOREVER {
            return Step::FOREVER;
        }
        let later = self.delayed.map(|delay| Step::begin(delay.shift(from.tag)));
        let in_time = self.direct.iter().filter(|(writer, _)| *writer >= from.level);
        let first_reader = in_time.map(|(_, reader)| *reader).min();
        let direct = match first_reader {
            Some(level) => Some(Step { tag: from.tag, level }),
            None if self.direct.is_empty() => None,
            None => {
                let level = self.direct.iter().map(|(_, reader)| *reader).min().unwrap_or(0);
                Some(Step { tag: from.tag.succ(), level })
            }
        };
        later.into_iter().chain(direct).min().unwrap_or(Step::FOREVER)
    }
}

#[cfg(test)]
mod tests {
    use hprm_core::{ChannelId, ConnectionId};

    use super::*;

    fn channel(delay: Delay, last_writer: u32, first_reader: u32) -> Channel {
        let (from, to) = (FederateId(0), FederateId(1));
        let _ = ChannelId(0);
        let connection = ConnectionId(0);
        Channel { connection, from, to, delay, physical: false, last_writer, first_reader }
    }

    #[test]
    fn a_message_comes_at_the_first_reader_that_can_still_be_reached() {
        let mut edge = Edge::new(FederateId(1), &channel(Delay::None, 2, 3));
        edge.add(&channel(Delay::None, 6, 9));
        let at = |time, level| Step { tag: Tag::new(time, 0), level };
        assert_eq!(edge.shift(at(5, 0)), at(5, 3));
        assert_eq!(edge.shift(at(5, 2)), at(5, 3));
        assert_eq!(edge.shift(at(5, 3)), at(5, 9));
        assert_eq!(edge.shift(at(5, 7)), Step { tag: Tag::new(5, 1), level: 3 });
        edge.add(&channel(Delay::Microstep, 8, 1));
        assert_eq!(edge.shift(at(5, 7)), Step { tag: Tag::new(5, 1), level: 0 });
        assert_eq!(edge.shift(Step::FOREVER), Step::FOREVER);
    }

    #[test]
    fn steps_count_within_tags() {
        let tag = Tag::new(5, 0);
        assert_eq!(Step::begin(tag).pred(), Step::end(tag.pred()));
        assert_eq!(Step::end(tag).whole(), tag);
        assert_eq!(Step { tag, level: 4 }.whole(), tag.pred());
        assert_eq!(Step { tag, level: 4 }.pred(), Step { tag, level: 3 });
    }
}
