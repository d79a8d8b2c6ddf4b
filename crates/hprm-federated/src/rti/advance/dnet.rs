//! Downstream next event tags (DNET): through which tag a federate need not report its next event tags.
//!
//! A report of a federate is useful if it may let another federate advance. A federate whose receivers
//! wait for a far tag, or for no tag at all, gets a DNET: it skips all reports through that tag. It
//! reports again what is beyond the tag, and as soon as it sends a message. The RTI *recalls* it with a
//! DNET of `NEVER` when another federate does wait for it. This file decides when the RTI sends a DNET;
//! `waiting` finds the tag, and the federates that must be recalled.
//!
//! A DNET costs a frame, and a recall costs the waiting federate a round trip. So the RTI sends a DNET
//! only to a federate that has reported several times in a row and sent no message. After a DNET that
//! saved little, or that was recalled, the RTI backs off: it waits for more reports before the next one.
//!
//! A federate on a cycle without a delay gets no DNET, and neither does a federate upstream of such a
//! cycle: within a tag, all that they report is useful. Transient federates join at a tag that follows
//! from reports, so in a program with transient federates the RTI sends no DNET at all.

use hprm_core::{Coordination, FederateId, Nanos, Table, Tag};

use crate::{Frame, Topology};

/// When the RTI sends downstream next event tags.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Default)]
pub enum DnetMode {
    /// When it seems to save frames.
    #[default]
    Usual,
    /// After each report, if there is any tag through which the federate may skip its reports. Costs
    /// frames, and shows faults.
    Eager,
    /// Never.
    Off,
}

/// After how many useless reports a federate gets a DNET: at least, and at most.
const FEWEST_REPORTS: u32 = 2;
const MOST_REPORTS: u32 = 64;

/// How many events a DNET must leave out at least, or it is not worth a frame.
const WORTH: Nanos = 3;

/// What the RTI knows of the reports of one federate.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
struct Reports {
    /// Whether the federate may ever skip reports.
    eligible: bool,
    /// The tag of the DNET that is in force; `NEVER` if there is none.
    skips_through: Tag,
    /// How many messages the federate has sent.
    sent: u64,
    /// The latest next event tag that the federate has reported.
    latest: Tag,
    /// The time between the latest two reported tags, when no DNET was between them.
    interval: Nanos,
    /// Whether the federate has got a DNET since its latest report.
    after_dnet: bool,
    /// How many reports have come since the last DNET, recall or message of the federate.
    count: u32,
    /// How many reports it takes until the RTI tries a DNET.
    threshold: u32,
}

/// A federate that waits for a grant while others skip their reports.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub(super) struct Blocked {
    pub(super) federate: FederateId,
    /// The tag that the federate wants to process.
    pub(super) wanted: Tag,
}

/// The downstream next event tags of a federation.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(super) struct Dnet {
    mode: DnetMode,
    reports: Table<FederateId, Reports>,
    /// How many federates skip their reports.
    skipping: usize,
    /// The wanted tag of each federate for which the RTI has already recalled all that are in the way.
    recalled_for: Table<FederateId, Tag>,
    /// The federates for which the RTI has to look for reports that are skipped.
    blocked: Vec<Blocked>,
}

impl Dnet {
    pub(super) fn new(topology: &Topology, mode: DnetMode) -> Self {
        let applies = topology.coordination() == Coordination::Centralized
            && !topology.has_transients()
            && !topology.reports_all()
            && mode != DnetMode::Off;
        let before_cycle = topology.is_before_cycle();
        let reports = |federate| Reports {
            eligible: applies
                && !topology.downstream(federate).is_empty()
                && !before_cycle[federate],
            skips_through: Tag::NEVER,
            sent: 0,
            latest: Tag::NEVER,
            interval: 0,
            after_dnet: false,
            count: 0,
            threshold: FEWEST_REPORTS,
        };
        Self {
            mode,
            reports: topology.federates().map(reports).collect(),
            skipping: 0,
            recalled_for: topology.federates().map(|_| Tag::NEVER).collect(),
            blocked: Vec::new(),
        }
    }

