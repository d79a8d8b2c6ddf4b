//! Tags, delays and physical time: the algebra that everything else computes with.
//!
//! A [`Tag`] is a point in superdense time, counted from the start of the program. A [`Delay`] is
//! what an `after` clause does to a tag. A [`PhysicalTime`] is the reading of a clock. Permissions
//! to advance are not tags; they live with the coordination.

use core::cmp::Ordering;
use core::fmt;

use serde::{Deserialize, Serialize};

/// A length of time in nanoseconds. Lingua Franca's `forever` is [`i64::MAX`].
pub type Nanos = i64;

/// A point in superdense time, relative to the start of the program.
///
/// Tags are ordered by time, then by microstep (handbook, "superdense time").
#[derive(Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Tag {
    /// Nanoseconds since the start of the program.
    pub time: Nanos,
    /// Index among the steps that take no time.
    pub microstep: u32,
}

impl Tag {
    /// Before every tag that a program can reach.
    pub const NEVER: Self = Self { time: Nanos::MIN, microstep: 0 };
    /// The tag of `startup`.
    pub const START: Self = Self { time: 0, microstep: 0 };
    /// After every tag that a program can reach.
    pub const FOREVER: Self = Self { time: Nanos::MAX, microstep: u32::MAX };

    /// The tag `(time, microstep)`.
    #[must_use]
    pub const fn new(time: Nanos, microstep: u32) -> Self {
        Self { time, microstep }
    }

    /// The next tag: one microstep later. `NEVER` and `FOREVER` stay what they are.
    #[must_use]
    #[inline]
    pub fn succ(self) -> Self {
        if self == Self::NEVER || self == Self::FOREVER {
            return self;
        }
        match self.microstep.checked_add(1) {
            Some(microstep) => Self { time: self.time, microstep },
            None => Self { time: self.time.saturating_add(1), microstep: 0 },
        }
    }

    /// The latest tag before this one. `NEVER` and `FOREVER` stay what they are.
    #[must_use]
    #[inline]
    pub fn pred(self) -> Self {
        if self == Self::NEVER || self == Self::FOREVER {
            return self;
        }
        match self.microstep.checked_sub(1) {
            Some(microstep) => Self { time: self.time, microstep },
            None => Self { time: self.time.saturating_sub(1), microstep: u32::MAX },
        }
    }

    /// The physical time at which this tag is due in a program that started at `start`.
    #[must_use]
    #[inline]
    pub fn due(self, start: PhysicalTime) -> PhysicalTime {
        start.plus(self.time)
    }
}

// Tags are compared several times at each tag. As one number that takes two instructions, and no
// branch; field by field it takes a dozen.
impl Ord for Tag {
    #[inline]
    fn cmp(&self, other: &Self) -> Ordering {
        let number = |tag: &Self| i128::from(tag.time) << 64 | i128::from(tag.microstep);
        number(self).cmp(&number(other))
    }
}

impl PartialOrd for Tag {
    #[inline]
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl fmt::Display for Tag {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::NEVER => f.write_str("never"),
            Self::FOREVER => f.write_str("forever"),
            Self { time, microstep } => write!(f, "({time} ns, {microstep})"),
        }
    }
}

impl fmt::Debug for Tag {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// What a connection adds to the tag of a message.
///
/// `after 0` is [`Delay::Microstep`], and no `after` at all is [`Delay::None`]: two different
/// things with two different names (handbook, "after").
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug, Serialize, Deserialize)]
pub enum Delay {
    /// No `after`: the message has the tag at which it was sent.
    None,
    /// `after 0`: one microstep later.
    Microstep,
    /// `after d`, with `d > 0` nanoseconds: microstep zero, `d` later.
    Time(Nanos),
}

impl Delay {
    /// The delay that `after nanos` denotes; a negative number counts as zero.
    #[must_use]
    pub fn after(nanos: Nanos) -> Self {
        if nanos > 0 { Self::Time(nanos) } else { Self::Microstep }
    }

    /// The tag of a message sent at `tag`. Monotone in `tag`.
    ///
    /// ```
    /// use hprm_core::{Delay, Tag};
    /// assert_eq!(Delay::None.shift(Tag::new(5, 2)), Tag::new(5, 2));
    /// assert_eq!(Delay::Microstep.shift(Tag::new(5, 2)), Tag::new(5, 3));
    /// assert_eq!(Delay::Time(10).shift(Tag::new(5, 2)), Tag::new(15, 0));
    /// ```
    #[must_use]
    #[inline]
    pub fn shift(self, tag: Tag) -> Tag {
        if tag == Tag::NEVER || tag == Tag::FOREVER {
            return tag;
        }
        match self {
            Self::None => tag,
            Self::Microstep => tag.succ(),
            Self::Time(nanos) => match tag.time.checked_add(nanos) {
                Some(Nanos::MAX) | None => Tag::FOREVER,
                Some(time) => Tag { time, microstep: 0 },
            },
        }
    }

