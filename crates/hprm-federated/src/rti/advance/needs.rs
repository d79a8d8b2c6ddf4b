//! Which reports are of use: downstream next event tags.
//!
//! A report of a federate is of use if it may let another one advance. Who waits for nothing before
//! some tag needs to hear of nothing that cannot lead to a later one. So a federate whose receivers
//! wait for a far tag, or for none, is told through which tag it may be quiet. It reports again what
//! is beyond, and as soon as it sends something; and it is called when somebody does wait for it.
//!
//! To be told costs a frame, and to be called costs whoever waits a way to and fro. So only those are
//! told that have reported several times in a row and sent nothing; and they must do so for longer, the
//! less came of it before.
//!
//! A federate in a circle without a delay is not told, nor is one before it: within a tag, all that
//! they do is of use. Transient federates join at a tag that follows from reports, so where there are
//! any, nobody is told.

use std::collections::BTreeSet;

use hprm_core::{Coordination, Delay, FederateId, Nanos, Table, Tag};

use super::Advance;
use crate::{Frame, Step, Topology};

/// When federates are told that they may be quiet.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Default)]
pub enum Quieting {
    /// When it seems to save frames.
    #[default]
    Usual,
    /// At each report, if there is any tag through which it may. Costs frames, and shows faults.
    Eager,
    /// Never.
    Off,
}

/// After how many reports in vain a federate is told; the least, and the most.
const PATIENCE: (u32, u32) = (2, 64);

/// How many events are to be left out at least, or it is not worth a frame.
const WORTH: Nanos = 3;

#[derive(Clone, PartialEq, Eq, Hash, Debug)]
struct Spell {
    /// Whether it may ever be quiet.
    eligible: bool,
    /// Through which tag it has been told to be quiet; `NEVER` if it has not.
    through: Tag,
    /// How many messages it has sent.
    sent: u64,
    /// The next event that it has reported last, and the time from the one before.
    latest: Tag,
    stride: Nanos,
    /// Whether it has been told since then.
    told: bool,
    /// Reports since it was told, has sent something, or somebody has waited for it.
    reports: u32,
    /// How many of those it takes.
    patience: u32,
}

/// See the module.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(super) struct Needs {
    mode: Quieting,
    spells: Table<FederateId, Spell>,
    /// How many have been told to be quiet.
    quiet: usize,
    /// For which tag everybody has been called who was in the way of each federate.
    sought: Table<FederateId, Tag>,
    /// Those in whose way somebody quiet may be, and the tags that they want.
    blocked: Vec<(FederateId, Tag)>,
}

impl Needs {
    pub(super) fn new(topology: &Topology, mode: Quieting) -> Self {
        let applies = topology.coordination() == Coordination::Centralized
            && !topology.has_transients()
            && !topology.reports_all()
            && mode != Quieting::Off;
        let circles = topology.is_before_circle();
        let spell = |me| Spell {
            eligible: applies && !topology.downstream(me).is_empty() && !circles[me],
            through: Tag::NEVER,
            sent: 0,
            latest: Tag::NEVER,
            stride: 0,
            told: false,
            reports: 0,
            patience: PATIENCE.0,
        };
        Self {
            mode,
            spells: topology.federates().map(spell).collect(),
            quiet: 0,
            sought: topology.federates().map(|_| Tag::NEVER).collect(),
            blocked: Vec::new(),
        }
    }

    /// A federate wants a tag and does not get it.
    pub(super) fn lacks(&mut self, federate: FederateId, wanted: Tag) {
        if self.quiet > 0 && self.sought[federate] != wanted {
            self.blocked.push((federate, wanted));
        }
    }

    /// A federate gets the tag that it wants.
    pub(super) fn granted(&mut self, federate: FederateId) {
        self.sought[federate] = Tag::NEVER;
    }

    /// A federate may not be quiet any more.
    fn loosen(&mut self, federate: FederateId) {
        let spell = &mut self.spells[federate];
        let was = std::mem::replace(&mut spell.through, Tag::NEVER) > Tag::NEVER;
        self.quiet -= usize::from(was);
    }

