//! Whether federates and the RTI say truly what they wait for.
//!
//! What a federate names as its blockers is compared with its permission, and then tried out on copies of its machine:
//! once all of them are removed it may advance, and as long as one of them is left it may not. Of what the RTI waits
//! for, each federate that it names ends on a copy of the RTI, until the federate that waits gets its grant.

use std::collections::BTreeSet;

use hprm_core::{FederateId, Nanos, PhysicalTime, Program, Tag};
use hprm_federated::{
    Blocker, Federate, FederationPhase, Frame, Hold, Input, LinkId, Permission, Rti, RtiInput,
    Standing, Step,
};

/// After all tags of the simulated programs.
const LATE: Tag = Tag::new(Nanos::MAX - 1, 0);

/// How a federate waits: before a tag, or within one before a level.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Asked {
    Tag(Tag),
    Level(Option<u32>),
}

/// A federate that has started, at a moment.
pub(crate) struct Moment<'a> {
    pub(crate) program: &'a Program,
    pub(crate) machine: &'a Federate,
    pub(crate) asked: Asked,
    pub(crate) start: PhysicalTime,
    pub(crate) now: PhysicalTime,
}

/// Which kinds of blockers and holds have been seen.
pub(crate) type Seen = BTreeSet<&'static str>;

impl Moment<'_> {
    /// What is wrong with what the federate says, if anything.
    pub(crate) fn wrong(&self, seen: &mut Seen) -> Option<String> {
        let blockers = self.blockers(self.machine, self.now);
        seen.extend(blockers.iter().map(kind));
        if blockers.is_empty() != self.may(self.machine, self.now) {
            return Some(format!("{:?} has {blockers:?}", self.asked));
        }
        if let Asked::Tag(Tag::FOREVER) = self.asked {
            return None;
        }
        let (machine, now) = self.without(&blockers);
        let left = self.blockers(&machine, now);
        if !blockers.is_empty() && (!left.is_empty() || !self.may(&machine, now)) {
            return Some(format!("{:?} waits for {left:?} beyond {blockers:?}", self.asked));
        }
        // Where there are boards, a federate that waits for something else, too, looks at them again when that is over,
        // and may find then that it needs no message: because of what its own clock did not cause, or because its last
        // tag has become due since it looked.
        let is_message = |it: &Blocker| matches!(it, Blocker::Message { .. });
        let may_pass = self.machine.reads_boards() && !blockers.iter().all(is_message);
        let certain = blockers.iter().filter(|it| !may_pass || !is_message(it));
        certain.into_iter().find_map(|blocker| {
            let others: Vec<_> = blockers
                .iter()
                .filter(|it| *it != blocker && !shares(it, blocker))
                .cloned()
                .collect();
            let (machine, now) = self.without(&others);
            self.may(&machine, now)
                .then(|| format!("{:?} does not need {blocker:?} of {blockers:?}", self.asked))
        })
    }

    fn blockers(&self, machine: &Federate, now: PhysicalTime) -> Vec<Blocker> {
        match self.asked {
            Asked::Tag(tag) => machine.blockers(tag, now),
            Asked::Level(level) => machine.level_blockers(level, now),
        }
    }

    fn may(&self, machine: &Federate, now: PhysicalTime) -> bool {
        match self.asked {
            Asked::Tag(tag) => {
                let due = tag < Tag::FOREVER && tag.due(self.start) <= now;
                due && machine.permission(tag, now) == Permission::Granted
            }
            Asked::Level(level) => machine.level_permission(level, now) == Permission::Granted,
        }
    }

    /// The machine once nothing of this is in the way, and the time that it is then.
    fn without(&self, blockers: &[Blocker]) -> (Federate, PhysicalTime) {
        let mut machine = self.machine.clone();
        let mut now = self.now;
        // A message needs its link.
        let (links, others): (Vec<_>, Vec<_>) =
            blockers.iter().partition(|it| matches!(it, Blocker::BrokenLink { .. }));
        for blocker in links.into_iter().chain(others) {
            if let Blocker::Time { until } = blocker {
                now = now.max(*until);
            }
            for input in self.remedy(blocker) {
                // Without a link, the RTI can say that nothing comes.
                if machine.handle(now, input).is_err()
                    && let Blocker::Message { through, .. } = blocker
                {
                    let frame = Frame::Safe { through: Step::end(*through) };
                    let _ = machine.handle(now, Input::FromRti(frame));
                }
            }
        }
        (machine, now)
    }

    /// What removes a blocker.
    fn remedy(&self, blocker: &Blocker) -> Vec<Input> {
        match blocker {
            Blocker::BrokenLink { peer } => vec![Input::PeerUp(*peer)],
            Blocker::Stop { .. } | Blocker::Starvation => {
                vec![Input::FromRti(Frame::StopGranted { tag: LATE })]
            }
            Blocker::Grant { through } => vec![Input::FromRti(match self.machine.is_stepwise() {
                true => Frame::ProvisionalTagAdvanceGrant { through: *through },
                false => Frame::TagAdvanceGrant { tag: through.tag },
            })],
            Blocker::Message { channel, from, through, .. } => {
                let frame = Frame::PortAbsent { channel: *channel, tag: *through };
                vec![Input::FromPeer { from: *from, frame }]
            }
            Blocker::Unprocessed { receiver, .. } | Blocker::Bound { receiver, .. } => {
                let me = self.machine.me();
                let channels = self.program.channels.iter();
                let to = channels.filter(|(_, it)| (it.from, it.to) == (me, *receiver));
                to.map(|(channel, _)| {
                    let (messages, bytes) = (u64::MAX, u64::MAX);
                    Input::FromRti(Frame::Processed { channel, messages, bytes })
                })
                .collect()
            }
            Blocker::RtiLink
            | Blocker::Joining
            | Blocker::Loading
            | Blocker::Link { .. }
            | Blocker::Start
            | Blocker::Events { .. }
            | Blocker::Time { .. } => Vec::new(),
        }
    }
}