    /// A federate wants a tag and does not get a grant for it.
    pub(super) fn block(&mut self, federate: FederateId, wanted: Tag) {
        if self.skipping > 0 && self.recalled_for[federate] != wanted {
            self.blocked.push(Blocked { federate, wanted });
        }
    }

    /// A federate gets a grant for the tag that it wants.
    pub(super) fn granted(&mut self, federate: FederateId) {
        self.recalled_for[federate] = Tag::NEVER;
    }

    /// The blocked federates. The caller recalls the federates that are in their way.
    pub(super) fn take_blocked(&mut self) -> Vec<Blocked> {
        let blocked = std::mem::take(&mut self.blocked);
        for Blocked { federate, wanted } in &blocked {
            self.recalled_for[*federate] = *wanted;
        }
        blocked
    }

    /// Whether a federate skips reports at tags after `tag`.
    pub(super) fn skips_beyond(&self, federate: FederateId, tag: Tag) -> bool {
        self.reports[federate].skips_through > tag
    }

    /// A federate has sent a message. It reports what follows, whatever its DNET says.
    pub(super) fn sent(&mut self, federate: FederateId) {
        let reports = &mut self.reports[federate];
        if reports.eligible {
            reports.sent += 1;
            reports.count = 0;
            self.cancel(federate);
        }
    }

    /// A federate has reported its next event. If it is time to try a DNET, returns the least tag for
    /// which one is worth a frame.
    pub(super) fn reported(&mut self, federate: FederateId, next: Tag) -> Option<Tag> {
        let reports = &mut self.reports[federate];
        // A report within the skipped tags says nothing of how often the federate reports.
        if !reports.eligible || next <= reports.skips_through || next == Tag::FOREVER {
            return None;
        }
        if self.mode == DnetMode::Eager {
            return Some(next);
        }
        let elapsed = next.time.saturating_sub(reports.latest.time);
        if std::mem::take(&mut reports.after_dnet) {
            // The DNET has ended: did it leave out enough reports?
            let saved = elapsed >= reports.interval.saturating_mul(WORTH);
            let threshold = if saved { reports.threshold / 2 } else { reports.threshold * 2 };
            reports.threshold = threshold.clamp(FEWEST_REPORTS, MOST_REPORTS);
        } else {
            reports.interval = elapsed;
        }
        reports.latest = next;
        reports.count += 1;
        if reports.count < reports.threshold {
            return None;
        }
        let time = next.time.saturating_add(reports.interval.saturating_mul(WORTH));
        Some(Tag { time, ..next }.max(next.succ()))
    }

    /// The DNET that lets a federate skip its reports through a tag.
    pub(super) fn skip(&mut self, federate: FederateId, through: Tag) -> Frame {
        let reports = &mut self.reports[federate];
        reports.after_dnet = true;
        reports.count = 0;
        let was = std::mem::replace(&mut reports.skips_through, through);
        self.skipping += usize::from(was == Tag::NEVER);
        Frame::DownstreamNextEventTag { tag: through, sent: reports.sent }
    }

    /// The DNET that ends all skipping of a federate, because another federate waits for its reports.
    pub(super) fn recall(&mut self, federate: FederateId) -> Frame {
        self.cancel(federate);
        self.back_off(federate);
        let sent = self.reports[federate].sent;
        Frame::DownstreamNextEventTag { tag: Tag::NEVER, sent }
    }

    /// Tries the next DNET for a federate later, because the last one was of little use, or was not
    /// possible.
    pub(super) fn back_off(&mut self, federate: FederateId) {
        if self.mode == DnetMode::Usual {
            let reports = &mut self.reports[federate];
            reports.count = 0;
            reports.threshold = (reports.threshold * 2).min(MOST_REPORTS);
        }
    }

    /// All federates report everything from now on, and know it.
    pub(super) fn cancel_all(&mut self, topology: &Topology) {
        for federate in topology.federates() {
            self.cancel(federate);
            self.recalled_for[federate] = Tag::NEVER;
        }
        self.blocked.clear();
    }

    /// A federate skips no reports any more.
    fn cancel(&mut self, federate: FederateId) {
        let reports = &mut self.reports[federate];
        let was = std::mem::replace(&mut reports.skips_through, Tag::NEVER);
        self.skipping -= usize::from(was > Tag::NEVER);
    }
}
