//! What federates show one another in shared memory, and how far each may advance because of that.
//!
//! Where all federates run on one machine, centralized coordination needs no frames to the RTI and back. Each federate
//! posts on a board, which it alone writes, before which step it does nothing of its own accord, and how many messages
//! it has sent and received. Whichever federate waits reads the boards of the others, and finds from them how early a
//! message may still reach it. That is the RTI's computation (`earliest`), done at once instead of change by change: between
//! two questions most boards have changed.
//!
//! **Old contents are safe.** A federate may see any of the contents that a board has had since it last looked, of each
//! board independently of all others. Take the earliest message that may still reach it, and follow back what causes
//! that message. Each message on the way was either sent after its sender's board was read, and then its cause is
//! next; or it was sent before, and then it is counted at the sender, and not yet at the receiver if the receiver has
//! to do something because of it that its board does not tell. In the first case, what the sender's board says holds
//! for the cause; in the second, the bound for unread messages does. Steps increase along the way, so it ends.
//!
//! So nothing depends on the order in which memory is written: a message may reach its receiver before or after the
//! board that counts it. What transient federates make of that is in `lives`. How boards get from one process to
//! another is up to the driver.

use hprm_core::{ChannelId, FederateId, Table, Tag};
use serde::{Deserialize, Serialize};

use crate::{Step, Topology};
use found::Found;
use lives::Lives;

mod found;
mod lives;

/// How many messages one end of a channel has counted, and the tag of the last one.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub struct Tally {
    /// How many.
    pub messages: u64,
    /// The tag of the last one; `NEVER` if there was none.
    pub latest: Tag,
    /// Which process at the other end they were for, or of: how many have joined as that federate, up to that one. Zero for
    /// none yet, and without transient federates.
    pub life: u32,
}

/// How many federates coordinate themselves by boards at most: each has a descriptor for the board of every other one, and
/// one more to wake it up.
pub(crate) const FEDERATES: usize = 64;

/// That a federate reads the board of another one.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Reading {
    pub(crate) reader: FederateId,
    pub(crate) owner: FederateId,
    /// Whether the reader may have to wake up the owner, to which something leads from it.
    pub(crate) wakes: bool,
}

impl Reading {
    /// The other one, if a federate is the reader or the owner.
    pub(crate) fn partner_of(self, federate: FederateId) -> Option<FederateId> {
        let Self { reader, owner, .. } = self;
        if reader == federate { Some(owner) } else { (owner == federate).then_some(reader) }
    }

    /// What the reader gets of the owner, its board and perhaps its notifier: for each, whether it is the notifier.
    pub(crate) fn descriptors(self) -> impl Iterator<Item = bool> {
        [false, true].into_iter().take(1 + usize::from(self.wakes))
    }
}

/// Which federates read which boards: those of all from which something leads to them, or to a federate to which
/// something leads from them, because they find out for those whether they need not wait any more.
pub(crate) fn readings(topology: &Topology) -> Vec<Reading> {
    let reached: Table<FederateId, Vec<FederateId>> =
        topology.federates().map(|me| topology.reachable(me)).collect();
    let reaches = |from: FederateId, to: FederateId| reached[from].binary_search(&to).is_ok();
    let pairs = topology.federates().flat_map(|reader| {
        let others = topology.federates().filter(move |owner| *owner != reader);
        others.map(move |owner| (reader, owner))
    });
    let reading = |(reader, owner): (FederateId, FederateId)| {
        let wakes = reaches(reader, owner);
        let meets = || reached[owner].iter().any(|it| *it == reader || reaches(reader, *it));
        (wakes || meets()).then_some(Reading { reader, owner, wakes })
    };
    pairs.filter_map(reading).collect()
}

/// What a federate shows of itself.
#[derive(Clone, PartialEq, Eq, Hash, Debug, Serialize, Deserialize)]
pub struct Posting {
    /// Before this step it does nothing, unless a message reaches it that it has not counted.
    pub next: Step,
    /// Through which step it must know its inputs before it goes on; `NEVER` if it does not wait for that.
    pub waits: Step,
    /// It has asked to leave before the others: it promises no more than `next` until it knows at which tag.
    pub departs: bool,
    /// It has ended, and sends nothing more.
    pub ended: bool,
    /// Which process shows this: how many have joined as that federate, up to it. Zero without transient federates.
    pub life: u32,
    /// What it has counted on its channels, in their order: on all that lead from it or to it, but physical ones. One
    /// from a federate to itself is there twice; the first of these tallies counts what was sent.
    pub tallies: Vec<Tally>,
}

/// One channel, and where its two tallies are.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
struct Line {
    from: FederateId,
    to: FederateId,
    sent: usize,
    received: usize,
    /// The level before which the receiver has to know its messages, as in [`Edge::shift`](crate::Edge::shift).
    level: u32,
    /// Whether its sender had ended before its receiver has joined, and so perhaps before that has got to know it.
    late: bool,
}