    fn tell(&mut self, federate: FederateId, through: Tag) -> Frame {
        let spell = &mut self.spells[federate];
        spell.told = true;
        spell.reports = 0;
        let was = std::mem::replace(&mut spell.through, through);
        self.quiet += usize::from(was == Tag::NEVER);
        Frame::DownstreamNextEventTag { tag: through, sent: spell.sent }
    }

    /// A federate has reported its next event. Returns through which tag, at least, it must be
    /// allowed to be quiet to make that worth a frame, if it is time to look.
    fn reported(&mut self, federate: FederateId, next: Tag) -> Option<Tag> {
        let spell = &mut self.spells[federate];
        // What is reported before the end of its silence says nothing of how often it does so.
        if !spell.eligible || next <= spell.through || next == Tag::FOREVER {
            return None;
        }
        if self.mode == Quieting::Eager {
            return Some(next);
        }
        let elapsed = next.time.saturating_sub(spell.latest.time);
        if std::mem::take(&mut spell.told) {
            // It has been quiet for a while: was it worth it?
            let saved = elapsed >= spell.stride.saturating_mul(WORTH);
            spell.patience = if saved { spell.patience / 2 } else { spell.patience * 2 };
            spell.patience = spell.patience.clamp(PATIENCE.0, PATIENCE.1);
        } else {
            spell.stride = elapsed;
        }
        spell.latest = next;
        spell.reports += 1;
        if spell.reports < spell.patience {
            return None;
        }
        let worth = next.time.saturating_add(spell.stride.saturating_mul(WORTH));
        Some(Tag { time: worth, ..next }.max(next.succ()))
    }

    /// A federate was not allowed to be quiet for long enough.
    fn in_vain(&mut self, federate: FederateId) {
        if self.mode == Quieting::Usual {
            self.hesitate(federate);
        }
    }

    fn hesitate(&mut self, federate: FederateId) {
        let spell = &mut self.spells[federate];
        spell.reports = 0;
        spell.patience = (spell.patience * 2).min(PATIENCE.1);
    }
}

impl Advance {
    /// A federate has sent a message. It reports what follows, whatever it was told before.
    pub(in crate::rti) fn sent(&mut self, federate: FederateId) {
        if self.needs.spells[federate].eligible {
            self.needs.spells[federate].sent += 1;
            self.needs.spells[federate].reports = 0;
            self.needs.loosen(federate);
        }
    }

    /// A federate has reported its next event, and whoever may advance now has been told. Returns
    /// what to say to it, if it may be quiet for a while.
    pub(in crate::rti) fn quieten(
        &mut self,
        topology: &Topology,
        federate: FederateId,
    ) -> Option<Frame> {
        let next = self.reports[federate].next.tag;
        let least = self.needs.reported(federate, next)?;
        let Some(limit) = self.limit(topology, federate, least) else {
            self.needs.in_vain(federate);
            return None;
        };
        Some(self.needs.tell(federate, limit))
    }

    /// Who is to report again, because somebody waits for it, and what to say to it.
    pub(in crate::rti) fn call(&mut self, topology: &Topology) -> Vec<(FederateId, Frame)> {
        let mut called = Vec::new();
        for (federate, wanted) in std::mem::take(&mut self.needs.blocked) {
            self.needs.sought[federate] = wanted;
            for quiet in self.in_the_way(topology, federate, wanted) {
                self.needs.loosen(quiet);
                if self.needs.mode == Quieting::Usual {
                    self.needs.hesitate(quiet);
                }
                let sent = self.needs.spells[quiet].sent;
                called.push((quiet, Frame::DownstreamNextEventTag { tag: Tag::NEVER, sent }));
            }
        }
        called
    }