    /// The latest tag at which nothing can arrive any more once the sender has completed `tag`:
    /// just before the earliest message of its next tag.
    ///
    /// ```
    /// use hprm_core::{Delay, Tag};
    /// assert_eq!(Delay::None.horizon(Tag::new(5, 2)), Tag::new(5, 2));
    /// assert_eq!(Delay::Microstep.horizon(Tag::new(5, 2)), Tag::new(5, 3));
    /// assert_eq!(Delay::Time(10).horizon(Tag::new(5, 2)), Tag::new(14, u32::MAX));
    /// ```
    #[must_use]
    #[inline]
    pub fn horizon(self, tag: Tag) -> Tag {
        if tag == Tag::NEVER || tag == Tag::FOREVER {
            return tag;
        }
        self.shift(tag.succ()).pred()
    }
}

/// The reading of a physical clock, in nanoseconds since the Unix epoch.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug, Serialize, Deserialize)]
pub struct PhysicalTime(pub i64);

/// What a clock shows: a time that has been read, or a function that reads it if it matters, which
/// it does not for most of what a program does.
pub trait Reading {
    /// The time.
    fn read(self) -> PhysicalTime;
}

impl Reading for PhysicalTime {
    fn read(self) -> PhysicalTime {
        self
    }
}

impl<F: FnOnce() -> PhysicalTime> Reading for F {
    fn read(self) -> PhysicalTime {
        self()
    }
}

impl PhysicalTime {
    /// A time that no clock reaches.
    pub const FOREVER: Self = Self(i64::MAX);

    /// This time, `nanos` later; saturates.
    #[must_use]
    #[inline]
    pub const fn plus(self, nanos: Nanos) -> Self {
        Self(self.0.saturating_add(nanos))
    }

    /// The time from `earlier` to this one; saturates.
    #[must_use]
    #[inline]
    pub const fn since(self, earlier: Self) -> Nanos {
        self.0.saturating_sub(earlier.0)
    }

    /// The first multiple of `interval` that is not before this time; this time, if `interval` is not
    /// positive.
    #[must_use]
    pub const fn next_multiple(self, interval: Nanos) -> Self {
        if interval <= 0 {
            return self;
        }
        match self.0.rem_euclid(interval) {
            0 => self,
            past => self.plus(interval - past),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::{Delay, PhysicalTime, Tag};

    #[test]
    fn the_next_multiple_is_not_before() {
        let next = |at, interval| PhysicalTime(at).next_multiple(interval).0;
        assert_eq!([next(19, 10), next(20, 10), next(21, 10), next(-19, 10)], [20, 20, 30, -10]);
        assert_eq!([next(19, 0), next(i64::MAX - 1, 1_000)], [19, i64::MAX]);
    }

    fn tag() -> impl Strategy<Value = Tag> {
        prop_oneof![
            8 => (0_i64..1_000, 0_u32..5).prop_map(|(t, m)| Tag::new(t, m)),
            1 => Just(Tag::new(7, u32::MAX)),
            1 => Just(Tag::new(i64::MAX - 3, 1)),
            1 => Just(Tag::FOREVER),
            1 => Just(Tag::NEVER),
        ]
    }

    fn delay() -> impl Strategy<Value = Delay> {
        prop_oneof![
            Just(Delay::None),
            Just(Delay::Microstep),
            (1_i64..500).prop_map(Delay::Time),
            Just(Delay::Time(i64::MAX)),
        ]
    }

    proptest! {
        #[test]
        fn shift_is_monotone(a in tag(), b in tag(), d in delay()) {
            prop_assert!(a > b || d.shift(a) <= d.shift(b));
        }

        #[test]
        fn shift_never_goes_back(g in tag(), d in delay()) {
            prop_assert!(d.shift(g) >= g);
        }

        #[test]
        fn nothing_sent_later_arrives_within_the_horizon(
            g in tag(), later in tag(), d in delay()
        ) {
            prop_assume!(later > g && g != Tag::NEVER && later != Tag::FOREVER);
            let arrival = d.shift(later);
            prop_assert!(arrival > d.horizon(g) || arrival == Tag::FOREVER);
        }

        #[test]
        fn succ_and_pred_are_inverse(g in tag()) {
            prop_assert_eq!(g.succ().pred(), g);
            prop_assert!(g.succ() > g || g == Tag::FOREVER || g == Tag::NEVER);
        }
    }

    #[test]
    fn a_tag_is_due_after_the_start() {
        assert_eq!(Tag::new(5, 1).due(PhysicalTime(100)), PhysicalTime(105));
        assert_eq!(Tag::FOREVER.due(PhysicalTime(100)), PhysicalTime::FOREVER);
    }

    #[test]
    fn after_zero_is_a_microstep() {
        assert_eq!(Delay::after(0), Delay::Microstep);
        assert_eq!(Delay::after(3), Delay::Time(3));
    }
}