/// See the module.
#[derive(Clone, PartialEq, Eq, Hash, Debug)]
pub(crate) struct Boards {
    me: FederateId,
    lines: Vec<Line>,
    /// The lines that lead to each federate.
    leading_to: Table<FederateId, Vec<usize>>,
    /// The federates to which those of each federate lead.
    leading_from: Table<FederateId, Vec<FederateId>>,
    /// Where the tally of a channel is on this federate's own board.
    own: Vec<(ChannelId, usize)>,
    /// What is known of the processes that are transient federates.
    lives: Lives,
    postings: Table<FederateId, Posting>,
    /// The last tag of the program, as far as this federate knows.
    stop: Tag,
    /// The federates downstream of this one.
    downstream: Vec<FederateId>,
    /// Which federates share memory with this one, so that their boards are read as soon as they change.
    near: Table<FederateId, bool>,
    /// The federates from which something leads to this one, the furthest first.
    upstream: Vec<FederateId>,
    /// The same for this federate and all downstream.
    around: Vec<FederateId>,
    found: Found,
    /// How many it has counted since [`Self::show`]: none, one or several.
    unshown: u8,
    /// How many postings are of use to all downstream, of this federate's last one and the next: none, one, or both.
    wakes_all: u8,
}

impl Tally {
    const NONE: Self = Self { messages: 0, latest: Tag::NEVER, life: 0 };
}

impl Posting {
    fn new(tallies: usize) -> Self {
        Self {
            next: Step::begin(Tag::START),
            waits: Step::NEVER,
            departs: false,
            ended: false,
            life: 0,
            tallies: vec![Tally::NONE; tallies],
        }
    }
}

impl Boards {
    /// Boards on which nothing has been posted: all federates may do something at tag zero.
    pub(crate) fn new(topology: &Topology, me: FederateId) -> Self {
        let federates = topology.federates().count();
        let mut counts: Table<FederateId, usize> = Table::filled(federates, 0);
        let mut take = |federate: FederateId| {
            counts[federate] += 1;
            counts[federate] - 1
        };
        let mut leading_to: Table<FederateId, Vec<usize>> = Table::filled(federates, Vec::new());
        let mut leading_from: Table<FederateId, Vec<FederateId>> =
            Table::filled(federates, Vec::new());
        let (mut lines, mut own) = (Vec::new(), Vec::new());
        for (id, channel) in topology.channels().iter().filter(|(_, channel)| !channel.physical) {
            let (from, to) = (channel.from, channel.to);
            let level = if channel.is_direct() { channel.first_reader } else { 0 };
            let (sent, received) = (take(from), take(to));
            let tallies = [(from, sent), (to, received)].into_iter();
            own.extend(tallies.filter(|(end, _)| *end == me).map(|(_, at)| (id, at)));
            leading_to[to].push(lines.len());
            if !leading_from[from].contains(&to) {
                leading_from[from].push(to);
            }
            lines.push(Line { from, to, sent, received, level, late: false });
        }
        let downstream: Vec<_> = topology.reachable(me).into_iter().collect();
        Self {
            me,
            lines,
            leading_to,
            leading_from,
            own,
            lives: Lives::new(federates),
            postings: counts.values().map(|count| Posting::new(*count)).collect(),
            stop: topology.timeout(),
            upstream: leading_to_any(topology, &[me]),
            around: leading_to_any(topology, &downstream),
            downstream: downstream.into_iter().filter(|other| *other != me).collect(),
            near: Table::filled(federates, true),
            found: Found::nothing(federates),
            unshown: 0,
            wakes_all: 0,
        }
    }

    /// Whether the board of a federate is in memory that this one shares.
    pub(crate) fn is_near(&mut self, federate: FederateId, is_near: bool) {
        self.near[federate] = is_near;
    }

    /// What this federate shows.
    pub(crate) fn own(&self) -> &Posting {
        &self.postings[self.me]
    }

    /// A step of this federate, or the last tag of the program if that comes first: a federate processes it, whatever
    /// else it has to do.
    pub(crate) fn until_stop(&self, step: Step) -> Step {
        if step.tag > self.stop { Step::begin(self.stop) } else { step }
    }

    /// Whether this federate sends to another one.
    pub(crate) fn has_downstream(&self) -> bool {
        !self.downstream.is_empty()
    }

    /// Whether a federate shows that it waits for the tag at which it may leave.
    pub(crate) fn departs(&self, federate: FederateId) -> bool {
        self.postings[federate].departs
    }

    /// Counts a message that this federate sends.
    pub(crate) fn sent(&mut self, channel: ChannelId, tag: Tag) {
        let at = self.own.partition_point(|(id, _)| *id < channel);
        self.count(at, channel, tag);
    }

    /// Counts a message that has arrived, at whose tag this federate may do something.
    pub(crate) fn received(&mut self, channel: ChannelId, tag: Tag) {
        let after = self.own.partition_point(|(id, _)| *id <= channel);
        self.count(after.wrapping_sub(1), channel, tag);
        let own = &mut self.postings[self.me];
        own.next = own.next.min(Step::begin(tag));
    }

