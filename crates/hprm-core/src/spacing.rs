//! Minimum spacing: how close two events of one action may be, and what happens to an event that is
//! closer.
//!
//! Distances are between the tags that events were given, not between the calls that scheduled
//! them (handbook, "actions"). The scheduler remembers the tags and applies the policy.

use serde::{Deserialize, Serialize};

use crate::{Nanos, Tag};

/// The least time between two events of an action.
///
/// An action without a spacing differs from one with a spacing of zero: events for the same tag get later
/// microsteps, however many there are.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub struct Spacing {
    /// The least time.
    pub min: Nanos,
    /// What happens to an event that is closer.
    pub policy: Policy,
}

/// What happens to an event that is too close to the latest one of its action.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Default, Serialize, Deserialize)]
pub enum Policy {
    /// It happens later, at the least distance.
    #[default]
    Defer,
    /// It does not happen.
    Drop,
    /// Its value replaces that of the latest event, if that has not happened yet; otherwise as `Defer`.
    Replace,
    /// It happens at its own tag, and the latest event is removed, if it has not happened yet.
    Update,
}

impl Spacing {
    /// Whether an event at `tag` is far enough from the latest one, at `last`.
    pub(crate) fn allows(self, last: Tag, tag: Tag) -> bool {
        let earliest = self.earliest(last).time;
        earliest < tag.time || earliest == tag.time && self.min > 0
    }

    /// The first tag that a deferred event may have.
    pub(crate) fn earliest(self, last: Tag) -> Tag {
        match last.time.checked_add(self.min) {
            Some(Nanos::MAX) | None => Tag::FOREVER,
            Some(time) => Tag::new(time, 0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_positive_spacing_allows_its_own_distance() {
        let spacing = |min| Spacing { min, policy: Policy::Defer };
        let (last, at) = (Tag::new(5, 1), |time| Tag::new(time, 0));
        assert!(spacing(10).allows(last, at(15)) && !spacing(10).allows(last, at(14)));
        assert!(spacing(0).allows(last, at(6)) && !spacing(0).allows(last, at(5)));
        assert!(!spacing(Nanos::MAX).allows(last, at(Nanos::MAX - 1)));
        assert_eq!(spacing(Nanos::MAX).earliest(last), Tag::FOREVER);
    }
}