    /// Everybody reports everything from now on, and knows that.
    pub(super) fn hear_all(&mut self, topology: &Topology) {
        for federate in topology.federates() {
            self.needs.loosen(federate);
            self.needs.sought[federate] = Tag::NEVER;
        }
        self.needs.blocked.clear();
    }

    /// The latest tag such that no federate waits for what another one does until then; none, if that
    /// is before `least`.
    fn limit(&self, topology: &Topology, from: FederateId, least: Tag) -> Option<Tag> {
        let mut limit = Tag::FOREVER;
        let mut seen = BTreeSet::from([from]);
        let mut queue = BTreeSet::from([(Step::begin(Tag::START), from)]);
        // The nearest first: how far it is to each of them.
        while let Some((distance, here)) = queue.pop_first() {
            if here != from {
                if !seen.insert(here) || self.earliest.has_ended(here) {
                    continue;
                }
                limit = limit.min(before(self.demand(here), distance.tag));
                if limit < least {
                    return None;
                }
            }
            for edge in topology.downstream(here) {
                let distance = edge.shift(distance);
                if distance < Step::FOREVER && !seen.contains(&edge.federate) {
                    queue.insert((distance, edge.federate));
                }
            }
        }
        Some(limit)
    }

    /// Before this tag a federate waits for nobody, unless it gets a message.
    fn demand(&self, federate: FederateId) -> Tag {
        let report = &self.reports[federate];
        report.own(self.stop).tag.max(report.told.whole().succ())
    }

    /// The quiet federates that have to report before a federate may process a tag.
    fn in_the_way(&self, topology: &Topology, of: FederateId, wanted: Tag) -> Vec<FederateId> {
        let mut found = Vec::new();
        let mut seen = BTreeSet::new();
        let mut queue = BTreeSet::from([(wanted, of)]);
        // The highest bound first: whoever is beyond that is beyond the others.
        while let Some((bound, here)) = queue.pop_last() {
            if topology.is_stepwise(here) || !seen.insert(here) {
                continue;
            }
            for (arrival, from) in self.earliest.arrivals(here) {
                if arrival.tag > bound {
                    break;
                }
                let delay = topology.delay(from, here).unwrap_or(Delay::None);
                let bound = before(bound, delay.shift(Tag::START));
                let own = self.reports[from].own(self.stop).tag;
                if own <= bound && self.needs.spells[from].through > bound && !seen.contains(&from)
                {
                    found.push(from);
                }
                if self.earliest.arrival(from).tag <= bound {
                    queue.insert((bound, from));
                }
            }
        }
        found.sort_unstable();
        found.dedup();
        found
    }
}

/// The latest tag from which so long a way leads to `tag` or an earlier one.
fn before(tag: Tag, way: Tag) -> Tag {
    if tag == Tag::FOREVER || tag == Tag::NEVER {
        return tag;
    }
    let time = tag.time.saturating_sub(way.time);
    match (tag.microstep.checked_sub(way.microstep), way.time) {
        (Some(microstep), 0) => Tag { time, microstep },
        (Some(_), _) => Tag { time, microstep: u32::MAX },
        (None, _) => Tag { time: time.saturating_sub(1), microstep: u32::MAX },
    }
}

#[cfg(test)]
mod tests {
    use hprm_core::{Delay, Tag};
    use proptest::prelude::*;

    use super::before;

    proptest! {
        #[test]
        fn before_is_the_latest_tag_that_a_way_leads_from(
            ways in prop::collection::vec((0_i64..3).prop_map(|nanos| match nanos {
                0 => Delay::None,
                nanos => Delay::after(nanos - 1),
            }), 0..5),
            (time, microstep) in (0_i64..9, 0_u32..4),
            from in (-9_i64..9, 0_u32..9),
        ) {
            let (tag, from) = (Tag::new(time, microstep), Tag::new(from.0, from.1));
            let go = |from: Tag| ways.iter().fold(from, |tag, delay| delay.shift(tag));
            let latest = before(tag, go(Tag::START));
            prop_assert_eq!(go(from) <= tag, from <= latest);
        }
    }
}