    fn count(&mut self, at: usize, channel: ChannelId, tag: Tag) {
        let Some((_, at)) = self.own.get(at).filter(|(id, _)| *id == channel) else { return };
        let tally = &mut self.postings[self.me].tallies[*at];
        let messages = tally.messages.saturating_add(1);
        *tally = Tally { messages, latest: tally.latest.max(tag), ..*tally };
        self.unshown = (self.unshown + 1).min(2);
        self.refresh(self.me);
    }

    /// How many messages this federate has counted that the others do not see on its board: none, one, or two for
    /// several.
    pub(crate) fn unshown(&self) -> u8 {
        self.unshown
    }

    /// From now on, this federate does nothing before a step, and its board is to say so.
    pub(crate) fn post(&mut self, next: Step, departs: bool) {
        let own = &mut self.postings[self.me];
        if own.next != next {
            self.found.forget_known();
        }
        (own.next, own.departs) = (next, departs);
    }

    /// What the others are to see from now on: all that this federate has counted, and that it waits until it knows its
    /// inputs through a step.
    pub(crate) fn show(&mut self, waits: Step) -> Posting {
        self.unshown = 0;
        self.wakes_all = self.wakes_all.saturating_sub(1);
        let own = &mut self.postings[self.me];
        own.waits = waits;
        Posting { tallies: self.found.copy(&own.tallies), ..*own }
    }

    /// This federate has ended.
    pub(crate) fn end(&mut self) {
        self.postings[self.me].ended = true;
        self.refresh(self.me);
    }

    /// Takes what another federate shows. What does not fit the program, no federate has posted; and what a former process
    /// of a federate has shown may still come when its successor is known already.
    pub(crate) fn read(&mut self, from: FederateId, posting: Posting) {
        let known = self.postings.get(from).filter(|_| from != self.me);
        let fits = |known: &Posting| known.tallies.len() == posting.tallies.len();
        if known.is_some_and(|known| fits(known) && known.life == posting.life) {
            let former = std::mem::replace(&mut self.postings[from], posting);
            self.found.recycle(former.tallies);
            self.lives.silent.remove(&from);
            self.refresh(from);
        }
    }

    /// The program ends at `tag`.
    pub(crate) fn stop_at(&mut self, tag: Tag) {
        self.stop = self.stop.min(tag);
        self.found.forget_known();
    }

    /// For which step a federate shows that it waits, if it does.
    pub(crate) fn awaited_by(&self, federate: FederateId) -> Option<Step> {
        let waits = self.postings[federate].waits;
        (waits > Step::NEVER && !self.has_ended(federate)).then_some(waits)
    }

    /// How early a message can reach each federate, if this federate does nothing before a step, and no other one
    /// does anything of its own accord.
    pub(crate) fn caused_from(&self, next: Step, topology: &Topology) -> Table<FederateId, Step> {
        let all: Vec<_> = topology.federates().collect();
        let source = |from| if from == self.me { next } else { Step::FOREVER };
        self.arrivals(topology, &all, Table::filled(self.postings.len(), Step::FOREVER), source)
    }

    /// How early a message can still be sent to each federate that one of these sends to, and arrive there.
    ///
    /// Whatever a federate sends, it does of its own accord, or because of something that arrives there. Each way
    /// around leads to a later step, so the values settle after as many rounds as a way has federates; few, because
    /// those upstream come first. Before the step that `source` tells, a federate does nothing of its own accord.
    fn arrivals(
        &self,
        topology: &Topology,
        of: &[FederateId],
        mut arrivals: Table<FederateId, Step>,
        source: impl Fn(FederateId) -> Step,
    ) -> Table<FederateId, Step> {
        arrivals.values_mut().for_each(|arrival| *arrival = Step::FOREVER);
        let mut settled = false;
        while !settled {
            settled = true;
            for from in of.iter().copied().filter(|from| !self.has_ended(*from)) {
                let earliest = source(from).min(arrivals[from]);
                for edge in topology.downstream(from) {
                    let arrival = edge.shift(earliest);
                    if arrival < arrivals[edge.federate] {
                        arrivals[edge.federate] = arrival;
                        settled = false;
                    }
                }
            }
        }
        arrivals
    }
}

/// The federates from which something leads to one of these, each before those to which it sends where there is no
/// way back.
fn leading_to_any(topology: &Topology, targets: &[FederateId]) -> Vec<FederateId> {
    let mut found = Vec::new();
    let mut seen: Table<FederateId, bool> = topology.federates().map(|_| false).collect();
    let senders = |federate| topology.upstream(federate).iter();
    // The ways back that are being followed, each with the senders that are still to be visited.
    let mut open: Vec<_> = targets.iter().map(|target| (None, senders(*target))).collect();
    while let Some((federate, rest)) = open.last_mut() {
        match rest.next() {
            Some(edge) if seen[edge.federate] => {}
            Some(edge) => {
                seen[edge.federate] = true;
                open.push((Some(edge.federate), senders(edge.federate)));
            }
            None => {
                found.extend(*federate);
                open.pop();
            }
        }
    }
    found
}

#[cfg(test)]
mod tests;