/// Whether one remedy removes both: what a receiver has processed counts in two ways.
fn shares(one: &Blocker, other: &Blocker) -> bool {
    let receiver = |blocker: &Blocker| match blocker {
        Blocker::Unprocessed { receiver, .. } | Blocker::Bound { receiver, .. } => Some(*receiver),
        _ => None,
    };
    receiver(one).is_some() && receiver(one) == receiver(other)
}

fn kind(blocker: &Blocker) -> &'static str {
    match blocker {
        Blocker::RtiLink => "RtiLink",
        Blocker::Joining => "Joining",
        Blocker::Loading => "Loading",
        Blocker::Link { .. } => "Link",
        Blocker::Start => "Start",
        Blocker::BrokenLink { .. } => "BrokenLink",
        Blocker::Events { .. } => "Events",
        Blocker::Time { .. } => "Time",
        Blocker::Stop { .. } => "Stop",
        Blocker::Starvation => "Starvation",
        Blocker::Grant { .. } => "Grant",
        Blocker::Message { .. } => "Message",
        Blocker::Unprocessed { .. } => "Unprocessed",
        Blocker::Bound { .. } => "Bound",
    }
}

/// What is wrong with what the RTI says it waits for, if anything. `links` tells the links that the
/// processes of a federate have or had.
pub(crate) fn wrong_holds(
    rti: &Rti,
    now: PhysicalTime,
    links: impl Fn(FederateId) -> Vec<LinkId>,
    seen: &mut Seen,
) -> Option<String> {
    if rti.phase() == FederationPhase::Failed {
        return None;
    }
    let members: Vec<_> = rti.members(now).collect();
    for (number, member) in members.iter().enumerate() {
        seen.extend(member.holds.iter().map(|hold| match hold {
            Hold::Upstream { .. } => "Upstream",
            Hold::Due { .. } => "Due",
            Hold::InTransit { .. } => "InTransit",
        }));
        let waits = member.wanted.is_some();
        if waits == member.holds.is_empty() {
            return Some(format!("the RTI names {:?} for {number}: {member:?}", member.holds));
        }
        let upstream = member.holds.iter().all(|it| matches!(it, Hold::Upstream { .. }));
        if waits
            && upstream
            && let Some(wrong) = wrong_sources(rti, now, number, &links)
        {
            return Some(wrong);
        }
    }
    None
}

/// Ends the federates for which one waits, one after the other, until it waits for none.
fn wrong_sources(
    rti: &Rti,
    now: PhysicalTime,
    number: usize,
    links: &impl Fn(FederateId) -> Vec<LinkId>,
) -> Option<String> {
    let mut rti = rti.clone();
    loop {
        let members: Vec<_> = rti.members(now).collect();
        let member = &members[number];
        let Some(Hold::Upstream { source, .. }) = member.holds.first() else {
            let granted = member.wanted.is_none() || !member.holds.is_empty();
            return (!granted).then(|| format!("{number} has no grant when all have ended"));
        };
        if source.index() == number {
            // It has not reported its next event yet, which may be before the message that it has to process.
            return member.next.map(|_| format!("{number} waits for itself: {member:?}"));
        }
        let lives = |rti: &Rti| {
            let source = rti.members(now).nth(source.index());
            source.is_some_and(|it| matches!(it.standing, Standing::Joined | Standing::Ready))
        };
        if !lives(&rti) {
            return Some(format!("{number} waits for {source:?}, which has ended: {member:?}"));
        }
        for link in links(*source) {
            // Links that the RTI does not know any more are faults, and change nothing.
            let _ = rti.handle(now, RtiInput::Frame { link, frame: Frame::Resign });
            if lives(&rti) {
                // One that is about to join has nothing to resign from.
                let _ = rti.handle(now, RtiInput::Closed { link });
            }
        }
        if lives(&rti) {
            return Some(format!("{number} waits for {source:?}, which cannot end: {member:?}"));
        }
    }
}
